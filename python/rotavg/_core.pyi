from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__version__: str

class InvalidEdge(ValueError): ...
class InvalidOption(ValueError): ...
class InvalidPrior(ValueError): ...
class InvalidRotation(ValueError): ...
class TooLarge(ValueError): ...

class MeasurementGraph:
    def __init__(
        self,
        num_nodes: int,
        indices: NDArray[np.int32],
        rotations: NDArray[np.float64],
        weights: NDArray[np.float64],
        inverted: bool = False,
    ) -> None: ...
    @property
    def num_nodes(self) -> int: ...
    @property
    def num_edges(self) -> int: ...
    @property
    def bytes(self) -> int: ...
    @property
    def rotations(self) -> NDArray[np.float64]: ...
    @property
    def quaternions(self) -> NDArray[np.float64]: ...
    @property
    def scaled_quaternions(self) -> NDArray[np.float64]: ...
    @property
    def indices(self) -> NDArray[np.int32]: ...
    @property
    def weights(self) -> NDArray[np.float64]: ...

class OnlineState:
    @property
    def verdict(self) -> str: ...
    @property
    def objective(self) -> float: ...
    @property
    def gap(self) -> float: ...
    @property
    def relative_gap(self) -> float: ...
    @property
    def relative_gradient(self) -> float: ...
    @property
    def num_nodes(self) -> int: ...
    @property
    def num_edges(self) -> int: ...
    @property
    def num_components(self) -> int: ...
    @property
    def num_outliers(self) -> int: ...
    @property
    def iterations(self) -> int: ...
    @property
    def eliminated(self) -> int: ...
    @property
    def moved(self) -> int: ...
    @property
    def refreshed(self) -> int: ...
    @property
    def solved(self) -> int: ...
    @property
    def num_second_opinions(self) -> int: ...

class Online:
    def __init__(
        self,
        *,
        tolerance: float,
        certificate_tolerance: float,
        loss: str,
        loss_scale: float,
        second_opinions: bool,
    ) -> None: ...
    def add(
        self,
        ends: NDArray[np.int64],
        rotations: NDArray[np.float64],
        weights: NDArray[np.float64],
        trusted: NDArray[np.bool_] | None,
        nodes: NDArray[np.int64],
    ) -> NDArray[np.int32]: ...
    def remove(self, edges: NDArray[np.int32]) -> None: ...
    def set_weights(self, edges: NDArray[np.int32], weights: NDArray[np.float64]) -> None: ...
    @property
    def state(self) -> OnlineState: ...
    def nodes(self) -> NDArray[np.int64]: ...
    def rotations(self) -> NDArray[np.float64]: ...
    def rotation(self, node: int) -> NDArray[np.float64]: ...
    def edge_weights(self) -> NDArray[np.float64]: ...
    def edges(
        self,
    ) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]: ...

class Priors:
    def __init__(
        self,
        *,
        fixed: NDArray[np.int64],
        fixed_rotations: NDArray[np.float64],
        absolute: NDArray[np.int64],
        absolute_rotations: NDArray[np.float64],
        absolute_weights: NDArray[np.float64],
        gravity: NDArray[np.int64],
        gravity_downs: NDArray[np.float64],
        gravity_weights: NDArray[np.float64],
        rigs: NDArray[np.int64],
        rig_frames: NDArray[np.int64],
        rig_rotations: NDArray[np.float64],
        down: NDArray[np.float64],
    ) -> None: ...

class Rigs:
    def __init__(
        self,
        *,
        nodes: NDArray[np.int64],
        frames: NDArray[np.int64],
        sensors: NDArray[np.int64],
        known: NDArray[np.int64],
        known_rotations: NDArray[np.float64],
    ) -> None: ...

