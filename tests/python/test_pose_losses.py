"""Wrong translations: whether they are told, and whether robust losses of poses resist them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import rotavg
from rotavg.cli.main import commands
from rotavg.solving.chi_noise import ChiNoise
from rotavg.solving.pose_losses import LEAST_SHARE, shares
from shared_data import shared_data
from test_positions import pose_graph

Floats = NDArray[np.float64]
ROBUST = ("huber", "cauchy", "geman_mcclure", "tls")
WRONG = 100  # of 4615 closures


def contaminated(graph: rotavg.MeasurementGraph, rows: Any, by: Floats) -> rotavg.MeasurementGraph:
    """The same graph with translations that are off."""
    measured = graph.translations
    assert measured is not None
    vectors = measured.vectors.copy()
    vectors[rows] += by
    moved = rotavg.RelativeTranslations(
        vectors, measured.information, cross=measured.cross, dimension=measured.dimension
    )
    return rotavg.MeasurementGraph(
        graph.edges, graph.rotations, graph.weights, graph.nodes,
        covariances=graph.covariances, translations=moved,
    )  # fmt: skip


def without(graph: rotavg.MeasurementGraph, rows: Any) -> rotavg.MeasurementGraph:
    """The same graph without some edges."""
    keep = np.ones(graph.num_edges, dtype=np.bool_)
    keep[rows] = False
    assert graph.translations is not None
    assert graph.covariances is not None
    return rotavg.MeasurementGraph(
        graph.edges[keep], graph.rotations[keep], graph.weights[keep], graph.nodes,
        covariances=graph.covariances[keep], translations=graph.translations.select(keep),
    )  # fmt: skip


@pytest.fixture(scope="module")
def garage() -> tuple[rotavg.MeasurementGraph, rotavg.MeasurementGraph, Any]:
    """parking-garage, the same with wrong translations, and the rows of these."""
    clean = rotavg.read(shared_data("g2o") / "parking-garage.g2o")
    rng = np.random.default_rng(1)
    closures = np.flatnonzero(np.abs(np.diff(clean.indices, axis=1)[:, 0]) > 1)
    rows = rng.choice(closures, WRONG, replace=False)
    return clean, contaminated(clean, rows, 30 * rng.normal(size=(WRONG, 3))), rows


def distances(a: Floats, b: Floats) -> Floats:
    return np.linalg.norm(a - b, axis=1)


def test_wrong_translations_of_a_real_graph_are_left_out(garage: Any) -> None:
    """The poses are then those of the graph without them, and those of the clean graph nearly."""
    clean, wrong, rows = garage
    solution = rotavg.solve(wrong)
    bent = rotavg.positions(wrong, solution.rotations)
    told = rotavg.translation_fit(wrong, solution.rotations, bent)
    assert told.num_beyond > 0
    assert told.advice is not None
    assert "--pose-loss tls" in told.advice
    expected = rotavg.refine_poses(rotavg.solve(without(clean, rows))).positions
    optimum = rotavg.refine_poses(rotavg.solve(clean)).positions
    assert np.median(distances(bent, optimum)) > 20
    poses = rotavg.refine_poses(solution, loss="tls")
    assert poses.is_outlier[rows].all()
    assert poses.is_outlier.sum() < 2 * WRONG
    assert np.median(distances(poses.positions, expected)) < 0.01
    assert np.median(distances(poses.positions, optimum)) < 0.5  # of 100, without good closures
    assert poses.translation_fit.num_beyond == 0
    for loss in ("cauchy", "geman_mcclure"):
        poses = rotavg.refine_poses(solution, loss=loss)  # type: ignore[arg-type]
        assert poses.is_outlier[rows].all()
        assert np.median(distances(poses.positions, optimum)) < 1


def test_a_robust_loss_of_the_rotations_does_no_harm_to_that_of_the_poses() -> None:
    """Where translations alone are wrong, both lead to the same poses."""
    clean = rotavg.read(shared_data("g2o") / "sphere2500.g2o")
    rng = np.random.default_rng(3)
    closures = np.flatnonzero(np.abs(np.diff(clean.indices, axis=1)[:, 0]) > 1)
    rows = rng.choice(closures, 250, replace=False)
    wrong = contaminated(clean, rows, rng.uniform(-50, 50, (250, 3)))
    plain = rotavg.refine_poses(rotavg.solve(wrong, certify=False), loss="tls")
    robust = rotavg.refine_poses(rotavg.solve(wrong, loss="auto", certify=False), loss="tls")
    for poses in (plain, robust):
        assert poses.status.converged
        assert poses.is_outlier[rows].mean() > 0.98  # what hangs by one alone is no outlier
        assert poses.is_outlier.sum() < 1.2 * len(rows)
        assert poses.translation_fit.advice is None
    assert robust.loss_scale == pytest.approx(plain.loss_scale, rel=0.2)
    assert np.median(distances(plain.positions, robust.positions)) < 0.05


def test_a_fifth_of_the_closures_may_be_wrong(garage: Any) -> None:
    clean, _, _ = garage
    rng = np.random.default_rng(1)
    closures = np.flatnonzero(np.abs(np.diff(clean.indices, axis=1)[:, 0]) > 1)
    rows = rng.choice(closures, 1000, replace=False)
    wrong = contaminated(clean, rows, 30 * rng.normal(size=(1000, 3)))
    poses = rotavg.refine_poses(rotavg.solve(wrong), loss="tls")
    is_wrong = np.isin(np.arange(clean.num_edges), rows)
    assert poses.is_outlier[is_wrong].all()
    assert poses.is_outlier[~is_wrong].sum() < 60


def test_gtsam_ends_at_the_same_poses_without_the_outliers(garage: Any) -> None:
    """From the clean optimum, Levenberg-Marquardt of GTSAM on the edges that were kept."""
    gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed: pip install rotavg[gtsam]")
    clean, wrong, _ = garage
    poses = rotavg.refine_poses(rotavg.solve(wrong), loss="tls")
    kept = without(wrong, poses.is_outlier)
    factors = rotavg.partners.to_gtsam(kept)
    start = rotavg.partners.to_gtsam(rotavg.refine_poses(rotavg.solve(clean)))
    first = int(wrong.nodes[0])
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)
    ours = rotavg.partners.to_gtsam(poses)
    factors.add(gtsam.PriorFactorPose3(first, ours.atPose3(first), tight))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-12)
    theirs = gtsam.LevenbergMarquardtOptimizer(factors, start, parameters).optimize()
    # The valley is flat: GTSAM stops a little above.
    assert factors.error(ours) <= (1 + 1e-9) * factors.error(theirs)
    assert factors.error(theirs) == pytest.approx(factors.error(ours), rel=1e-5)
    assert 2 * factors.error(ours) == pytest.approx(poses.chi2, rel=1e-6)
    moved = np.array([theirs.atPose3(int(node)).translation() for node in wrong.nodes])
    assert np.median(distances(moved, poses.positions)) < 0.5


@pytest.mark.parametrize("name", ["sphere2500", "torus3D", "parking-garage", "smallGrid3D"])
def test_clean_graphs_are_not_called_contaminated(name: str) -> None:
    graph = rotavg.read(shared_data("g2o") / f"{name}.g2o")
    solution = rotavg.solve(graph, certify=False)
    for loss in ("l2", "tls"):
        p = rotavg.positions(graph, solution.rotations, loss=loss)  # type: ignore[arg-type]
        fit = rotavg.translation_fit(graph, solution.rotations, p)
        assert fit.advice is None, loss


def test_clean_simulated_graphs_are_not_called_contaminated() -> None:
    for seed in range(30):
        print("seed", seed)
        graph, R, _ = pose_graph(40, seed=seed, noise=10.0 ** -(seed % 4), isotropic=seed % 2 == 0)
        fit = rotavg.translation_fit(graph, R, rotavg.positions(graph, R))
        assert fit.advice is None


@pytest.mark.parametrize("loss", ROBUST)
def test_positions_of_simulated_graphs_resist(loss: Any) -> None:
    graph, R, p = pose_graph(60, seed=5, noise=0.02, isotropic=True, parts=2)
    rng = np.random.default_rng(5)
    rows = rng.choice(graph.num_edges, graph.num_edges // 10, replace=False)
    wrong = contaminated(graph, rows, 20 * rng.normal(size=(len(rows), 3)))
    fixed = {0: p[0], 60: p[60]}
    plain = distances(rotavg.positions(wrong, R, fixed=fixed), p)
    robust = distances(rotavg.positions(wrong, R, fixed=fixed, loss=loss), p)
    clean = distances(rotavg.positions(graph, R, fixed=fixed), p)
    assert np.median(robust) < (0.5 if loss == "huber" else 0.1) * np.median(plain)
    if loss == "tls":
        assert np.median(robust) < 2 * np.median(clean)


def test_a_scale_is_in_units_of_the_information() -> None:
    """An edge that is off by so many standard deviations is left out below that, and kept above."""
    rng = np.random.default_rng(3)
    n, sigma = 30, 0.01
    edges = [(i, j) for i in range(n) for j in range(i + 1, n)]
    p = rng.normal(size=(n, 3))
    i, j = np.array(edges).T
    vectors = p[j] - p[i]
    vectors[7] += [20 * sigma, 0, 0]
    graph = rotavg.MeasurementGraph(
        edges,
        np.broadcast_to(np.eye(3), (len(edges), 3, 3)),
        translations=rotavg.RelativeTranslations(
            vectors, np.broadcast_to(np.eye(3) / sigma**2, (len(edges), 3, 3))
        ),
    )
    R = np.broadcast_to(np.eye(3), (n, 3, 3))
    off = distances(rotavg.positions(graph, R, fixed={0: p[0]}, loss="tls", loss_scale=15.0), p)
    assert off.max() < 1e-9
    kept = rotavg.positions(graph, R, loss="tls", loss_scale=25.0)
    np.testing.assert_allclose(kept, rotavg.positions(graph, R), atol=1e-12)
    solution = rotavg.solve(graph)
    assert rotavg.refine_poses(solution, loss="tls", loss_scale=15.0).is_outlier.tolist() == [
        k == 7 for k in range(len(edges))
    ]
    assert not rotavg.refine_poses(solution, loss="tls", loss_scale=25.0).is_outlier.any()


def test_the_plane_and_what_is_fixed() -> None:
    rng = np.random.default_rng(4)
    n = 40
    angles, p = (
        rng.uniform(-3, 3, size=n),
        np.append(rng.normal(size=(n, 2)) * 5, np.zeros((n, 1)), 1),
    )
    R = np.zeros((n, 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = np.cos(angles)
    R[:, 1, 0] = np.sin(angles)
    R[:, 0, 1] = -R[:, 1, 0]
    R[:, 2, 2] = 1
    edges = np.array([(k, (k + step) % n) for step in (1, 2, 3) for k in range(n)])
    i, j = edges.T
    vectors = np.einsum("mba,mb->ma", R[i], p[j] - p[i])
    rows = rng.choice(len(edges), 8, replace=False)
    vectors[rows, :2] += rng.normal(size=(8, 2)) * 10
    graph = rotavg.MeasurementGraph(
        edges,
        np.swapaxes(R[i], 1, 2) @ R[j],
        translations=rotavg.RelativeTranslations(vectors, dimension=2),
    )
    poses = rotavg.refine_poses(
        rotavg.solve(graph), fixed={0: (R[0], p[0]), 20: (R[20], p[20])}, loss="tls"
    )
    assert sorted(np.flatnonzero(poses.is_outlier)) == sorted(rows)
    assert distances(poses.positions, p).max() < 1e-6
    assert "tls" in str(poses)


@pytest.mark.parametrize("loss", ROBUST)
def test_what_is_left_of_an_edge(loss: str) -> None:
    """The share is rho'(chi^2) of each loss, by differences of what the loss costs."""
    costs = {
        "huber": lambda u: u**2 if u <= 1 else 2 * u - 1,
        "cauchy": lambda u: np.log1p(u**2),
        "geman_mcclure": lambda u: u**2 / (1 + u**2),
        "tls": lambda u: min(u**2, 1.0),
    }
    for u in (0.1, 0.5, 0.9, 1.1, 3.0, 20.0):
        step = 1e-6 * u
        slope = (costs[loss](u + step) - costs[loss](u - step)) / (2 * step) / (2 * u)
        found = shares(loss, np.array([7 * u]), 7.0)[0]
        assert found == pytest.approx(max(slope, LEAST_SHARE), rel=1e-6)


