from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__version__: str

class InvalidEdge(ValueError): ...
class InvalidOption(ValueError): ...
class InvalidRotation(ValueError): ...
class TooLarge(ValueError): ...

class MeasurementGraph:
    def __init__(
        self,
        num_nodes: int,
        indices: NDArray[np.int32],
        rotations: NDArray[np.float64],
        weights: NDArray[np.float64],
    ) -> None: ...
    @property
    def num_nodes(self) -> int: ...
    @property
    def num_edges(self) -> int: ...
    @property
    def rotations(self) -> NDArray[np.float64]: ...

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
    callback: Callable[[Progress], bool | None] | None,
    loss: str,
    loss_scale: float,
    cycle_threshold: float,
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
) -> dict[str, Any]: ...
def certify(
    graph: MeasurementGraph,
    rotations: NDArray[np.float64],
    *,
    tolerance: float,
    time_limit: float,
    num_threads: int,
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
) -> tuple[NDArray[np.int32], NDArray[np.int32]]: ...
def bridges(graph: MeasurementGraph) -> NDArray[np.bool_]: ...
def covariances(
    graph: MeasurementGraph,
    rotations: NDArray[np.float64],
    pairs: NDArray[np.int32],
    *,
    noise_variance: float,
    held_nodes: list[int],
    turn_of: list[int],
    axis: NDArray[np.float64],
    information: NDArray[np.float64] | None,
    num_threads: int,
) -> NDArray[np.float64] | None: ...
def loso(matrices: NDArray[np.float64]) -> NDArray[np.float64]: ...
def loso_fast(matrices: NDArray[np.float64]) -> NDArray[np.float64]: ...
def nearest_rotation(matrices: NDArray[np.float64]) -> NDArray[np.float64]: ...
