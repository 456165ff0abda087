"""Generated view graphs with repeated structure and outliers, beside the generator's baselines.

    ./dev bench viewgraphs --seed 7                        # all splits, weights and columns
    ./dev bench viewgraphs --seed 7 --split symmetry --no-peers
    ./dev bench viewgraphs --large 100000                  # one graph: time and memory

The graphs are those of ViewGraphBench, made anew by its generator (PyPI viewgraphforge, MIT) with a
seed of one's choice. Columns: the default robust loss with even weights, with numbers of matches
and with inverse variances; the generator's baselines; peers with even weights. Errors are by its
metric, the mean angle over the cameras after a robust common rotation, averaged over the graphs
of a split; then the share of the graphs below 2 degrees, and CPU seconds a graph. "Said so" counts
the answers more than 5 degrees off that tell another story, weak parts or groups that nothing
checks, "told right" those of them one of whose stories is below 2 degrees, "cried wolf" the answers
below 1 degree that tell anything; over all weights, and the first two for even weights alone as
well. Of a peer that gives no answer on some graphs the mean is over the others. One thread.
"""

from __future__ import annotations

import json
import os
import resource
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# Threads of BLAS that wait would count in the CPU time of whatever comes next.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click
import numpy as np
from numpy.typing import NDArray

import rotavg
from benchmarks.robust import PEERS, print_table, run_peer

_WHOLE = {"families": "all", "seeds": 1, "params": {"n_nodes": 300}}
_CLEAN = {**_WHOLE, "params": {"n_nodes": 300, "outlier_ratio": 0.0}}
SPLITS: dict[str, dict[str, Any]] = {
    "outliers": {"factor": "outlier_ratio", "values": [0.0, 0.3, 0.6], **_WHOLE},
    "symmetry": {
        "factor": "symmetry_confusability", "values": [0.2, 0.5, 0.75],
        **{**_CLEAN, "families": None, "cases": "symmetric"},
    },
    "small": {
        "factor": "n_nodes", "values": [25, 50],
        **{
            **_CLEAN, "families": None, "cases": "symmetric", "seeds": 3,
            "params": {"outlier_ratio": 0.0, "symmetry_confusability": 0.5},
        },
    },
    "heavytail": {"factor": "heavy_tail_df", "values": [2.0], **_CLEAN},
    "noise": {"factor": "pixel_noise", "values": [1.0, 16.0], **_WHOLE},
    "density": {"factor": "retrieval_k", "values": [3, 10, 80], **_WHOLE},
    "topology": {"kind": "grid", **_WHOLE},
    "matches": {"factor": "min_matches", "values": [10, 80], **_WHOLE},
    "twoview": {
        "factor": "n_nodes", "values": [100, 300],
        **{**_WHOLE, "params": {"noise_model": "twoview"}},
    },
    "wild": {"kind": "wild", "count": 60},
}  # fmt: skip
WEIGHTS = ("even", "matches", "1/sigma^2")
BASELINES = ("rot/spanning_tree", "rot/chordal_l2+irls_cauchy", "rot/l1_irls", "rot/l1_irls_info")


def generated(split: str, seed: int, limit: int | None) -> Iterator[Any]:
    """The graphs of a split."""
    from viewgraphforge.generate import generate_graph
    from viewgraphforge.splits import expand_split

    spec = {"kind": "sweep", **SPLITS[split]}
    for job in expand_split(f"rotavg_{split}", spec, seed, {"store_points": False})[:limit]:
        yield generate_graph(job.params, job.seed, graph_id=job.graph_id)


def measurement_graph(graph: Any, weights: str) -> rotavg.MeasurementGraph:
    """One of them as a graph of this library."""
    a = graph.arrays
    given: dict[str, NDArray[np.float64] | None] = {
        "even": None,
        "matches": a["edge_n_matches"].astype(np.float64),
        "1/sigma^2": 1.0 / a["edge_sigma_rot"].astype(np.float64) ** 2,
    }
    return rotavg.MeasurementGraph(
        np.column_stack([a["edge_i"], a["edge_j"]]),
        graph.R_meas,
        weights=given[weights],
        nodes=np.arange(graph.n_nodes),
        convention="vision",
    )


def rotation_method(graph: Any) -> NDArray[np.float64]:
    """The default robust loss with weights from matches, as a method of viewgraphforge."""
    solution = rotavg.solve(measurement_graph(graph, "matches"), loss="auto", num_threads=1)
    return np.ascontiguousarray(solution.rotations.transpose(0, 2, 1))


def register() -> None:
    """Make it known to viewgraphforge's own runner as "rot/rotavg"."""
    from viewgraphforge.benchmark.rotation_averaging import ROTATION_METHODS

    ROTATION_METHODS["rot/rotavg"] = rotation_method


def error(rotations: NDArray[np.float64], graph: Any) -> float:
    """Mean error in degrees, of rotations world_from_camera."""
    from viewgraphforge.benchmark.metrics import rotation_metrics

    node_from_world = rotations.transpose(0, 2, 1)
    return float(rotation_metrics(node_from_world, graph.R_wc)["rot_mean_deg"])


