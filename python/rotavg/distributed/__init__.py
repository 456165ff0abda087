"""Rotation averaging on many machines: `solve` divides a graph among the workers of Dask."""

from rotavg.distributed.edges import Edges
from rotavg.distributed.rounds import Round
from rotavg.distributed.solution import DistributedSolution, Interrupted
from rotavg.distributed.solve import solve

__all__ = ["DistributedSolution", "Edges", "Interrupted", "Round", "solve"]