class GroundedGraph:
    def __init__(self, given: MeasurementGraph, priors: Priors) -> None: ...
    def with_prior_weights(
        self, absolute: NDArray[np.float64], gravity: NDArray[np.float64]
    ) -> GroundedGraph: ...
    def with_weights(self, weights: NDArray[np.float64]) -> GroundedGraph: ...
    @property
    def kept(self) -> NDArray[np.int32]: ...
    @property
    def num_free_headings(self) -> int: ...
    @property
    def num_parts(self) -> int: ...
    def edges_where(
        self,
        measurements: NDArray[np.bool_],
        absolute: NDArray[np.bool_],
        gravity: NDArray[np.bool_],
    ) -> NDArray[np.bool_]: ...
    def degrees_of_freedom(self, holds: NDArray[np.bool_]) -> int: ...
    def objective(self, rotations: NDArray[np.float64]) -> float: ...
    def edge_costs(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def prior_costs(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def log_prior_costs(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def prior_residuals(
        self, rotations: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def covariances(
        self,
        rotations: NDArray[np.float64],
        pairs: NDArray[np.int32] | None,
        *,
        noise_variance: float,
        num_threads: int,
        information: NDArray[np.float64] | None,
        prior_information: float,
    ) -> NDArray[np.float64] | None: ...

class Progress:
    @property
    def iteration(self) -> int: ...
    @property
    def objective(self) -> float: ...
    @property
    def gradient_norm(self) -> float: ...
    @property
    def relative_gradient(self) -> float: ...
    @property
    def step(self) -> float: ...
    @property
    def seconds(self) -> float: ...

def components(graph: MeasurementGraph) -> NDArray[np.int32]: ...
def algebraic_connectivity(graph: MeasurementGraph, component: int) -> float: ...
def cycle_lengths(graph: MeasurementGraph, edges: NDArray[np.int32]) -> NDArray[np.int32]: ...
def solve(
    graph: MeasurementGraph,
    *,
    method: str,
    init: str,
    start: NDArray[np.float64] | None,
    seed: int,
    mu: str,
    accelerate: bool,
    max_rank: int,
    stop: str,
    tolerance: float,
    max_iterations: int,
    time_limit: float,
    num_threads: int,
    certify: bool,
    certificate_tolerance: float,
    certificate_failure_probability: float,
    certificate_seed: int,
    certificate_max_flops: float,
    callback: Callable[[Progress], bool | None] | None,
    loss: str,
    loss_scale: float,
    cycle_threshold: float,
    min_cycles: int,
    weight_kind: str,
    trusted: NDArray[np.bool_] | None,
    excluded: NDArray[np.bool_] | None,
    edge_scales: NDArray[np.float64] | None,
    initial_weights: NDArray[np.float64] | None,
    odometry: NDArray[np.bool_] | None,
    robust_priors: bool,
    priors: GroundedGraph | None,
    start_is_solution: bool,
    rigs: Rigs | None,
    rig_priors: Priors | None,
) -> dict[str, Any]: ...
def refine_anisotropic(
    graph: MeasurementGraph,
    information: NDArray[np.float64],
    rotations: NDArray[np.float64],
    *,
    tolerance: float,
    max_iterations: int,
    time_limit: float,
    num_threads: int,
    callback: Callable[[Progress], bool | None] | None,
    iterations_before: int,
    priors: GroundedGraph | None,
    prior_precision: float,
) -> dict[str, Any]: ...
def solve_anisotropic(
    graph: MeasurementGraph,
    precisions: NDArray[np.float64],
    *,
    start: NDArray[np.float64],
    method: str,
    mu: str,
    stop: str,
    tolerance: float,
    max_iterations: int,
    time_limit: float,
    num_threads: int,
    certify: bool,
    max_rank: int,
    certificate_tolerance: float,
    certificate_failure_probability: float,
    certificate_seed: int,
    certificate_max_flops: float,
    callback: Callable[[Progress], bool | None] | None,
    iterations_before: int,
    priors: GroundedGraph | None,
    prior_precision: float,
) -> dict[str, Any]: ...
def certify(
    graph: MeasurementGraph,
    rotations: NDArray[np.float64],
    *,
    tolerance: float,
    failure_probability: float,
    seed: int,
    max_flops: float,
    time_limit: float,
    num_threads: int,
    priors: GroundedGraph | None,
    precisions: NDArray[np.float64] | None,
    prior_precision: float,
) -> dict[str, Any]: ...
def objective(graph: MeasurementGraph, rotations: NDArray[np.float64]) -> float: ...
def gradient(graph: MeasurementGraph, rotations: NDArray[np.float64]) -> NDArray[np.float64]: ...
def residual_angles(
    graph: MeasurementGraph, rotations: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def shortest_path_init(graph: MeasurementGraph) -> NDArray[np.float64]: ...
def join_pieces(
    graph: MeasurementGraph, rotations: NDArray[np.float64], piece: NDArray[np.int32]
) -> NDArray[np.float64]: ...
def random_init(graph: MeasurementGraph, seed: int) -> NDArray[np.float64]: ...
def cycle_evidence(
    graph: MeasurementGraph, threshold: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]: ...
def bridges(graph: MeasurementGraph) -> NDArray[np.bool_]: ...
def refined_gravity(
    graph: MeasurementGraph, down: NDArray[np.float64], rounds: int
) -> NDArray[np.float64]: ...
def series(graph: MeasurementGraph) -> tuple[NDArray[np.int32], int]: ...
def covariances(
    graph: MeasurementGraph,
    rotations: NDArray[np.float64],
    pairs: NDArray[np.int32],
    *,
    noise_variance: float,
    information: NDArray[np.float64] | None,
    num_threads: int,
) -> NDArray[np.float64] | None: ...
def positions(
    graph: MeasurementGraph,
    rotations: NDArray[np.float64],
    translations: NDArray[np.float64],
    information: NDArray[np.float64],
    rows: NDArray[np.int32],
    held: NDArray[np.float64],
) -> NDArray[np.float64]: ...
def loso(matrices: NDArray[np.float64]) -> NDArray[np.float64]: ...
def loso_fast(matrices: NDArray[np.float64]) -> NDArray[np.float64]: ...
def nearest_rotation(matrices: NDArray[np.float64]) -> NDArray[np.float64]: ...