def test_how_much_of_the_noise_is_left() -> None:
    """Redundancies against the diagonal of the dense hat matrix; series count once."""
    graph, _, _ = pose_graph(15, seed=6, isotropic=True)
    assert graph.translations is not None
    weights = graph.translations.information[:, 0, 0]
    A = np.zeros((graph.num_edges, 15))
    A[np.arange(graph.num_edges), graph.indices[:, 1]] = 1
    A[np.arange(graph.num_edges), graph.indices[:, 0]] = -1
    A *= np.sqrt(weights)[:, None]
    hat = A[:, 1:] @ np.linalg.solve(A[:, 1:].T @ A[:, 1:], A[:, 1:].T)
    noise = ChiNoise(graph)
    left = np.sqrt(1 - np.diag(hat))
    checked = left > 1e-6
    found = noise.standardised(np.ones(graph.num_edges))
    np.testing.assert_allclose(found[checked], 1 / left[checked], rtol=1e-9)
    assert (found[~checked] == 0).all()
    ring = rotavg.MeasurementGraph(
        [(k, (k + 1) % 9) for k in range(9)],
        np.broadcast_to(np.eye(3), (9, 3, 3)),
        translations=rotavg.RelativeTranslations(np.ones((9, 3))),
    )
    assert ChiNoise(ring).num_series == 1
    np.testing.assert_allclose(ChiNoise(ring).of_series(np.ones(9)), 3.0)


