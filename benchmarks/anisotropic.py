"""What full covariances bring, and what is proved: python -m benchmarks.anisotropic PART.

table   the share proved of simulated graphs, by ratio of precisions and noise
rounding    the same near zero noise, without and with gravity: where rounding ends it
staircase   what the staircase finds and bounds where answers are refuted
files   pose graphs with their files' full information: verdict, gap, CPU time against isotropic
sphinx  lu_sphinx with its two-view precisions against the truth
photographs fountain-P11 and castle-P19, with the covariances of `rotavg images`, against the truth
        (needs OpenCV)
factor  by how much the mean squared error falls, Monte Carlo against theory
colmap  databases of synthetic scenes: mean errors with covariances from the inliers and with
        numbers of inliers as weights, and what reading them costs (needs pycolmap)
sdp     bounds against a semidefinite program (needs the package clarabel)
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import rotavg
from benchmarks.anisotropic_data import colmap, files, photographs, sphinx
from benchmarks.anisotropic_graphs import RATIOS, simulated, theory
from benchmarks.relaxation import accuracy, relaxation
from rotavg.graph.conventions import matrices_from_rotvecs

PARTS = (
    "table",
    "rounding",
    "staircase",
    "files",
    "sphinx",
    "photographs",
    "factor",
    "colmap",
    "sdp",
)


def table(runs: int) -> None:
    """The share proved."""
    print("| precisions | noise [rad] | nodes, density | proved | largest gap of the rest |")
    print("|---|---|---|---|---|")
    for ratio in RATIOS:
        for noise in (0.01, 0.05, 0.1, 0.2, 0.3, 0.6):
            for n, density in ((12, 1.0), (30, 0.3), (30, 0.15)):
                gaps = []
                for seed in range(runs):
                    graph, _ = simulated(np.random.default_rng(seed), n, density, ratio, noise)
                    certificate = rotavg.solve(graph, anisotropic=True, num_threads=1).certificate
                    assert certificate is not None
                    if certificate.verdict != "proved":
                        gaps.append(certificate.relative_gap)
                name = ":".join(f"{x:g}" for x in ratio)
                rest = f"{max(gaps):.2g}" if gaps else ""
                print(f"| {name} | {noise} | {n}, {density:g} | {runs - len(gaps)} of {runs} "
                      f"| {rest} |", flush=True)  # fmt: skip


def rounding(runs: int) -> None:
    """The share proved near zero noise, with all precisions and with gravity."""
    noises = (1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6)
    print("| precisions | priors | " + " | ".join(f"{noise:g} rad" for noise in noises) + " |")
    print("|---|---|" + "---|" * len(noises))
    for ratio in RATIOS:
        for gravity in (False, True):
            cells = []
            for noise in noises:
                gaps = []
                for seed in range(runs):
                    rng = np.random.default_rng(seed)
                    graph, truth = simulated(rng, 30, 0.3, ratio, noise)
                    priors = None
                    if gravity:
                        down = np.swapaxes(truth, 1, 2) @ np.array([0.0, 1.0, 0.0])
                        down += noise * rng.normal(size=down.shape)
                        priors = rotavg.Priors(
                            gravity={k: (d, 1 / noise**2) for k, d in enumerate(down)}
                        )
                    c = rotavg.solve(
                        graph, anisotropic=True, priors=priors, num_threads=1
                    ).certificate
                    assert c is not None
                    if c.verdict != "proved":
                        gaps.append(c.relative_gap)
                cells.append(f"{runs - len(gaps)}" + (f" ({max(gaps):.1g})" if gaps else ""))
            name = ":".join(f"{x:g}" for x in ratio)
            known = "gravity" if gravity else ""
            print(f"| {name} | {known} | " + " | ".join(cells) + " |", flush=True)


def staircase(runs: int) -> None:
    """Where the answer without a staircase is refuted: what it finds, and what gap it leaves."""
    print("| graphs | refuted | proved by it | lower by it | gaps without, with [of f] |")
    print("|---|---|---|---|---|")

    def row(name: str, graphs: list[tuple[rotavg.MeasurementGraph, Any]], method: str) -> None:
        refuted = proved = lower = 0
        gaps = []
        for graph, start in graphs:
            settings: dict[str, Any] = {"init": start, "anisotropic": True, "num_threads": 1}
            plain = rotavg.solve(graph, max_rank=0, method=method, **settings)  # type: ignore[arg-type]
            full = rotavg.solve(
                graph, method="auto" if method == "auto" else "staircase", **settings
            )
            assert plain.certificate is not None
            assert full.certificate is not None
            if plain.certificate.verdict == "proved":
                continue
            refuted += 1
            proved += full.certificate.verdict == "proved"
            lower += full.objective < plain.objective * (1 - 1e-6)
            gaps.append([min(c.relative_gap, 1.0) for c in (plain.certificate, full.certificate)])
        gap = "{:.2f}, {:.2f}".format(*np.mean(gaps, axis=0)) if gaps else ""
        print(f"| {name} | {refuted} of {len(graphs)} | {proved} | {lower} | {gap} |", flush=True)

    for ratio in RATIOS[1:]:
        name = ":".join(f"{x:g}" for x in ratio)
        for noise in (0.05, 0.2):
            rings = []
            for seed in range(runs):
                graph, truth = simulated(np.random.default_rng(seed), 20, 0.0, ratio, noise)
                assert graph.covariances is not None
                loop = rotavg.MeasurementGraph(
                    [*graph.edges, (19, 0)],
                    np.concatenate([graph.rotations, (truth[19].T @ truth[0])[None]]),
                    covariances=np.concatenate([graph.covariances, graph.covariances[:1]]),
                )
                twist = np.outer(2 * np.pi * np.arange(20) / 20, [0.36, 0.48, 0.8])
                rings.append((loop, matrices_from_rotvecs(twist) @ truth))
            row(f"cycles of 20 wound once, {name}, {noise} rad", rings, "newton")
        for noise in (0.3, 0.6, 1.0):
            cases = [
                (simulated(np.random.default_rng(seed), 30, 0.15, ratio, noise)[0], "auto")
                for seed in range(runs)
            ]
            row(f"30 nodes, density .15, {name}, {noise} rad", cases, "auto")


def factor(runs: int) -> None:
    """The mean squared error with covariances over that with scalar weights."""
    print("| precisions | theory | Monte Carlo |")
    print("|---|---|---|")
    for ratio in RATIOS[1:]:
        _, truth = simulated(np.random.default_rng(0), 12, 0.5, ratio, 0.01)
        squares = np.zeros(2)
        predicted = np.zeros(2)
        for seed in range(runs):
            rng = np.random.default_rng(7)  # the same graph, truth and axes
            graph, truth = simulated(rng, 12, 0.5, ratio, 0.01)
            assert graph.covariances is not None
            i, j = graph.indices.T
            root = np.linalg.cholesky(graph.covariances)
            e = np.einsum("kab,kb->ka", root, np.random.default_rng(seed).normal(size=(len(i), 3)))
            exact = np.swapaxes(truth[i], 1, 2) @ truth[j]
            graph = rotavg.MeasurementGraph(
                graph.edges, exact @ matrices_from_rotvecs(e), covariances=graph.covariances
            )
            if seed == 0:
                predicted = theory(graph, truth)
            for k, anisotropic in enumerate((False, True)):
                R = rotavg.solve(
                    graph, anisotropic=anisotropic, certify=False, num_threads=1
                ).rotations
                E = R @ np.swapaxes(truth, 1, 2)
                E = E @ E[0].T
                squares[k] += np.sum((E - np.eye(3)) ** 2) / 2
        name = ":".join(f"{x:g}" for x in ratio)
        print(f"| {name} | {predicted[1] / predicted[0]:.3f} | {squares[1] / squares[0]:.3f} |",
              flush=True)  # fmt: skip


def sdp(runs: int) -> None:
    """No bound of ours may lie above that of the relaxation; where ours proves, they are one."""
    proved = refuted = tight = 0
    worst = 0.0
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(3, 13))
        ratio = RATIOS[1 + seed % 3]
        noise = float(rng.choice([0.05, 0.3, 0.6, 1.0]))
        graph, _ = simulated(rng, n, 0.5, ratio, noise)
        solution = rotavg.solve(graph, anisotropic=True, num_threads=1)
        c = solution.certificate
        assert c is not None
        optimum = relaxation(graph)
        # The rotations are feasible: by what lies above them the solver is off.
        error = accuracy(graph, solution.objective) + max(0.0, optimum - solution.objective)
        above = (solution.objective - c.gap - optimum) / error
        worst = max(worst, above)
        if c.verdict == "proved":
            proved += 1
            if solution.objective - optimum > error:
                print(f"seed {seed}: proved {solution.objective}, relaxation {optimum}")
        elif solution.objective - optimum <= error:
            tight += 1
        else:
            refuted += 1
    print(f"{runs} graphs: {proved} proved, {tight} more are tight by the relaxation, {refuted} "
          f"are not; our bounds lie at most {worst:.2f} of its error above")  # fmt: skip


def main() -> None:
    """Run one part."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--runs", type=int, default=0)
    parser.add_argument("--graphs", nargs="*", default=["sphere2500", "torus3D", "parking-garage"])
    options = parser.parse_args()
    if options.part == "table":
        table(options.runs or 40)
    elif options.part == "rounding":
        rounding(options.runs or 10)
    elif options.part == "staircase":
        staircase(options.runs or 20)
    elif options.part == "photographs":
        photographs()
    elif options.part == "files":
        files(options.graphs, options.runs or 5)
    elif options.part == "sphinx":
        sphinx()
    elif options.part == "factor":
        factor(options.runs or 500)
    elif options.part == "colmap":
        colmap(options.runs or 6)
    else:
        sdp(options.runs or 200)


if __name__ == "__main__":
    main()
