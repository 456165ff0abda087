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
import os
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rotavg
from benchmarks import colmap_pairs
from benchmarks.relaxation import accuracy, relaxation
from rotavg.graph.conventions import matrices_from_quaternions, matrices_from_rotvecs

DATA = Path(os.environ.get("ROTAVG_DATA", Path(__file__).parents[2] / "shared" / "data"))
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
RATIOS = ((1, 1, 1), (1, 2, 2.9), (1, 3, 10), (1, 1, 100))


def random_rotations(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    """(n, 3, 3) uniform."""
    q = rng.normal(size=(n, 4))
    return matrices_from_quaternions(q / np.linalg.norm(q, axis=1, keepdims=True))


def simulated(
    rng: np.random.Generator,
    n: int,
    density: float,
    ratio: tuple[float, float, float],
    noise: float,
) -> tuple[rotavg.MeasurementGraph, NDArray[np.float64]]:
    """A connected random graph whose edges know their axes as `ratio` says, and the truth.

    The axes are random; the RMS noise angle of every edge is `noise` radians.
    """
    i, j = np.triu_indices(n, 1)
    kept = (j == i + 1) | (rng.random(len(i)) < density)
    return measured(rng, np.stack([i[kept], j[kept]], axis=1), n, ratio, noise)


def measured(
    rng: np.random.Generator,
    edges: NDArray[np.int64],
    n: int,
    ratio: tuple[float, float, float],
    noise: float,
) -> tuple[rotavg.MeasurementGraph, NDArray[np.float64]]:
    """The same on given edges."""
    truth = random_rotations(rng, n)
    axes = random_rotations(rng, len(edges))
    variances = 1 / np.asarray(ratio, dtype=float)
    variances *= noise**2 / variances.sum()
    covariances = axes @ (variances[:, None] * np.swapaxes(axes, 1, 2))
    covariances = (covariances + np.swapaxes(covariances, 1, 2)) / 2
    e = np.einsum("kab,kb->ka", axes, np.sqrt(variances) * rng.normal(size=(len(edges), 3)))
    exact = np.swapaxes(truth[edges[:, 0]], 1, 2) @ truth[edges[:, 1]]
    graph = rotavg.MeasurementGraph(
        edges, exact @ matrices_from_rotvecs(e), covariances=covariances, nodes=range(n)
    )
    return graph, truth


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


def photographs() -> None:
    """Strecha's photographs with laser truth: with one weight for each edge, with covariances."""
    from rotavg import images

    focal = 1149.78  # pixels, of these reduced photographs
    print("| photographs | pairs | e C^-1 e, median | weights, loss | mean error [deg] "
          "| median |")  # fmt: skip
    print("|---|---|---|---|---|---|")
    for name in ("fountain-P11", "castle-P19"):
        folder = DATA / "strecha" / name
        graph = images.measure(folder / "images", focal=focal).graph
        truth = {
            path.name[: -len(".camera")]: np.array(path.read_text().split()[12:21], float)
            for path in (folder / "gt_cameras").glob("*.camera")
        }
        R = np.array([truth[node] for node in graph.nodes.tolist()]).reshape(-1, 3, 3)
        i, j = graph.indices.T
        assert graph.covariances is not None
        e = rotation_vectors(np.swapaxes(R[i] @ graph.rotations, 1, 2) @ R[j])
        squares = np.einsum("ka,kab,kb->k", e, np.linalg.inv(graph.covariances), e)
        traces = np.trace(graph.covariances, axis1=1, axis2=2)
        for weights, one, full in (
            ("inliers", graph, False),
            ("3 / tr C", graph.with_weights(3 / traces), False),
            ("covariances", graph, True),
        ):
            for loss in ("l2", "auto"):
                solution = rotavg.solve(one, loss=loss, anisotropic=full, num_threads=1)
                angles = np.degrees(rotavg.compare(solution.rotations, R).angles)
                print(f"| {name} | {graph.num_edges} | {np.median(squares):.3g} "
                      f"| {weights}, {loss} | {angles.mean():.4f} | {np.median(angles):.4f} |",
                      flush=True)  # fmt: skip


def rotation_vectors(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 3) of small rotations."""
    return (
        np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], 1) / 2
    )


def cpu(graph: rotavg.MeasurementGraph, runs: int, **options: Any) -> tuple[float, Any]:
    """Median CPU seconds of this thread, and the last solution."""
    seconds = []
    for _ in range(runs):
        began = time.thread_time()
        solution = rotavg.solve(graph, num_threads=1, **options)
        seconds.append(time.thread_time() - began)
    return statistics.median(seconds), solution


def files(names: list[str], runs: int) -> None:
    """Pose graphs with the information of their files."""
    print("| graph | isotropic, CPU s | anisotropic, CPU s | ratio | verdict | relative gap |")
    print("|---|---|---|---|---|---|")
    for name in names:
        graph = rotavg.read(DATA / "g2o" / f"{name}.g2o")
        plain, _ = cpu(graph, runs)
        full, solution = cpu(graph, runs, anisotropic=True)
        _print_row(name, plain, full, solution.certificate)
    # A cubic lattice of the size of SE-Sync's cubicle.
    lattice = rotavg.simulate("grid", 18**3, seed=1).graph.edges
    for ratio in ((1.0, 2.0, 2.9), (1.0, 3.0, 10.0)):
        graph, _ = measured(np.random.default_rng(1), lattice, 18**3, ratio, 0.05)
        plain, _ = cpu(graph, runs)
        full, solution = cpu(graph, runs, anisotropic=True)
        _print_row(
            "lattice, " + ":".join(f"{x:g}" for x in ratio), plain, full, solution.certificate
        )


def _print_row(name: str, plain: float, full: float, certificate: rotavg.Certificate) -> None:
    print(f"| {name} | {plain:.4f} | {full:.4f} | {full / plain:.2f} | {certificate.verdict} "
          f"| {certificate.relative_gap:.2g} |", flush=True)  # fmt: skip


def general_solver(
    graph: rotavg.MeasurementGraph, start: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """The least objective that SciPy's trust regions find from there: residuals in whitened chords.

    With v = sin(|r| / 2) r / |r|, the objective is the sum of |2 sqrt(C^-1) v|^2.
    """
    from scipy.optimize import least_squares
    from scipy.sparse import csr_matrix
    from scipy.spatial.transform import Rotation

    i, j = graph.indices.T
    n, m = graph.num_nodes, graph.num_edges
    root = np.swapaxes(np.linalg.cholesky(np.linalg.inv(graph.covariances)), 1, 2)
    measured_ij, R = Rotation.from_matrix(graph.rotations), Rotation.from_matrix(start)

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        turned = Rotation.from_rotvec(x.reshape(n, 3)) * R
        q = (measured_ij.inv() * turned[i].inv() * turned[j]).as_quat(canonical=True)
        return (2 * np.einsum("kab,kb->ka", root, q[:, :3])).ravel()

    rows = np.repeat(np.arange(3 * m), 6)
    ends = np.stack([i, j], axis=1)[:, :, None] * 3 + np.arange(3)
    columns = np.repeat(ends.reshape(m, 6), 3, axis=0).ravel()
    sparsity = csr_matrix((np.ones(len(rows)), (rows, columns)), (3 * m, 3 * n))
    found = least_squares(
        residuals, np.zeros(3 * n), jac_sparsity=sparsity, method="trf", x_scale=1.0,
        ftol=1e-15, xtol=1e-15, gtol=1e-12, max_nfev=200,
    )  # fmt: skip
    return 2 * found.cost, (Rotation.from_rotvec(found.x.reshape(n, 3)) * R).as_matrix()


def sphinx() -> None:
    """lu_sphinx: errors against the truth, after the best common rotation."""
    d = np.load(DATA / "viewgraphs" / "lu_sphinx.npz")
    precision = d["precision"]
    covariances = np.linalg.inv((precision + np.swapaxes(precision, 1, 2)) / 2)
    covariances = (covariances + np.swapaxes(covariances, 1, 2)) / 2
    graph = rotavg.MeasurementGraph(d["edges"], d["rotations"], covariances=covariances)
    truth = d["ground_truth"][graph.nodes]
    known = d["has_ground_truth"][graph.nodes]
    for loss in ("l2", "auto"):
        for anisotropic in (False, True, "log"):
            solution = rotavg.solve(graph, loss=loss, anisotropic=anisotropic)
            error = rotavg.compare(solution.rotations[known], truth[known])
            verdict = "none" if solution.certificate is None else solution.certificate.verdict
            print(f"loss {loss}, anisotropic {anisotropic}: mean error "
                  f"{np.degrees(error.angles.mean()):.4f} deg, certificate {verdict}")  # fmt: skip
    best = rotavg.solve(graph, anisotropic=True)
    others = [rotavg.solve(graph, init="random", seed=seed, anisotropic=True) for seed in range(10)]
    print("objective", best.objective, "from ten random starts",
          [f"{s.objective / best.objective - 1:.1g}" for s in others])  # fmt: skip
    rng = np.random.default_rng(1)
    for _ in range(10):
        f, R = general_solver(graph, random_rotations(rng, graph.num_nodes))
        off = rotavg.compare(R, best.rotations).angles.max()
        print(f"SciPy from a random start: objective {f / best.objective - 1:.1g} above, "
              f"{np.degrees(off):.1g} deg away at most", flush=True)  # fmt: skip


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


def theory(graph: rotavg.MeasurementGraph, R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Traces of the errors' covariances, first node held: scalar weights, full ones."""
    assert graph.covariances is not None
    n, (i, j) = graph.num_nodes, graph.indices.T
    B = np.zeros((3 * graph.num_edges, 3 * n))
    for k in range(graph.num_edges):
        B[3 * k : 3 * k + 3, 3 * i[k] : 3 * i[k] + 3] = -R[j[k]].T
        B[3 * k : 3 * k + 3, 3 * j[k] : 3 * j[k] + 3] = R[j[k]].T
    B = B[:, 3:]
    C = np.zeros((3 * graph.num_edges, 3 * graph.num_edges))
    W = np.zeros_like(C)
    for k, covariance in enumerate(graph.covariances):
        rows = slice(3 * k, 3 * k + 3)
        C[rows, rows] = covariance
        W[rows, rows] = graph.weights[k] * np.eye(3)
    estimator = np.linalg.solve(B.T @ W @ B, B.T @ W)
    scalar = np.trace(estimator @ C @ estimator.T)
    full = np.trace(np.linalg.inv(B.T @ np.linalg.solve(C, B)))
    return np.array([scalar, full])


def colmap(runs: int) -> None:
    """What the inliers of COLMAP's pairs tell beyond their number."""
    print("| images, points, track, noise [pixels] | mean error [deg]: inliers, covariances "
          "| loss auto: inliers, covariances | squared errors | read, CPU s |")  # fmt: skip
    print("|---|---|---|---|---|")
    for frames, points, track, noise in (
        (8, 300, -1, 0.5), (8, 300, -1, 1.5), (20, 800, 4, 1.0), (20, 1500, 5, 0.5)
    ):  # fmt: skip
        rows = []
        for seed in range(runs):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "pairs.db"
                truth = colmap_pairs.dataset(
                    path, seed, noise, num_frames_per_rig=frames, num_points3D=points,
                    track_length=track,
                )  # fmt: skip
                began = time.thread_time()
                rotavg.read(path)
                plain = time.thread_time()
                graph = rotavg.read(path, covariances=True)
                read = [plain - began, time.thread_time() - plain]
            R = colmap_pairs.true_rotations(truth, graph.nodes.tolist())
            errors = [
                rotavg.compare(
                    rotavg.solve(graph, loss=loss, anisotropic=full).rotations, R
                ).angles.mean()
                for loss in ("l2", "auto")
                for full in (False, True)
            ]  # fmt: skip
            i, j = graph.indices.T
            left = np.swapaxes(np.swapaxes(R[i], 1, 2) @ R[j], 1, 2) @ graph.rotations
            e = np.stack([left[:, 2, 1], left[:, 0, 2], left[:, 1, 0]], axis=1)
            assert graph.covariances is not None
            squares = np.einsum("ka,kab,kb->k", e, np.linalg.inv(graph.covariances), e)
            rows.append([*np.degrees(errors), squares.mean(), *read])
        mean = np.mean(rows, axis=0)
        print(f"| {frames}, {points}, {track}, {noise} | {mean[0]:.4f}, {mean[1]:.4f} "
              f"| {mean[2]:.4f}, {mean[3]:.4f} | {mean[4]:.2f} (theory 3) "
              f"| {mean[5]:.3f}, {mean[6]:.3f} |", flush=True)  # fmt: skip


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
