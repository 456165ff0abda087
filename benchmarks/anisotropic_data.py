"""What full covariances bring on real data and databases: parts of `benchmarks.anisotropic`."""

from __future__ import annotations

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
from benchmarks.anisotropic_graphs import measured, random_rotations, rotation_vectors

DATA = Path(os.environ.get("ROTAVG_DATA", Path(__file__).parents[2] / "shared" / "data"))


def photographs() -> None:
    """Strecha's photographs with laser truth: with one weight for each edge, with covariances."""
    from rotavg import images

    focal = 1149.78  # pixels, of these reduced photographs
    print("| photographs | pairs, off by more than 5 deg | e C^-1 e, median | weights, loss "
          "| mean error [deg] | median | other answers, mean error |")  # fmt: skip
    print("|---|---|---|---|---|---|---|")
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
        errors = np.swapaxes(R[i] @ graph.rotations, 1, 2) @ R[j]
        e = rotation_vectors(errors)  # of most, which are small
        squares = np.einsum("ka,kab,kb->k", e, np.linalg.inv(graph.covariances), e)
        wrong = int((np.trace(errors, axis1=1, axis2=2) < 1 + 2 * np.cos(np.radians(5))).sum())
        traces = np.trace(graph.covariances, axis1=1, axis2=2)
        votes: dict[str, Any] = {"loss": "auto", "weight_kind": "frequency"}
        by_trace = graph.with_weights(3 / traces)
        for weights, one, options in (
            ("inliers, l2", graph, {}),
            ("inliers, auto", graph, {"loss": "auto"}),
            ("inliers, l1", graph, {"loss": "l1"}),
            ("inliers as frequency, auto", graph, votes),
            ("3 / tr C, l2", by_trace, {}),
            ("3 / tr C, auto", by_trace, {"loss": "auto"}),
            ("covariances, l2", graph, {"anisotropic": True}),
            ("covariances, auto", graph, {"anisotropic": True, "loss": "auto"}),
        ):
            solution = rotavg.solve(one, num_threads=1, **options)
            angles = np.degrees(rotavg.compare(solution.rotations, R).angles)
            stories = () if solution.robust is None else solution.robust.alternatives
            others = (np.degrees(rotavg.compare(s.rotations, R).angles).mean() for s in stories)
            print(f"| {name} | {graph.num_edges}, {wrong} | {np.median(squares):.3g} "
                  f"| {weights} | {angles.mean():.4f} | {np.median(angles):.4f} "
                  f"| {', '.join(f'{x:.2f}' for x in others)} |", flush=True)  # fmt: skip


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
    # Cubic lattices: of the size of SE-Sync's cubicle, and one whose Hessian is costly to factor.
    mild, strong = (1.0, 2.0, 2.9), (1.0, 3.0, 10.0)
    for n, ratio in ((18**3, mild), (18**3, strong), (27**3, mild)):
        lattice = rotavg.simulate("grid", n, seed=1).graph.edges
        graph, _ = measured(np.random.default_rng(1), lattice, n, ratio, 0.05)
        plain, _ = cpu(graph, runs)
        full, solution = cpu(graph, runs, anisotropic=True)
        name = f"lattice of {n}, " + ":".join(f"{x:g}" for x in ratio)
        _print_row(name, plain, full, solution.certificate)


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
