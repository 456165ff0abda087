"""GTSAM: Shonan averaging, initialisation of poses, LAGO, Karcher and Frobenius means."""

from __future__ import annotations

from typing import Any

import numpy as np

import rotavg
from rotavg.graph import se3
from rotavg.graph.conventions import matrices_from_quaternions, matrices_from_rotvecs
from tests.peers.suite import Floats, about, case, holds

GTSAM = ("gtsam",)
SCIPY = ("gtsam", "scipy")


def _shonan(name: str, dimension: int = 3) -> Any:
    import gtsam

    parameters = getattr(gtsam, f"ShonanAveragingParameters{dimension}")(
        gtsam.LevenbergMarquardtParams.CeresDefaults()
    )
    parameters.setKarcherWeight(0)
    file = gtsam.findExampleDataFile(name)
    return getattr(gtsam, f"ShonanAveraging{dimension}")(file, parameters)


def _graph(name: str) -> rotavg.MeasurementGraph:
    import gtsam

    return rotavg.read(gtsam.findExampleDataFile(name))


def _cost(shonan: Any, rotations: Floats) -> float:
    """GTSAM's own cost of our rotations."""
    import gtsam

    values = gtsam.Values()
    for k, R in enumerate(rotations):
        values.insert(k, gtsam.Rot3(R))
    return float(shonan.cost(values))


@case("GTSAM", "testShonanAveraging: tryOptimizingAt3, -At4, run, checkSubgraph", 1e-4, "", GTSAM)
def toy_example() -> float:
    shonan, graph = _shonan("toyExample.g2o"), _graph("toyExample.g2o")
    solutions = [rotavg.solve(graph, init="random", seed=seed) for seed in range(5)]
    assert all(s.certificate.verdict is rotavg.Verdict.PROVED for s in solutions)
    return max(_cost(shonan, s.rotations) for s in solutions)


@case("GTSAM", "testShonanAveraging: checkOptimality (random rotations are refuted)", 0, "", GTSAM)
def random_rotations_are_refuted() -> float:
    graph = _graph("toyExample.g2o")
    start = matrices_from_rotvecs(np.random.default_rng(42).normal(size=(5, 3)))
    return holds(rotavg.certify(graph, start).verdict is rotavg.Verdict.NOT_CERTIFIED)


@case("GTSAM", "testShonanAveraging: CheckWithEigen (lambda_min against dense)", 1e-11, "", GTSAM)
def smallest_eigenvalue() -> float:
    graph = _graph("toyExample.g2o")
    solution = rotavg.solve(graph.with_weights(np.ones(graph.num_edges)))
    n, R = graph.num_nodes, solution.rotations
    S = np.zeros((3 * n, 3 * n))
    for (i, j), Rij in zip(graph.indices.tolist(), graph.rotations):
        a, b = slice(3 * i, 3 * i + 3), slice(3 * j, 3 * j + 3)
        S[a, b] -= Rij
        S[b, a] -= Rij.T
        S[a, a] += Rij @ R[j].T @ R[i]
        S[b, b] += Rij.T @ R[i].T @ R[j]
    dense = float(np.linalg.eigvalsh((S + S.T) / 2)[0])
    return max(abs(dense), abs(solution.certificate.lambda_min))


def _klaus() -> Floats:
    """COLMAP's rotations of three photographs, as GTSAM's test prints them (w, x, y, z)."""
    wxyz = [
        [0.9992281076190063, -0.02676080288219576, -0.024497002638379624, -0.015064701622500615],
        [0.998239108728862, -0.049543805396343954, -0.03232420352077356, -0.004386230477751116],
        [0.9925378735259738, -0.07993768981394891, 0.0825062894866454, -0.04088089479075661],
    ]
    return matrices_from_quaternions(np.roll(wxyz, -1, axis=1))


