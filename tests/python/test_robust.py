"""Robust losses from Python: accuracy, verdicts, reports, options."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.report.verdict import statement
from rotavg.solving.contamination import contamination
from rotavg.solving.robust import Loss
from shared_data import shared_data
from test_cli import run

LOSSES = ("auto", "huber", "l1", "l_half", "cauchy", "geman_mcclure", "tls")


def photographs(**settings: object) -> rotavg.Simulation:
    options = {"noise": 0.03, "outliers": 0.3, "density": 0.3, "seed": 5, **settings}
    return rotavg.simulate("erdos_renyi", 80, **options)  # type: ignore[arg-type]


def mean_error(solution: rotavg.Solution, truth: np.ndarray) -> float:
    return rotavg.compare(solution.rotations, truth).mean


@pytest.mark.parametrize("loss", LOSSES)
def test_a_robust_loss_sees_through_outliers(loss: str) -> None:
    simulation = photographs()
    plain = rotavg.solve(simulation.graph)
    robust = rotavg.solve(simulation.graph, loss=loss)  # type: ignore[arg-type]
    assert mean_error(robust, simulation.ground_truth) < 0.03
    assert mean_error(robust, simulation.ground_truth) < 0.3 * mean_error(
        plain, simulation.ground_truth
    )
    assert robust.solved
    assert robust.robust is not None
    assert robust.robust.noise == pytest.approx(0.03, rel=0.25)
    # The residual works on chords, which are angles to a per cent here.
    found = robust.is_outlier
    assert np.mean(found[simulation.is_outlier]) > 0.98
    assert np.mean(found[~simulation.is_outlier]) < 0.03


def test_what_is_certified_is_the_problem_with_the_final_weights() -> None:
    simulation = photographs()
    solution = rotavg.solve(simulation.graph, loss="geman_mcclure")
    weighted = simulation.graph.with_weights(solution.edge_weights)
    assert rotavg.objective(weighted, solution.rotations) == pytest.approx(solution.objective)
    certificate = rotavg.certify(weighted, solution.rotations)
    assert certificate.verdict == "proved"
    assert "proved globally optimal of the least squares on the edges it kept" in str(solution)


def test_the_weights_are_the_derivative_of_the_loss_at_the_residuals() -> None:
    simulation = photographs()
    scale = 0.05
    solution = rotavg.solve(simulation.graph, loss="cauchy", loss_scale=scale)
    assert solution.robust is not None
    assert solution.robust.scale == scale
    r = 2 * np.sin(solution.residual_angles / 2)
    # The rotations have moved a little since the weights were computed.
    np.testing.assert_allclose(
        solution.edge_weights, np.maximum(1 / (1 + (r / scale) ** 2), 1e-6), rtol=0.02
    )
    rho = scale**2 * np.log1p((r / scale) ** 2)
    floor = 1e-6 * np.sum(r**2 - rho)
    assert solution.robust.objective == pytest.approx(2 * (rho.sum() + floor), rel=1e-9)


def test_the_trace_is_that_of_the_robust_objective_and_never_rises() -> None:
    solution = rotavg.solve(photographs(outliers=0.5).graph, loss="l_half")
    objective = solution.trace.objective
    assert len(objective) > 3
    assert (np.diff(objective) <= 1e-12 * objective[:-1]).all()
    assert solution.robust is not None
    assert solution.robust.objective <= objective[-1] * (1 + 1e-9)


def test_l2_is_as_it_was_and_names_no_outliers() -> None:
    simulation = photographs()
    solution = rotavg.solve(simulation.graph)
    assert solution.robust is None
    assert not solution.is_outlier.any()
    assert set(solution.edge_verdicts) <= {"inlier", "bridge"}
    assert (solution.edge_weights == simulation.graph.weights).all()


def test_given_weights_count() -> None:
    simulation = photographs(outliers=0.0)
    weights = np.random.default_rng(0).uniform(0.5, 2.0, simulation.graph.num_edges)
    graph = simulation.graph.with_weights(weights)
    solution = rotavg.solve(graph, loss="tls", loss_scale=1.0)
    plain = rotavg.solve(graph)
    np.testing.assert_allclose(solution.edge_weights, weights, rtol=1e-12)
    assert solution.objective == pytest.approx(plain.objective, rel=1e-9)


def test_components_names_and_nodes_without_edges() -> None:
    first, second = photographs(seed=1).graph, photographs(seed=2).graph
    edges = np.concatenate([first.edges, second.edges + 100])
    names = np.array([f"image {k}.jpg" for k in range(200)])
    graph = rotavg.MeasurementGraph(
        names[edges], np.concatenate([first.rotations, second.rotations]), nodes=names[:190]
    )
    solution = rotavg.solve(graph, loss="auto")
    assert solution.solved
    assert solution.num_components == 2 + 20 + 10
    assert solution.robust is not None
    assert solution.robust.num_parts >= solution.num_components
    assert np.isfinite(solution.rotations).all()


@pytest.mark.parametrize("loss", LOSSES)
def test_one_edge_and_a_noiseless_cycle(loss: str) -> None:
    single = rotavg.MeasurementGraph.from_rotvecs([("a", "b")], [[0.1, 0.2, 0.3]])
    solution = rotavg.solve(single, loss=loss)  # type: ignore[arg-type]
    assert solution.solved
    assert solution.edge_verdicts.tolist() == ["bridge"]
    cycle = rotavg.simulate("cycle", 7, seed=1).graph
    solution = rotavg.solve(cycle, loss=loss)  # type: ignore[arg-type]
    assert solution.solved
    assert solution.residual_angles.max() < 1e-9
    assert not solution.is_outlier.any()


def test_the_same_bits_again_and_for_any_number_of_threads() -> None:
    graph = photographs(density=0.8).graph
    one = rotavg.solve(graph, loss="auto", num_threads=1)
    two = rotavg.solve(graph, loss="auto", num_threads=2)
    assert (one.rotations == two.rotations).all()
    assert (one.edge_weights == two.edge_weights).all()


def test_a_start_is_used() -> None:
    simulation = photographs()
    first = rotavg.solve(simulation.graph, loss="auto")
    again = rotavg.solve(simulation.graph, loss="auto", init=first.rotations)
    assert again.init == "given"
    assert rotavg.compare(again.rotations, first.rotations).angles.max() < 0.01


def test_bad_options_are_refused() -> None:
    graph = photographs().graph
    with pytest.raises(rotavg.OptionError, match="unknown loss 'l3'; expected one of: l2, huber"):
        rotavg.solve(graph, loss="l3")  # type: ignore[arg-type]
    for scale in (0.0, -1.0, np.nan, np.inf, 4.0, "wide", None):
        with pytest.raises(rotavg.OptionError, match="loss_scale is"):
            rotavg.solve(graph, loss="auto", loss_scale=scale)  # type: ignore[arg-type]
    with pytest.raises(rotavg.OptionError, match="cycle_threshold is -1"):
        rotavg.solve(graph, cycle_threshold=-1)
    with pytest.raises(rotavg.OptionError, match="threshold is nan"):
        rotavg.cycle_evidence(graph, np.nan)


@pytest.mark.parametrize("seed", [1, 3])
def test_six_right_edges_of_twenty_at_a_node_are_enough(seed: int) -> None:
    # Reweighting alone from least squares ends 20 and 60 degrees off.
    simulation = rotavg.simulate(
        "erdos_renyi", 2000, density=20 / 1999, noise=np.radians(5), outliers=0.7, seed=seed
    )
    solution = rotavg.solve(simulation.graph, loss="auto", certify=False)
    best = rotavg.solve(simulation.graph, loss="auto", certify=False, init=simulation.ground_truth)
    assert mean_error(solution, simulation.ground_truth) < 1.25 * mean_error(
        best, simulation.ground_truth
    )
    assert solution.robust is not None
    assert solution.robust.noise == pytest.approx(np.radians(5), rel=0.3)


@pytest.mark.parametrize("loss", ["l1", "cauchy"])
@pytest.mark.parametrize("seed", [18, 40, 72, 106])
def test_with_few_edges_a_node_the_answer_is_no_worse_than_from_the_chordal_start(
    loss: Loss, seed: int
) -> None:
    # From least squares alone, l1 ends 5 to 10 % above.
    rng = np.random.default_rng(seed)
    ring = [(k, (k + 1) % 40) for k in range(40)]
    chords = [rng.choice(40, 2, replace=False).tolist() for _ in range(40)]
    edges = np.array(ring + chords)
    truth = matrices_from_rotvecs(rng.normal(0, 2, (40, 3)))
    noise = matrices_from_rotvecs(rng.normal(0, 0.0175, (80, 3)))
    measured = truth[edges[:, 0]].transpose(0, 2, 1) @ truth[edges[:, 1]] @ noise
    wrong = rng.random(80) < 0.2
    measured[wrong] = matrices_from_rotvecs(rng.normal(0, 2, (wrong.sum(), 3)))
    graph = rotavg.MeasurementGraph(edges, measured)
    found, chordal = (
        rotavg.solve(graph, loss=loss, loss_scale=0.02, certify=False, init=init).robust
        for init in ("auto", "chordal")
    )
    assert found is not None
    assert chordal is not None
    assert found.objective < 1.01 * chordal.objective


@pytest.mark.parametrize("loss", LOSSES)
def test_every_loss_converges_where_the_data_hardly_agree(loss: str) -> None:
    simulation = rotavg.simulate(
        "erdos_renyi", 500, density=20 / 499, noise=0.035, outliers=0.7, outlier_clusters=10, seed=1
    )
    solution = rotavg.solve(simulation.graph, loss=loss, certify=False)  # type: ignore[arg-type]
    assert solution.solved
    assert len(solution.trace) < 200  # the limit is 500
    assert np.degrees(mean_error(solution, simulation.ground_truth)) < 45


def test_limits_are_told() -> None:
    graph = photographs().graph
    stopped = rotavg.solve(graph, loss="auto", callback=lambda p: p.iteration < 5)
    assert stopped.status is rotavg.Status.STOPPED
    limited = rotavg.solve(graph, loss="auto", max_iterations=3)
    assert limited.status is rotavg.Status.ITERATION_LIMIT
    assert limited.iterations <= 3


def test_cycle_evidence_by_brute_force() -> None:
    simulation = rotavg.simulate("erdos_renyi", 25, density=0.5, noise=0.05, outliers=0.2, seed=3)
    graph, limit = simulation.graph, 0.2
    m = graph.num_edges
    by_ends = {}
    for (i, j), R in zip(graph.indices.tolist(), graph.rotations):
        by_ends[i, j], by_ends[j, i] = R, R.T
    evidence = rotavg.cycle_evidence(graph, limit)
    for k in range(m):
        i, j = graph.indices[k].tolist()
        angles = []
        for v in range(25):
            if (i, v) in by_ends and (v, j) in by_ends:
                around = by_ends[i, v] @ by_ends[v, j] @ by_ends[j, i]
                angles.append(np.arccos(np.clip((np.trace(around) - 1) / 2, -1, 1)))
        if len(angles) <= 8:  # all of them are looked at
            assert evidence.checked[k] == len(angles)
            assert evidence.agreeing[k] == sum(angle <= limit for angle in angles)
    good = ~simulation.is_outlier
    assert evidence.share[good].mean() > 2 * evidence.share[~good].mean()
    assert not evidence.refuted[good].any()


def test_advice_where_residuals_look_contaminated_and_only_there() -> None:
    simulation = photographs()
    assert "--loss auto" in str(rotavg.solve(simulation.graph))
    assert "outliers?" not in str(rotavg.solve(photographs(outliers=0.0).graph))
    assert "outliers?" not in str(rotavg.solve(simulation.graph, loss="auto"))
    rng = np.random.default_rng(0)
    isotropic = np.linalg.norm(rng.normal(0, 0.1, (2000, 3)), axis=1)
    assert contamination(isotropic) is None
    assert contamination(np.abs(rng.normal(0, 0.1, 2000))) is None
    assert contamination(np.zeros(100)) is None
    assert contamination(np.array([])) is None
    isotropic[:100] = 1.0
    assert contamination(isotropic) is not None
    weights = np.ones(2000)
    weights[:100] = 0.01  # they are known to be bad
    assert contamination(isotropic, weights) is None


def test_noise_of_two_kinds_is_no_contamination() -> None:
    rng = np.random.default_rng(1)
    sigma = np.where(rng.random(4000) < 0.2, 1.7e-3, 5e-4)
    angles = sigma * np.linalg.norm(rng.normal(size=(4000, 3)), axis=1)
    noise = np.median(angles) / 0.6745
    assert np.mean(angles > 3 * noise) > 0.02
    assert contamination(angles) is None
    angles[:80] = np.abs(rng.uniform(0, np.pi, 80))  # 2 %, of any size
    assert contamination(angles) is not None


def test_coherent_outliers_are_those_of_clusters() -> None:
    simulation = photographs(outliers=0.4, outlier_clusters=4, noise=0.0)
    graph, truth = simulation.graph, simulation.ground_truth
    i, j = graph.indices.T
    turn = truth[i] @ graph.rotations @ np.swapaxes(truth[j], 1, 2)
    wrong = np.linalg.norm(turn - np.eye(3), axis=(1, 2)) > 1e-9
    assert (wrong == simulation.is_outlier).all()
    assert wrong.sum() == round(0.4 * graph.num_edges)
    # Six pairs of clusters, each in two directions.
    assert len(np.unique(np.round(turn[wrong], 6), axis=0)) == 12
    with pytest.raises(rotavg.GraphError, match="between clusters"):
        photographs(outliers=0.9, outlier_clusters=2)
    with pytest.raises(rotavg.GraphError, match="outlier_clusters is -1"):
        photographs(outlier_clusters=-1)


def ellis_island() -> tuple[rotavg.MeasurementGraph, np.ndarray, np.ndarray]:
    path = shared_data("ellis_island/ellis_island.npz")
    with np.load(path) as file:
        return rotavg.read(path), file["ground_truth"], file["has_ground_truth"]


def test_ellis_island_within_the_figures_that_were_aimed_at() -> None:
    graph, truth, known = ellis_island()
    solution = rotavg.solve(graph, loss="auto")
    error = rotavg.compare(solution.rotations[known], truth[known])
    assert np.degrees(error.median) <= 0.50
    assert np.degrees(error.mean) <= 2.85
    assert solution.solved
    plain = rotavg.solve(graph, certify=False)
    assert np.degrees(rotavg.compare(plain.rotations[known], truth[known]).mean) > 5


def test_madrid_metropolis_has_as_many_small_residuals_as_any_peer_found() -> None:
    path: Path = shared_data("1dsfm/Madrid_Metropolis/EGs.txt")
    table = np.loadtxt(path)
    graph = rotavg.MeasurementGraph(
        table[:, :2].astype(np.int64), table[:, 2:11].reshape(-1, 3, 3)
    ).largest_component()
    solution = rotavg.solve(graph, loss="auto")
    assert np.mean(np.degrees(solution.residual_angles) < 5) >= 0.4038


def test_the_programs_of_the_page_run(capsys: pytest.CaptureFixture[str]) -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "robust.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    for block in blocks:
        exec(block, {})
    assert "outliers" in capsys.readouterr().out
    assert blocks


def test_least_squares_distrust_no_edge_but_those_that_the_cycle_check_leaves_out() -> None:
    simulation = rotavg.simulate("erdos_renyi", 100, density=0.4, noise=0.03, outliers=0.3, seed=1)
    solution = rotavg.solve(simulation.graph, cycle_threshold=0.1)
    assert set(solution.edge_verdicts) == {"inlier", "cycle_check"}
    found = solution.is_outlier
    assert found[simulation.is_outlier].mean() > 0.9
    assert found[~simulation.is_outlier].mean() < 0.05


@pytest.mark.parametrize("noise", [0.0866, 0.12, 0.2])
@pytest.mark.parametrize(("n", "density"), [(16, 0.8), (30, 0.5)])
def test_much_noise_is_no_wrong_edge(n: int, density: float, noise: float) -> None:
    # A tree can always be met exactly; so little noise is none, where no cycle bears it out.
    for seed in range(4):
        simulated = rotavg.simulate("erdos_renyi", n, density=density, noise=noise, seed=seed)
        robust = rotavg.solve(simulated.graph, loss="auto")
        assert robust.robust is not None
        assert robust.robust.noise == pytest.approx(noise, rel=0.35)
        assert robust.is_outlier.mean() < 0.1
        plain = rotavg.solve(simulated.graph)
        truth = simulated.ground_truth
        assert rotavg.compare(robust, truth).rms < 1.2 * rotavg.compare(plain, truth).rms


def test_where_sweeps_have_no_end_newtons_steps_go_on() -> None:
    # So well connected that its Laplacian takes a thousand times as long as a sweep to factor.
    simulation = rotavg.simulate("erdos_renyi", 600, noise=0.02, outliers=0.3, density=0.05, seed=3)
    options: dict[str, Any] = {"loss": "l_half", "loss_scale": 1e-4, "certify": False}
    sweeps = rotavg.solve(simulation.graph, method="bcd", **options)
    found = rotavg.solve(simulation.graph, **options)
    assert found.robust is not None
    assert sweeps.robust is not None
    assert found.robust.objective <= sweeps.robust.objective * (1 + 1e-5)
    assert found.iterations < sweeps.iterations
    again = rotavg.solve(simulation.graph, num_threads=2, **options)
    assert again.rotations.tobytes() == found.rotations.tobytes()


@pytest.mark.parametrize("loss", ["huber", "l1", "l_half", "cauchy"])
def test_within_a_scale_that_was_given_no_edge_is_an_outlier(loss: Any) -> None:
    data = rotavg.simulate("erdos_renyi", 60, density=0.3, noise=1e-3, outliers=0.3, seed=2)
    solution = rotavg.solve(data.graph, loss=loss, loss_scale=0.1)
    assert solution.robust is not None
    assert solution.robust.threshold == 0.1
    half = solution.edge_weights >= 0.5
    assert np.count_nonzero(half) > 300
    assert not solution.is_outlier[half].any()
    noise = rotavg.solve(data.graph, loss=loss).robust
    assert noise is not None
    assert 3 * noise.noise <= noise.threshold <= 10 * noise.noise


def test_residuals_are_told_of_the_kept_edges(tmp_path: Path) -> None:
    graph = rotavg.simulate("erdos_renyi", 60, density=0.3, noise=0.02, outliers=0.4, seed=3).graph
    rotavg.write(tmp_path / "g.csv", graph)
    solution = rotavg.solve(graph, loss="auto")
    kept = np.degrees(solution.residual_angles[~solution.is_outlier])
    assert kept.max() < 6 < 90 < np.degrees(np.percentile(solution.residual_angles, 95))
    figures = f"median {np.median(kept):.3g} deg, 95 % below {np.percentile(kept, 95):.3g}, "
    assert f"{figures}largest {kept.max():.3g} (of the edges it kept)" in str(solution)
    done = run("solve", tmp_path / "g.csv", "--loss", "auto", "--json")
    told = json.loads(done.stdout)["residuals"]
    assert told["edges"] == len(kept)
    assert told["largest_deg"] == pytest.approx(kept.max(), rel=1e-6)
    assert told["median_deg"] == pytest.approx(np.median(kept), rel=1e-6)
    headline = statement(solution).headline
    assert headline.startswith("Proved, for the least squares on the edges it kept: no other")
    assert f"{solution.is_outlier.sum()} of {graph.num_edges} edges rejected" in headline
    assert "these measurements" not in headline
    plain = rotavg.solve(graph)
    assert "it kept" not in str(plain)
    assert statement(plain).headline == "Proved: no other rotations fit these measurements better."
    assert f"largest {np.degrees(plain.residual_angles.max()):.3g}" in str(plain)
