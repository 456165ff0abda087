"""What of a graph a file of some format does not hold."""

from __future__ import annotations

import numpy as np

from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.registry import Format


def lost_ids(form: Format, graph: MeasurementGraph) -> tuple[str, ...]:
    """Whether the ids are not in a file of this format."""
    if form.has_ids(graph):
        return ()
    return (f"the ids are not in it: {form.name} counts the nodes, from 0",)


def lost(form: Format, graph: MeasurementGraph) -> tuple[str, ...]:
    """Sentences on what of a graph a file of this format does not hold."""
    told = [*lost_ids(form, graph)]
    if not form.has_weights and np.ptp(graph.weights) > 0:
        told.append(f"the weights are not in it, {form.name} has no place for them")
    alone = () if form.has_isolated else isolated(graph)
    if len(alone):
        named = ", ".join(map(repr, alone[:5])) + (", ..." if len(alone) > 5 else "")
        what = "1 node without an edge is" if len(alone) == 1 else (
            f"{len(alone)} nodes without an edge are"
        )  # fmt: skip
        told.append(f"{what} not in it ({named}), {form.name} has no place for such")
    return tuple(told)


def isolated(graph: MeasurementGraph) -> list[int | str]:
    """The ids of the nodes without an edge."""
    alone = np.ones(graph.num_nodes, dtype=np.bool_)
    alone[graph.indices] = False
    return graph.nodes[alone].tolist()  # type: ignore[no-any-return]