@case("GTSAM", "testShonanAveraging: runKlaus, runKlausKarcher (cost)", 1e-2, "", GTSAM)
def klaus_cost() -> float:
    graph = _graph("Klaus3.g2o")
    costs = [
        _cost(_shonan("Klaus3.g2o"), rotavg.solve(graph, gauge=gauge).rotations)
        for gauge in ("first", "mean")
    ]
    return max(costs)


@case("GTSAM", "testShonanAveraging: runKlaus, runKlausKarcher (COLMAP agrees)", 0.1, "", GTSAM)
def klaus_agrees_with_colmap() -> float:
    given = _klaus()
    worst = 0.0
    for gauge in ("first", "mean"):
        R = rotavg.solve(_graph("Klaus3.g2o"), gauge=gauge).rotations
        turned = R[0] @ given[0].T @ given
        worst = max(worst, float(np.abs(se3.log_so3(np.swapaxes(turned, 1, 2) @ R)).max()))
    return worst


@case("GTSAM", "testShonanAveraging: PriorWeights (cost of I: 3.0756)", 1e-4, "", GTSAM)
def klaus_cost_of_the_identity() -> float:
    graph = _graph("Klaus3.g2o")
    ours = 0.5 * rotavg.objective(graph.with_weights(np.full(3, 25.0)), [np.eye(3)] * 3)
    return abs(ours - 3.0756)  # sigma is .2


@case("GTSAM", "testShonanAveraging: PriorWeights (optimum: .0015)", 1e-4, "", GTSAM)
def klaus_optimum() -> float:
    return abs(_cost(_shonan("Klaus3.g2o"), rotavg.solve(_graph("Klaus3.g2o")).rotations) - 0.0015)


@case("GTSAM", "testShonanAveraging, test_ShonanAveraging.py: noisyToyGraph", 1e-6, "", GTSAM)
def noisy_toy_graph() -> float:
    graph = _graph("noisyToyGraph.txt")
    solution = rotavg.solve(graph.with_weights(np.ones(graph.num_edges)))
    assert solution.certificate.verdict is rotavg.Verdict.PROVED
    # GTSAM's is half of |.|_F^2 of the 2 x 2 rotations, which is ours of 3 x 3.
    return abs(0.5 * solution.objective - 0.0008211)


@case("GTSAM", "testShonanAveraging: noisyToyGraphWithHuber", 1e-6, "", GTSAM)
def noisy_toy_graph_with_huber() -> float:
    graph = _graph("noisyToyGraph.txt")
    graph = graph.with_weights(np.ones(graph.num_edges))
    scale = 1.345  # GTSAM's, of whitened errors: nothing is beyond it
    R = rotavg.solve(graph, loss="huber", loss_scale=scale).rotations
    return abs(0.5 * rotavg.objective(graph, R) - 0.0008211)


@case("GTSAM", "testShonanAveraging: BinaryMeasurements; test_measurements3", 1e-4, "", GTSAM)
def binary_measurements() -> float:
    import gtsam

    from rotavg.partners import from_gtsam

    unit = gtsam.noiseModel.Unit.Create(3)
    turn = gtsam.Rot3.Yaw(np.pi / 2)
    given = [gtsam.BinaryMeasurementRot3(k, k + 1, turn, unit) for k in (0, 1)]
    return rotavg.solve(from_gtsam(given)).objective