def test_figures_of_the_fit() -> None:
    graph, R, _ = pose_graph(12, seed=8, noise=0.5)
    p = rotavg.positions(graph, R)
    kept = np.arange(graph.num_edges) % 5 > 0
    fit = rotavg.translation_fit(graph, R, p, kept=kept)
    assert graph.translations is not None
    for k, (i, j) in enumerate(graph.indices):
        r = graph.rotations[k].T @ (R[i].T @ (p[j] - p[i]) - graph.translations.vectors[k])
        assert fit.lengths[k] == pytest.approx(np.linalg.norm(r))
        assert fit.chi[k] ** 2 == pytest.approx(r @ graph.translations.information[k] @ r)
    summary = fit.summary()
    assert summary["edges"] == kept.sum()
    assert summary["median"] == np.median(fit.lengths[kept])
    assert summary["chi2"] == pytest.approx((fit.chi[kept] ** 2).sum())
    assert summary["largest_chi"] == fit.chi[kept].max()
    assert f"{fit.lengths[kept].max():.3g}" in str(fit)


def test_rejected_rotations_have_no_say_in_positions() -> None:
    """After a robust loss of the rotations, what is written is without the edges it rejected."""
    graph, _, p = pose_graph(40, seed=9, isotropic=True)
    rows = np.array([3, 17])
    turned = graph.rotations.copy()
    turned[rows] = turned[rows] @ rotavg.simulate("cycle", 3, seed=1).ground_truth[1]
    wrong = contaminated(graph, rows, np.full((2, 3), 50.0))
    wrong = rotavg.MeasurementGraph(graph.edges, turned, translations=wrong.translations)
    solution = rotavg.solve(wrong, loss="tls", loss_scale=0.01)
    assert np.flatnonzero(solution.is_outlier).tolist() == rows.tolist()
    found = rotavg.positions(wrong, solution.rotations, edge_shares=solution.edge_shares)
    i, j = 0, 30
    assert np.linalg.norm(found[i] - found[j]) == pytest.approx(np.linalg.norm(p[i] - p[j]), 1e-4)


