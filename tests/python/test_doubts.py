"""What is told where noise, priors or rigs are as if they were read wrongly, and where not."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import rotavg
from rotavg.cli.main import commands
from rotavg.evaluation.paired import is_better_on_average, is_clearly_better
from rotavg.evaluation.readings import other_reading
from rotavg.evaluation.separate_cycles import separate_cycles
from rotavg.graph.conventions import (
    matrices_from_angles_about_z,
    matrices_from_quaternions,
    matrices_from_rotvecs,
    quaternions_from_matrices,
)
from shared_data import shared_data

Array = NDArray[np.float64]


def run(*arguments: Any) -> tuple[str, str]:
    result = CliRunner().invoke(commands, [str(a) for a in arguments])
    assert result.exit_code in (0, 1), result.output + repr(result.exception)
    return result.stdout, result.stderr


def w_first(R: Array) -> Array:
    """What comes of quaternions wxyz that are read as xyzw."""
    return matrices_from_quaternions(quaternions_from_matrices(R)[:, [3, 0, 1, 2]])


def other_ways(R: Array) -> Iterator[tuple[Array, tuple[bool, bool]]]:
    """Rotations as they are wrongly read, and what mends it."""
    yield np.swapaxes(R, 1, 2), (True, False)
    yield w_first(R), (False, True)
    yield w_first(np.swapaxes(R, 1, 2)), (True, True)


def test_separate_cycles_share_no_edge_and_their_errors_are_those_of_the_products() -> None:
    graph = rotavg.simulate("erdos_renyi", 40, density=0.2, noise=0.1, seed=1).graph
    cycles = separate_cycles(graph.indices)
    used = np.concatenate([rows.ravel() for rows in cycles.edges])
    assert len(np.unique(used)) == len(used) > 60
    R, ends = np.asarray(graph.rotations), graph.indices
    expected = []
    for rows, along in zip(cycles.edges, cycles.along):
        for cycle, forward in zip(rows, along):
            at = start = ends[cycle[0], 0 if forward[0] else 1]
            around = np.eye(3)
            for row, ahead in zip(cycle, forward):
                assert ends[row, 0 if ahead else 1] == at
                at = ends[row, 1 if ahead else 0]
                around = around @ (R[row] if ahead else R[row].T)
            assert at == start
            expected.append(np.arccos(np.clip((np.trace(around) - 1) / 2, -1, 1)))
    np.testing.assert_allclose(cycles.errors(R), expected, atol=1e-7)
    assert cycles.lengths.tolist() == sorted(cycles.lengths.tolist())


# (kind, nodes, noise in radians, share of outliers, whether the wrong reading is to be told)
NOISY = [
    ("complete", 60, 0.3, 0.0, True),
    ("complete", 60, 0.3, 0.2, True),
    ("complete", 60, 0.1, 0.5, True),
    ("erdos_renyi", 300, 0.3, 0.0, True),
    ("erdos_renyi", 300, 0.1, 0.5, True),
    ("band", 200, 0.3, 0.2, True),
    ("complete", 60, 0.3, 0.5, False),  # now and then
    ("complete", 12, 0.3, 0.5, False),
    ("erdos_renyi", 60, 0.3, 0.2, False),
    ("grid", 400, 0.3, 0.0, False),  # its cycles close alike in all readings
    ("sphere", 500, 0.3, 0.0, False),
    ("cycle", 50, 0.3, 0.0, False),
]


@pytest.mark.parametrize(("kind", "n", "noise", "outliers", "told"), NOISY)
def test_a_wrong_reading_is_told_on_noisy_data_and_the_right_one_never(
    kind: str, n: int, noise: float, outliers: float, told: bool
) -> None:
    for seed in range(6):
        graph = rotavg.simulate(kind, n, noise=noise, outliers=outliers, seed=seed).graph
        R = np.asarray(graph.rotations)
        assert other_reading(graph) is None, (kind, seed)
        for wrong, mends in other_ways(R) if told else ():
            found = other_reading(rotavg.MeasurementGraph(graph.edges, wrong))
            assert found is not None, (kind, seed, mends)
            assert (found.other_family, found.w_first) == mends
            assert found.noise < found.noise_as_read
            if found.cycles:
                assert found.cycles / 2 < found.better <= found.cycles
                assert f"{found.better} of {found.cycles} cycles" in found.finding


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_said_where_both_readings_are_alike(seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = [(i, j) for i in range(40) for j in range(i)]
    heading = rng.uniform(-3, 3, 40)
    about_z = np.array([[heading[j] - heading[i]] for i, j in edges])
    for noise in (0.0, 0.05, 0.5):
        R = matrices_from_angles_about_z(about_z + noise * rng.normal(size=about_z.shape))
        assert other_reading(rotavg.MeasurementGraph(edges, R)) is None
        transposed = rotavg.MeasurementGraph(edges, np.swapaxes(R, 1, 2))
        assert other_reading(transposed, w_first=False) is None
    half_turns = np.array([np.pi * np.eye(3)[k] for k in rng.integers(3, size=40)])
    X = matrices_from_rotvecs(half_turns)  # so are all R_ij, each its own inverse
    R = np.array([X[i].T @ X[j] for i, j in edges])
    R = R @ matrices_from_rotvecs(0.1 * rng.normal(size=(len(edges), 3)))
    assert other_reading(rotavg.MeasurementGraph(edges, R), w_first=False) is None
    coherent = rotavg.simulate(
        "complete", 60, noise=0.05, outliers=0.5, outlier_clusters=4, seed=seed
    )
    assert other_reading(coherent.graph) is None


def test_chance_is_not_taken_for_a_better_reading() -> None:
    rng = np.random.default_rng(0)
    for size in (3, 10, 20, 50, 1000):
        for _ in range(300):
            read, other = rng.uniform(0.5, 3.0, (2, size))
            assert not is_better_on_average(read, other)
            assert not is_clearly_better(read, other)
    read = rng.uniform(0.5, 3.0, 400)
    assert is_better_on_average(read, read * rng.uniform(0.5, 1.2, 400))
    assert not is_better_on_average(read * rng.uniform(0.5, 1.2, 400), read)
    assert not is_clearly_better(np.full(50, 0.004), np.zeros(50))  # all of it is small


def test_no_false_hint_on_real_graphs() -> None:
    data = shared_data(".")
    graphs = {path.name: rotavg.read(path) for path in sorted(data.glob("g2o/*.g2o"))}
    graphs["toro"] = rotavg.read(data / "toro" / "sphere2500.txt")
    graphs["madrid"] = rotavg.read(data / "1dsfm" / "Madrid_Metropolis")
    for path in sorted(data.glob("relpose/*_relpose.txt")):
        graphs[path.name] = rotavg.read(path)
    for path in [data / "ellis_island/ellis_island.npz", *sorted(data.glob("viewgraphs/*.npz"))]:
        arrays = np.load(path)
        R = arrays["rotations" if "rotations" in arrays else "relative_rotations"]
        covariances = np.linalg.inv(arrays["precision"]) if "precision" in arrays else None
        if covariances is not None:
            covariances = (covariances + np.swapaxes(covariances, 1, 2)) / 2
        graph = rotavg.MeasurementGraph(arrays["edges"], R, covariances=covariances, tolerance=0.01)
        graphs[path.name] = graph
        truth, known = arrays["ground_truth"], arrays["has_ground_truth"].astype(bool)
        ids = [k for k in graph.nodes.tolist() if known[k]]
        assert rotavg.doubts(graph, rotavg.Priors(fixed={k: truth[k] for k in ids})) == ()
        found = rotavg.doubts(graph, rotavg.Priors(fixed={k: truth[k].T for k in ids}))
        assert len(found) == 1, path
        assert "are they camera_from_world?" in found[0]
    assert len(graphs) >= 10
    for name, graph in graphs.items():
        assert other_reading(graph) is None, name
        assert rotavg.doubts(graph) == (), name
    for name in ("madrid", "ellis_island.npz", "lu_sphinx.npz", "castle_p30.npz", "torus3D.g2o"):
        turned = np.swapaxes(graphs[name].rotations, 1, 2)
        found = other_reading(rotavg.MeasurementGraph(graphs[name].edges, turned))
        assert found is not None, name
        assert (found.other_family, found.w_first) == (True, False)


@pytest.mark.parametrize("kind", ["complete", "erdos_renyi", "sphere", "band"])
@pytest.mark.parametrize(("noise", "outliers"), [(0.0, 0.0), (0.05, 0.0), (0.3, 0.0), (0.1, 0.5)])
def test_priors_as_they_are_and_reversed(kind: str, noise: float, outliers: float) -> None:
    n = 100
    simulation = rotavg.simulate(kind, n, noise=noise, outliers=outliers, seed=3)
    graph, T = simulation.graph, np.asarray(simulation.ground_truth)
    gravity = {k: (T[k].T @ [0, 1, 0], 1.0) for k in range(n)}
    up = {k: (-d, w) for k, (d, w) in gravity.items()}
    for few in (0, 5, n):
        fixed = {k: T[k] for k in range(few)}
        assert rotavg.doubts(graph, rotavg.Priors(fixed=fixed, gravity=gravity)) == ()
        absolute = {k: (R, 3.0) for k, R in fixed.items()}
        assert rotavg.doubts(graph, rotavg.Priors(absolute=absolute, gravity=gravity)) == ()
    reversed_ = {k: R.T for k, R in fixed.items()}
    for what, priors in (
        ("fixed rotations", rotavg.Priors(fixed=reversed_)),
        ("absolute priors", rotavg.Priors(absolute={k: (R, 3.0) for k, R in reversed_.items()})),
    ):
        (found,) = rotavg.doubts(graph, priors)
        assert found.startswith(f"the {what} contradict the graph (median ")
        assert "and their inverses do not" in found
    if outliers == 0.0:
        (found,) = rotavg.doubts(graph, rotavg.Priors(fixed=fixed, gravity=up))
        assert "are these directions up? down is expected" in found
        other = rotavg.Priors(fixed=fixed, gravity=gravity, down=(0, 0, -1))
        (found,) = rotavg.doubts(graph, other)
        assert "from (0, 0, -1)" in found
        assert "is down another axis there?" in found


def rig_graph(noise: float, outliers: float, seed: int = 0) -> tuple[Any, Any, Array]:
    """A graph of 3 cameras in 30 frames, their images, and rig_from_sensor."""
    rng = np.random.default_rng(seed)
    C = matrices_from_rotvecs(rng.normal(size=(3, 3)))
    Q = matrices_from_rotvecs(rng.normal(size=(30, 3)))
    X = np.array([Q[f] @ C[s] for f in range(30) for s in range(3)])
    edges = [(i, j) for i in range(90) for j in range(i) if rng.random() < 0.1]
    R = np.array([X[i].T @ X[j] for i, j in edges])
    wrong = rng.random(len(edges)) < outliers
    size = np.where(wrong, 3.0, noise)[:, None]
    R = R @ matrices_from_rotvecs(size * rng.normal(size=(len(edges), 3)))
    return rotavg.MeasurementGraph(edges, R), {k: divmod(k, 3) for k in range(90)}, C


@pytest.mark.parametrize(("noise", "outliers"), [(0.0, 0.0), (0.02, 0.0), (0.2, 0.0), (0.05, 0.3)])
def test_calibrated_sensors_as_they_are_and_reversed(noise: float, outliers: float) -> None:
    graph, images, C = rig_graph(noise, outliers)
    known = dict(enumerate(C))
    inverse = {s: R.T for s, R in known.items()}
    for rotations, told in ((known, 0), ({}, 0), (inverse, 1), ({0: C[0], 1: C[1]}, 0)):
        as_sensors = rotavg.Rigs(images, rotations)
        as_cameras = {k: (f, rotations[s]) for k, (f, s) in images.items() if s in rotations}
        for rigs in (as_sensors, as_cameras):
            found = rotavg.doubts(graph, rotavg.Priors(rigs=rigs))
            assert len(found) == told, found
            for sentence in found:
                assert "the calibrated sensors contradict the graph" in sentence
                assert "rig_from_sensor is expected, are they sensor_from_rig?" in sentence
    same = {s: np.eye(3) for s in known}  # its own inverse
    assert rotavg.doubts(graph, rotavg.Priors(rigs=rotavg.Rigs(images, same))) == ()


def test_covariances_in_degrees() -> None:
    for noise in (0.002, 0.02, 0.2):
        graph = rotavg.simulate("complete", 30, noise=noise, seed=2).graph
        variance = noise**2 / 3 * np.eye(3)
        for factor, told in ((1.0, False), (4.0, False), (57.2958**2, True), (0.01, False)):
            covariances = np.tile(factor * variance, (graph.num_edges, 1, 1))
            found = rotavg.doubts(
                rotavg.MeasurementGraph(graph.edges, graph.rotations, covariances=covariances)
            )
            assert len(found) == told, (noise, factor, found)
            forest = rotavg.MeasurementGraph(
                graph.edges[:5], graph.rotations[:5], covariances=covariances[:5]
            )
            beyond = np.sqrt(3 * covariances[0, 0, 0]) > np.pi
            assert len(rotavg.doubts(forest)) == beyond
            if told:
                assert "are they degrees^2? radians^2 are expected" in found[0]


def test_the_command_tells_it(tmp_path: Path) -> None:
    simulation = rotavg.simulate("erdos_renyi", 40, noise=0.02, seed=5)
    graph, T = simulation.graph, np.asarray(simulation.ground_truth)
    rotavg.write(tmp_path / "graph.csv", graph)
    q = quaternions_from_matrices(np.swapaxes(T, 1, 2))
    rows = [f"{k},{','.join(map(repr, row))}" for k, row in enumerate(q[:25].tolist())]
    (tmp_path / "fixed.csv").write_text("\n".join(["id,qx,qy,qz,qw", *rows]) + "\n")
    arguments = ("solve", tmp_path / "graph.csv", "--fixed", tmp_path / "fixed.csv")
    out, told = run(*arguments)
    assert "note: the fixed rotations contradict the graph" in told
    assert "contradict" not in out
    assert any("contradict" in note for note in json.loads(run(*arguments, "--json")[0])["notes"])
    assert "contradict" not in run(*arguments, "--fixed-convention", "vision")[1]
    refused = CliRunner().invoke(
        commands, ["solve", str(tmp_path / "graph.csv"), "--fixed-convention", "vision"]
    )
    assert refused.exit_code == 2
    assert "--fixed-convention is for --fixed" in refused.output
    spread = np.tile((np.degrees(0.02) ** 2 / 3) * np.eye(3), (graph.num_edges, 1, 1))
    wide = rotavg.MeasurementGraph(graph.edges, graph.rotations, covariances=spread)
    rotavg.write(tmp_path / "wide.csv", wide)
    assert "are they degrees^2?" in run("info", tmp_path / "wide.csv")[1]


def test_compare_tells_a_reference_in_the_other_family(tmp_path: Path) -> None:
    for noise, n in ((0.0, 6), (0.05, 40), (0.5, 100)):
        simulation = rotavg.simulate("complete", n, noise=noise, seed=6)
        solution = rotavg.solve(simulation.graph)
        truth = simulation.truth
        rotavg.write(tmp_path / "s.csv", solution)
        rotavg.write(tmp_path / "t.csv", truth)
        turned = rotavg.KnownRotations(truth.graph, np.swapaxes(truth.rotations, 1, 2))
        rotavg.write(tmp_path / "v.csv", turned)
        question = "is one of the two in the other family"
        assert question not in run("compare", tmp_path / "s.csv", tmp_path / "t.csv")[1]
        arguments = ("compare", tmp_path / "s.csv", tmp_path / "v.csv")
        assert question in run(*arguments)[1]
        assert question in json.loads(run(*arguments, "--json")[0])["notes"][0]
        assert question not in run(*arguments, "--reference-convention", "vision")[1]