def measure_graph(graph: Any, peers: tuple[str, ...], limit: float) -> dict[str, dict[str, Any]]:
    """All columns on one graph."""
    from viewgraphforge.benchmark.rotation_averaging import ROTATION_METHODS

    found: dict[str, dict[str, Any]] = {}
    for weights in WEIGHTS:
        ours = measurement_graph(graph, weights)
        start = time.process_time()
        solution = rotavg.solve(ours, loss="auto", num_threads=1)
        seconds = time.process_time() - start
        assert solution.robust is not None
        doubtful = len(solution.robust.alternatives) > 0
        doubtful |= solution.robust.num_parts > solution.num_components
        doubtful |= len(solution.hanging_groups) > 0
        told = [error(story.rotations, graph) for story in solution.robust.alternatives]
        found[f"rotavg, {weights}"] = {
            "error": error(solution.rotations, graph), "seconds": seconds, "doubtful": doubtful,
            "told right": bool(min(told, default=180.0) < 2.0),
        }  # fmt: skip
    for name in BASELINES:
        start = time.process_time()
        rotations = ROTATION_METHODS[name](graph)
        seconds = time.process_time() - start
        found[name] = {"error": error(rotations.transpose(0, 2, 1), graph), "seconds": seconds}
    truth = graph.R_wc.transpose(0, 2, 1), np.ones(graph.n_nodes, dtype=np.bool_)
    for name in peers:
        figures = run_peer(name, measurement_graph(graph, "even"), truth, limit)
        found[name] = {"failure": figures["failure"]} if "failure" in figures else {
            "error": figures["mean"], "seconds": figures["seconds"],
        }  # fmt: skip
    return found


def cell(results: list[dict[str, Any]]) -> str:
    """Mean error, share below 2 degrees and CPU seconds; of how many graphs there was no answer."""
    answers = [r for r in results if "error" in r]
    failed = len(results) - len(answers)
    said = [f"{failed} failed"] if failed else []
    if not answers:
        return said[0] if said else "-"
    errors = np.array([r["error"] for r in answers])
    seconds = np.mean([r["seconds"] for r in answers])
    below = 100 * (errors < 2).sum() / len(results)
    return ", ".join([f"{errors.mean():.3g}, {below:.0f} %, {seconds:.2g} s", *said])


def measure_large(num_nodes: int, family: str, seed: int) -> None:
    """One graph of so many cameras: time and memory of making it and of the solution."""
    from viewgraphforge.generate import generate_graph

    def peak() -> float:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

    start = time.process_time()
    params = {"family": family, "n_nodes": num_nodes, "store_points": False}
    graph = generate_graph(params, seed)
    click.echo(
        f"{family}: {graph.n_nodes} cameras, {graph.n_edges} edges; generated in "
        f"{time.process_time() - start:.3g} CPU s, peak {peak():.0f} MB"
    )
    ours = measurement_graph(graph, "matches")
    start = time.process_time()
    solution = rotavg.solve(ours, loss="auto", num_threads=1)
    seconds = time.process_time() - start
    assert solution.certificate is not None
    click.echo(
        f"solved in {seconds:.3g} CPU s, {solution.certificate.verdict}, peak {peak():.0f} MB, "
        f"mean error {error(solution.rotations, graph):.3g} deg\n{solution.reason}"
    )


def honesty(rows: list[dict[str, dict[str, Any]]]) -> tuple[str, ...]:
    """How many far off said so, and told the right story; how many right ones cried wolf."""
    ours = [(name, r) for row in rows for name, r in row.items() if "doubtful" in r]
    right = [r["doubtful"] for _, r in ours if r["error"] < 1]
    off = [r for _, r in ours if r["error"] > 5]
    even = [r for name, r in ours if name == "rotavg, even" and r["error"] > 5]
    counts = [f"{sum(r[what] for r in of)} of {len(of)}" for of in (off, even)
              for what in ("doubtful", "told right")]  # fmt: skip
    return (*counts, f"{sum(right)} of {len(right)}")


@click.command(help=__doc__)
@click.option("--seed", type=int, default=7, show_default=True)
@click.option("--split", "splits", type=click.Choice(list(SPLITS)), multiple=True)
@click.option("--limit", type=int, help="So many graphs of a split at most.")
@click.option("--no-peers", is_flag=True, help="Without pycolmap and pytheia.")
@click.option("--large", type=int, help="One graph of so many cameras instead.")
@click.option("--family", default="crowd", show_default=True, help="Of that graph.")
@click.option("--peer-limit", type=float, default=10.0, show_default=True, help="Seconds of a run.")
@click.option(
    "--output", type=click.Path(path_type=Path), default=Path("build/bench/viewgraphs.json")
)
def main(
    seed: int,
    splits: tuple[str, ...],
    limit: int | None,
    no_peers: bool,
    large: int | None,
    family: str,
    peer_limit: float,
    output: Path,
) -> None:
    """Generate, measure, print the table, keep every figure."""
    if large is not None:
        measure_large(large, family, seed)
        return
    measured: dict[str, list[dict[str, dict[str, Any]]]] = defaultdict(list)
    output.parent.mkdir(parents=True, exist_ok=True)
    for split in splits or SPLITS:
        for graph in generated(split, seed, limit):
            click.echo(f"{split} {graph.graph_id}", err=True)
            measured[split].append(measure_graph(graph, () if no_peers else PEERS, peer_limit))
            output.write_text(json.dumps(measured, indent=1))
    names = list(dict.fromkeys(name for rows in measured.values() for r in rows for name in r))
    table = []
    for split, rows in measured.items():
        cells = []
        for name in names:
            of_name = [row[name] for row in rows if name in row]
            cells.append(cell(of_name))
        table.append([f"{split} ({len(rows)})", *cells, *honesty(rows)])
    honest = ["said so", "told right", "said so, even", "told right, even", "cried wolf"]
    print_table([f"seed {seed}", *names, *honest], table)


if __name__ == "__main__":
    main()
