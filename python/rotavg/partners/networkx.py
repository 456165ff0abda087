"""NetworkX: directed graphs with a rotation on every edge."""

from __future__ import annotations

from typing import Any

from rotavg.graph.conventions import Convention
from rotavg.graph.measurement_graph import MeasurementGraph


def from_networkx(
    graph: Any,
    rotation: str = "rotation",
    weight: str = "weight",
    convention: Convention = "pose",
    *,
    covariance: str = "covariance",
    skip_self_edges: bool = False,
) -> MeasurementGraph:
    """See `MeasurementGraph.from_networkx`."""
    return MeasurementGraph.from_networkx(
        graph,
        rotation,
        weight,
        covariance=covariance,
        convention=convention,
        skip_self_edges=skip_self_edges,
    )


def to_networkx(graph: MeasurementGraph) -> Any:
    """See `MeasurementGraph.to_networkx`."""
    return graph.to_networkx()