def test_bad_options_are_refused() -> None:
    graph, R, _ = pose_graph(10, seed=10)
    for given, said in (
        ({"loss": "l1"}, "pose loss is 'l1'"),
        ({"loss": "tls", "loss_scale": "big"}, "'auto' or a number"),
        ({"loss": "tls", "loss_scale": 0.0}, "positive"),
        ({"loss": "tls", "loss_scale": -1.0}, "not negative"),
        ({"loss": "tls", "loss_scale": float("nan")}, "not negative"),
    ):
        with pytest.raises(rotavg.OptionError, match=said):
            rotavg.positions(graph, R, **given)  # type: ignore[arg-type]
        with pytest.raises(rotavg.OptionError, match=said):
            rotavg.refine_poses(rotavg.solve(graph), **given)  # type: ignore[arg-type]
    with pytest.raises(rotavg.GraphError, match=r"edge_shares of edge 2 is 1\.5"):
        rotavg.positions(graph, R, edge_shares=np.r_[1, 0, 1.5, np.ones(graph.num_edges - 3)])
    with pytest.raises(rotavg.GraphError, match="kept has shape"):
        rotavg.translation_fit(graph, R, np.zeros((10, 3)), kept=np.ones(3, dtype=bool))


def run(*arguments: Any) -> Any:
    return CliRunner().invoke(commands, [str(a) for a in arguments], standalone_mode=False)