@case("GTSAM", "test_ShonanAveraging.py: constructorBetweenFactorPose2s", 0.1, "deg", GTSAM)
def between_factors_in_the_plane() -> float:
    import gtsam

    from rotavg.partners import from_gtsam

    angles = [0.0, 90.0, 0.0]
    noise = gtsam.noiseModel.Unit.Create(3)
    given = []
    for i, j in ((0, 1), (1, 2), (0, 2)):
        turn = gtsam.Rot2.fromDegrees(angles[i] - angles[j])
        given.append(gtsam.BetweenFactorPose2(j, i, gtsam.Pose2(turn, [0, 0]), noise))
    R = rotavg.solve(from_gtsam(given)).rotations
    found = np.degrees(np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    return float(np.abs(found - angles).max())


def _simple() -> tuple[Any, Any, Floats, Floats]:
    """GTSAM, the factors of its simple graph of four poses, rotations and positions."""
    import gtsam

    R = np.array([about(2, k * np.pi / 2) for k in range(4)])
    p = np.array([[0.0, 0, 0], [1, 2, 0], [0, 2, 0], [-1, 1, 0]])
    poses = [gtsam.Pose3(gtsam.Rot3(R[k]), p[k]) for k in range(4)]
    factors = gtsam.NonlinearFactorGraph()
    unit = gtsam.noiseModel.Unit.Create(6)
    for i, j in ((0, 1), (1, 2), (2, 3), (2, 0), (0, 3)):
        factors.add(gtsam.BetweenFactorPose3(i, j, poses[i].between(poses[j]), unit))
    factors.add(gtsam.PriorFactorPose3(0, poses[0], unit))
    return gtsam, factors, R, p


def _pose_error(found: Any, R: Floats, p: Floats) -> float:
    gaps = se3.log_so3(np.swapaxes(R, 1, 2) @ found.rotations)
    return float(max(np.abs(gaps).max(), np.abs(found.positions - p).max()))


@case("GTSAM", "testInitializePose3: orientations; test_initialize_pose3.py", 1e-6, "rad", GTSAM)
def orientations() -> float:
    from rotavg.partners import from_gtsam, priors_from_gtsam

    _, factors, R, _ = _simple()
    found = rotavg.solve(from_gtsam(factors), priors=priors_from_gtsam(factors), init="chordal")
    return float(np.abs(se3.log_so3(np.swapaxes(R, 1, 2) @ found.rotations)).max())


@case("GTSAM", "testInitializePose3: orientationsPrecisions (no information)", 1e-6, "rad", GTSAM)
def orientations_without_information() -> float:
    from rotavg.partners import from_gtsam, priors_from_gtsam

    gtsam, factors, R, _ = _simple()
    chosen = [factors.at(k) for k in (0, 1, 2, 5)]
    nothing = gtsam.noiseModel.Isotropic.Precision(6, 0.0)
    for i, j, turn in ((2, 0, gtsam.Rot3.Ypr(0.1, 0, 0.1)), (0, 3, gtsam.Rot3.Ypr(0.5, -0.2, 0.2))):
        chosen.append(gtsam.BetweenFactorPose3(i, j, gtsam.Pose3(turn, [10, 20, 30]), nothing))
    graph = from_gtsam(chosen)
    assert graph.num_edges == 3
    found = rotavg.solve(graph, priors=priors_from_gtsam(chosen))
    return float(np.abs(se3.log_so3(np.swapaxes(R, 1, 2) @ found.rotations)).max())


@case("GTSAM", "testInitializePose3: posesWithGivenGuess", 1e-6, "", SCIPY)
def poses_with_given_guess() -> float:
    from rotavg.partners import from_gtsam, priors_from_gtsam

    _, factors, R, p = _simple()
    start = rotavg.solve(from_gtsam(factors), init=R, priors=priors_from_gtsam(factors))
    return _pose_error(rotavg.refine_poses(start), R, p)


@case("GTSAM", "testInitializePose3: initializePoses (pose3example-grid)", 0.1, "", SCIPY)
def poses_of_a_grid() -> float:
    import gtsam

    file = gtsam.findExampleDataFile("pose3example-grid.txt")
    _, given = gtsam.readG2o(file, True)
    graph = rotavg.read(file)
    R = np.array([given.atPose3(k).rotation().matrix() for k in graph.nodes.tolist()])
    p = np.array([given.atPose3(k).translation() for k in graph.nodes.tolist()])
    found = R[0] @ rotavg.solve(graph, init="chordal").rotations
    where = rotavg.positions(graph, found, fixed={0: p[0]})
    return float(max(np.abs(found - R).max(), np.abs(where - p).max()))


@case("GTSAM", "testInitializePose: computePoses3D (Klaus3)", 0.1, "", SCIPY)
def positions_of_klaus() -> float:
    import gtsam

    file = gtsam.findExampleDataFile("Klaus3.g2o")
    _, given = gtsam.readG2o(file, True)
    R = np.array([given.atPose3(k).rotation().matrix() for k in range(3)])
    p = np.array([given.atPose3(k).translation() for k in range(3)])
    found = rotavg.positions(rotavg.read(file), R, fixed={0: p[0]})
    return float(np.abs(found - p).max())


@case(
    "GTSAM",
    "testLago: smallGraph*, multiplePosePriors*, multiplePoseAndRotPriors*",
    1e-6,
    "",
    SCIPY,
)
def lago_small_graphs() -> float:
    from rotavg.partners import from_gtsam, priors_from_gtsam

    gtsam, _, R, p = _simple()
    plain = gtsam.NonlinearFactorGraph()
    unit = gtsam.noiseModel.Unit.Create(3)
    poses = [gtsam.Pose2(*p[k][:2], k * np.pi / 2) for k in range(4)]
    for i, j in ((0, 1), (1, 2), (2, 3), (2, 0), (0, 3)):
        plain.add(gtsam.BetweenFactorPose2(i, j, poses[i].between(poses[j]), unit))
    worst = 0.0
    one = gtsam.noiseModel.Unit.Create(1)
    for extra in (
        [gtsam.PriorFactorPose2(0, poses[0], unit)],
        [gtsam.PriorFactorPose2(k, poses[k], unit) for k in (0, 1)],
        [
            gtsam.PriorFactorPose2(0, poses[0], unit),
            gtsam.PriorFactorRot2(1, poses[1].rotation(), one),
        ],
    ):
        known = priors_from_gtsam(extra)
        found = rotavg.refine_poses(rotavg.solve(from_gtsam(plain), priors=known))
        worst = max(worst, _pose_error(found, R, p))
    return worst


@case(
    "GTSAM", "testLago: largeGraphNoisy_orientations (least squares of angles)", 1e-5, "rad", GTSAM
)
def lago_orientations() -> float:
    import gtsam

    graph = _graph("noisyToyGraph.txt")
    spread = np.tile(np.eye(3), (graph.num_edges, 1, 1))
    angles = rotavg.MeasurementGraph(graph.edges, graph.rotations, covariances=spread)
    R = rotavg.solve(angles, anisotropic=True).rotations
    _, given = gtsam.readG2o(gtsam.findExampleDataFile("orientationsNoisyToyGraph.txt"), False)
    truth = np.array([about(2, given.atPose2(k).theta()) for k in range(4)])
    return float(np.abs(se3.log_so3(np.swapaxes(truth, 1, 2) @ R)).max())


@case(
    "GTSAM", "testLago: largeGraphNoisy (within 1e-2 of the optimum); test_lago.py", 1e-2, "", SCIPY
)
def lago_optimum() -> float:
    import gtsam

    from rotavg.partners import to_gtsam

    found = to_gtsam(rotavg.refine_poses(rotavg.solve(_graph("noisyToyGraph.txt"))))
    _, given = gtsam.readG2o(gtsam.findExampleDataFile("optimizedNoisyToyGraph.txt"), False)
    gaps = [given.atPose2(k).between(found.atPose2(k)) for k in range(4)]
    return float(max(np.abs([g.x(), g.y(), g.theta()]).max() for g in gaps))


@case("GTSAM", "testKarcherMeanFactor, test_KarcherMeanFactor.py: FindRot3, find_*", 1e-9)
def karcher_mean() -> float:
    R = about(0, 0.1)
    two, three = rotavg.karcher_mean([R, R.T]), rotavg.karcher_mean([np.eye(3)] * 3)
    return float(max(np.abs(two - np.eye(3)).max(), np.abs(three - np.eye(3)).max()))


@case("GTSAM", "testKarcherMeanFactor, test_KarcherMeanFactor.py: FactorRot3", 1e-9)
def karcher_gauge() -> float:
    R = about(0, 0.1)
    graph = rotavg.MeasurementGraph([[1, 2]], [R @ R @ R])
    found = rotavg.solve(graph, init=np.array([R.T, R]), gauge="mean").rotations
    gap = np.abs(found[0].T @ found[1] - R @ R @ R).max()
    return float(max(gap, np.abs(rotavg.karcher_mean(found) - np.eye(3)).max()))


@case("GTSAM", "testFrobeniusFactor: ClosestTo, ChordalL2mean", 1e-6)
def chordal_mean() -> float:
    M = about(2, 0.3) + 1e-2 * np.arange(9).reshape(3, 3)
    u, _, vt = np.linalg.svd(M)
    closest = np.abs(rotavg.nearest_rotation(M, tolerance=1) - u @ vt).max()
    R = about(0, 0.1)
    graph = rotavg.MeasurementGraph([[0, 1], [0, 1]], [R, R.T])
    return float(max(closest, np.abs(rotavg.solve(graph).rotations[1] - np.eye(3)).max()))


@case("GTSAM", "testFrobeniusFactor: FrobeniusBetweenFactorSO3 evaluateError (derivative)", 1e-5)
def objective_and_gradient() -> float:
    rng = np.random.default_rng(0)
    R = matrices_from_rotvecs(rng.normal(size=(2, 3)))
    graph = rotavg.MeasurementGraph([[0, 1]], matrices_from_rotvecs(rng.normal(size=(1, 3))))
    spelt = np.sum((R[0] @ graph.rotations[0] - R[1]) ** 2)
    worst = abs(rotavg.objective(graph, R) - spelt)
    slope = rotavg.gradient(graph, R)
    for node in range(2):
        for axis in range(3):
            ends = []
            for step in (1e-6, -1e-6):
                moved = R.copy()
                moved[node] = about(axis, step) @ R[node]
                ends.append(rotavg.objective(graph, moved))
            worst = max(worst, abs((ends[0] - ends[1]) / 2e-6 - slope[node, axis]))
    return float(worst)


@case("GTSAM", "testRot3Optimization: optimize (a circle)", 1e-5, "rad")
def circle() -> float:
    truth = np.array([about(2, k * np.pi / 3) for k in range(6)])
    start = np.array([about(2, k * np.pi / 3 + 0.1 * (k % 2)) for k in range(6)])
    graph = rotavg.MeasurementGraph([(k, (k + 1) % 6) for k in range(6)], [about(2, np.pi / 3)] * 6)
    found = rotavg.solve(graph, init=start, priors=rotavg.Priors(fixed={0: np.eye(3)}))
    return float(np.abs(se3.log_so3(np.swapaxes(truth, 1, 2) @ found.rotations)).max())


@case("GTSAM", "testBetweenFactor: Rot3, Rot3Jacobians, Pose3Jacobians", 1e-5)
def derivative_of_the_logarithm() -> float:
    rng = np.random.default_rng(1)
    xi = rng.normal(size=(20, 6))
    R, t = matrices_from_rotvecs(xi[:, 3:]), xi[:, :3]
    J = se3.inverse_right_jacobian_se3(se3.log_se3(R, t))
    worst = 0.0
    for axis in range(6):
        ends = []
        for step in (1e-6, -1e-6):
            d = step * np.eye(6)[axis]
            moved = R @ matrices_from_rotvecs(d[None, 3:])
            ends.append(se3.log_se3(moved, t + R @ d[:3]))
        worst = max(worst, float(np.abs((ends[0] - ends[1]) / 2e-6 - J[:, :, axis]).max()))
    return worst
