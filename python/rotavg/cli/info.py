"""`rotavg info`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

import rotavg
from rotavg.cli import options
from rotavg.cli.command import Command
from rotavg.cli.output import print_json, print_notes, print_table
from rotavg.cli.progress import working
from rotavg.cli.reading import read_graph, reading_options
from rotavg.solving.contamination import contamination
from rotavg.solving.unchecked import bridges


@click.command(
    cls=Command,
    short_help="Tell what graph is in a file, and how hard it is.",
    groups=options.groups_of(Output=("as_json",)),
)
@click.argument("input_path", metavar="INPUT", type=options.INPUT)
@reading_options
@options.as_json
def info(input_path: Path, as_json: bool, **reading: Any) -> None:
    """Tell what graph is in INPUT, and how hard it is to average.

    \b
    Examples:
      rotavg info graph.g2o
      rotavg info graph.g2o --json | jq .cycles.noise_per_edge_deg
    """
    with working(f"examining {input_path}"):
        graph = read_graph(input_path, **reading)
        measures = _measures(graph, rotavg.hardness(graph))
    if as_json:
        print_json({**measures, "notes": list(graph.notes)})
        return
    print_notes(graph)
    print_table(_rows(measures))


def _measures(graph: rotavg.MeasurementGraph, hardness: rotavg.Hardness) -> dict[str, Any]:
    angles = np.degrees(hardness.cycle_angles)
    lengths = hardness.cycle_lengths
    cycles: dict[str, Any] = {
        "independent": graph.num_edges - graph.num_nodes + len(hardness.component_sizes),
        "examined": len(angles),
    }
    if len(angles) > 0:
        cycles["length_median"] = float(np.median(lengths))
        cycles["length_max"] = int(lengths.max())
        for name, percent in (("median", 50), ("p90", 90), ("max", 100)):
            cycles[f"error_{name}_deg"] = float(np.percentile(angles, percent))
        cycles["contamination"] = contamination(hardness.cycle_angles / np.sqrt(lengths))
        cycles["noise_per_edge_deg"] = float(np.degrees(hardness.noise))
        cycles["short"] = _short_cycles(graph)
    covariances: dict[str, Any] = {}
    if graph.covariances is not None:
        values = np.linalg.eigvalsh(graph.covariances)
        # All alike, in all directions, they say no more than a weight that is everywhere 1.
        if np.ptp(values) > 1e-9 * values.max():
            covariances["covariances"] = {
                "rms_median_deg": float(np.median(np.degrees(np.sqrt(values.sum(axis=1))))),
                "axes_ratio_median": float(np.median(np.sqrt(values[:, 2] / values[:, 0]))),
            }
    return {
        "nodes": graph.num_nodes,
        "edges": graph.num_edges,
        "components": len(hardness.component_sizes),
        "largest_component": int(hardness.component_sizes[0]),
        "degree": {
            "min": int(hardness.degrees.min()),
            "median": float(np.median(hardness.degrees)),
            "max": int(hardness.degrees.max()),
        },
        "weight": {"min": float(graph.weights.min()), "max": float(graph.weights.max())},
        **covariances,
        "bridges": int(bridges(graph).sum()),
        "algebraic_connectivity": hardness.algebraic_connectivity,
        "cycles": cycles,
    }


def _short_cycles(graph: rotavg.MeasurementGraph) -> dict[str, Any] | None:
    """What cycles of two and three edges say of every edge that has one; None if none has."""
    evidence = rotavg.cycle_evidence(graph, np.pi)
    checked = evidence.checked > 0
    if not checked.any():
        return None
    figures: dict[str, Any] = {"edges": int(checked.sum())}
    for name, errors in (("median", evidence.median_error), ("least", evidence.least_error)):
        middle, high = np.degrees(np.percentile(errors[checked], [50, 90]))
        figures[f"{name}_error_deg"] = {"median": middle, "p90": high}
    return figures


def _rows(measures: dict[str, Any]) -> list[tuple[str, str]]:
    degree, weight, cycles = measures["degree"], measures["weight"], measures["cycles"]
    components = f"{measures['components']}"
    if measures["components"] > 1:
        components += f", the largest of {measures['largest_component']} nodes"
    rows = [
        ("nodes", f"{measures['nodes']}"),
        ("edges", f"{measures['edges']}"),
        ("components", components),
        ("degree", f"{degree['min']} to {degree['max']}, median {degree['median']:g}"),
        ("weight", f"{weight['min']:.3g} to {weight['max']:.3g}"),
        (
            "connectivity",
            f"lambda_2 = {measures['algebraic_connectivity']:.3g} (weighted Laplacian"
            + (", largest component)" if measures["components"] > 1 else ")")
            + ": the smaller, the harder",
        ),
    ]
    if "covariances" in measures:
        spread = measures["covariances"]
        text = f"{spread['rms_median_deg']:.3g} deg an edge (median), the worst axis "
        rows.append(("covariances", f"{text}{spread['axes_ratio_median']:.2g} times the best"))
    if measures["bridges"] > 0 and cycles["examined"] > 0:
        rows.append(("bridges", f"{measures['bridges']} edges that no cycle checks"))
    if cycles["examined"] == 0:
        rows.append(("cycles", "none: a forest, every measurement is met exactly"))
        return rows
    examined = "" if cycles["examined"] == cycles["independent"] else (
        f", {cycles['examined']} examined"
    )  # fmt: skip
    rows += [
        (
            "cycles",
            f"{cycles['independent']} independent{examined}, of {cycles['length_median']:g} edges "
            f"(median), at most {cycles['length_max']}",
        ),
        (
            "cycle errors",
            f"median {cycles['error_median_deg']:.3g} deg, 90 % below "
            f"{cycles['error_p90_deg']:.3g}, largest {cycles['error_max_deg']:.3g}",
        ),
        (
            "noise",
            f"about {cycles['noise_per_edge_deg']:.2g} deg an edge "
            "(median of cycle error / sqrt(edges), of cycles without wrong edges)",
        ),
    ]
    if cycles["short"] is not None:
        short = cycles["short"]
        median, least = short["median_error_deg"], short["least_error_deg"]
        rows.append(
            (
                "short cycles",
                f"of {short['edges']} edges: an edge's median error {median['median']:.3g} deg, "
                f"90 % below {median['p90']:.3g}; its least {least['median']:.3g} deg, 90 % below "
                f"{least['p90']:.3g}",
            )
        )
    if cycles["contamination"] is not None:
        rows.append(("outliers?", f"of the cycle errors / sqrt(edges), {cycles['contamination']}"))
    return rows