def test_the_command_says_how_well_translations_fit(tmp_path: Path, garage: Any) -> None:
    _, wrong, rows = garage
    source, out = tmp_path / "wrong.g2o", tmp_path / "out.g2o"
    rotavg.write(source, wrong)
    printed = run("solve", source, "-o", out).stdout
    assert "translations are missed by" in printed
    assert "so some translations are wrong" in printed
    told = json.loads(run("solve", source, "-o", out, "--json").stdout)["translations"]
    assert told["beyond"] > 0
    assert told["largest"] > 10
    robust = json.loads(
        run("solve", source, "-o", out, "--json", "--refine-poses", "--pose-loss", "tls").stdout
    )
    assert robust["poses"]["outliers"] >= len(rows)
    assert robust["translations"]["advice"] is None
    assert robust["translations"]["edges"] == wrong.num_edges - robust["poses"]["outliers"]
    # Files without positions are written without a word of them.
    assert (
        json.loads(run("solve", source, "-o", tmp_path / "out.csv", "--json").stdout)[
            "translations"
        ]
        is None
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--pose-loss", "tls"), "--pose-loss is for --refine-poses"),
        (("--refine-poses", "--pose-loss-scale", "3"), "--pose-loss-scale is for --pose-loss"),
        (("--refine-poses", "--pose-loss", "tls", "--pose-loss-scale", "x"), "neither 'auto' nor"),
        (("--refine-poses", "--pose-loss", "tls", "--pose-loss-scale", "-1"), "neither 'auto' nor"),
        (("--refine-poses", "--trust-odometry"), "--trust-odometry is for --loss or --pose-loss"),
    ],
)
def test_idle_options_are_refused(options: tuple[str, ...], said: str, tmp_path: Path) -> None:
    path = tmp_path / "in.g2o"
    rotavg.write(path, pose_graph(6, seed=11)[0])
    failed = run("solve", path, *options).exception
    assert isinstance(failed, click.ClickException)
    assert said in failed.message


def test_odometry_is_trusted_with_a_loss_of_the_poses_alone(tmp_path: Path) -> None:
    graph = pose_graph(40, seed=11)[0]
    steps = np.flatnonzero(np.abs(np.diff(graph.indices, axis=1)[:, 0]) == 1)
    path = tmp_path / "in.g2o"
    rotavg.write(path, contaminated(graph, steps[:1], np.array([50.0, 0, 0])))
    told = run("solve", path, "--refine-poses", "--pose-loss", "tls", "--trust-odometry").output
    solution = rotavg.solve(rotavg.read(path))
    trusting = rotavg.refine_poses(solution, loss="tls", trusted="odometry")
    assert (trusting.edge_shares[steps] == 1).all()
    assert str(trusting) in told
    assert str(rotavg.refine_poses(solution, loss="tls")) not in told
