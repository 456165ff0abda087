"""Table 1: errors, smallest eigenvalues and times on simulated complete graphs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rotavg.reproduce import measure
from rotavg.reproduce.experiment import Experiment, Outcome, Settings, markdown_table
from rotavg.reproduce.measure import ADAPTIVE_SUM, BCD, BCDSR, SUM, Algorithm, Run
from rotavg.reproduce.published import TABLE_1, Setting
from rotavg.simulation.simulate import simulate

SIZES = (20, 200)
MANY_RUNS, FEW_RUNS = 100, 3
SMALL = 200  # up to here there are many runs, and BCDSR is among the algorithms
ALGORITHMS = (BCDSR, BCD, SUM, ADAPTIVE_SUM)


@dataclass(frozen=True)
class Row:
    """All runs of one setting, by the algorithm's name; all algorithms saw the same graphs."""

    setting: Setting
    runs: dict[str, list[Run]]


def run(settings: Settings) -> Outcome:
    """Simulate, solve with every algorithm, and put the averages beside the printed ones."""
    sizes = SIZES if settings.sizes is None else settings.sizes
    if settings.slow:
        _announce_bcdsr([n for n in sizes if n > SMALL], settings)
    rows = [
        _row(Setting(n, phi, p), settings) for n in sizes for phi in (0.2, 0.5) for p in (0.0, 0.3)
    ]
    return Outcome(
        _markdown(rows), {"epsilon": measure.EPSILON, "seed": settings.seed, "rows": _data(rows)}
    )


EXPERIMENT = Experiment("table1", "Table 1: errors, eigenvalues and times on synthetic data", run)


def _row(setting: Setting, settings: Settings) -> Row:
    n, phi, p = setting
    chosen = [a for a in ALGORITHMS if a is not BCDSR or n <= SMALL or settings.slow]
    runs: dict[str, list[Run]] = {a.name: [] for a in chosen}
    count = _num_runs(n, settings)
    for k in range(count):
        graph = simulate("complete", n, noise=phi, drop=p, seed=settings.seed + k).graph
        for algorithm in chosen:
            settings.progress(
                f"n = {n}, φ = {phi:g}, p = {p:g}: graph {k + 1} of {count}, {algorithm.name}"
            )
            runs[algorithm.name].append(measure.run(graph, algorithm))
    return Row(setting, runs)


def _num_runs(n: int, settings: Settings) -> int:
    if settings.runs is not None:
        return settings.runs
    return MANY_RUNS if n <= SMALL else FEW_RUNS


def _announce_bcdsr(sizes: Iterable[int], settings: Settings) -> None:
    """How long BCDSR will take, from one sweep of it, 27 n^3, on a graph that is smaller but whose
    Y does not fit in a cache either.
    """
    large, sweeps = 1000, 10
    for n in sizes:
        calibration = min(n, large)
        settings.progress(f"one sweep of BCDSR at n = {calibration}")
        graph = simulate("complete", calibration, noise=0.2, seed=settings.seed).graph
        _, seconds = measure.timed_solve(graph, BCDSR, max_iterations=1)
        sweep = seconds * (n / calibration) ** 3
        graphs = 4 * _num_runs(n, settings)
        settings.note(
            f"BCDSR at n = {n}: {72e-9 * n * n:.2g} GB, about {sweeps} sweeps of "
            f"{_duration(sweep)}, {_duration(sweeps * sweep * graphs)} for all {graphs} graphs"
        )


def _duration(seconds: float) -> str:
    for unit, length in (("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.2g} s"


def _mean(runs: list[Run], name: str) -> float:
    return float(np.mean([getattr(r, name) for r in runs]))


def _seconds(runs: list[Run]) -> float:
    return float(np.median([r.seconds for r in runs]))


def _standard_error(runs: list[Run], name: str) -> float | None:
    if len(runs) < 2:
        return None
    return float(np.std([getattr(r, name) for r in runs], ddof=1) / np.sqrt(len(runs)))


def _summary(runs: list[Run], reference: list[Run]) -> dict[str, Any]:
    return {
        "runs": len(runs),
        "error": _mean(runs, "error"),
        "error_standard_error": _standard_error(runs, "error"),
        "squared_error": _mean(runs, "squared_error"),
        "lambda_min": min(r.lambda_min for r in runs),
        "certified": sum(r.certified for r in runs),
        "converged": sum(r.converged for r in runs),
        "iterations": float(np.median([r.iterations for r in runs])),
        "seconds": _seconds(runs),
        # The largest relative difference, over the graphs, from what BCD has found.
        "objective_difference": _difference(runs, reference, "objective"),
        "relaxed_difference": _difference(runs, reference, "relaxed_objective"),
    }


def _difference(runs: list[Run], reference: list[Run], name: str) -> float:
    return float(max(abs(getattr(a, name) / b.objective - 1) for a, b in zip(runs, reference)))


def _data(rows: list[Row]) -> list[dict[str, Any]]:
    return [
        {
            **row.setting._asdict(),
            "here": {
                name: {**_summary(runs, row.runs[BCD.name]), "each": [asdict(r) for r in runs]}
                for name, runs in row.runs.items()
            },
            "paper": {
                name: printed._asdict() for name, printed in TABLE_1.get(row.setting, {}).items()
            },
        }
        for row in rows
    ]


# The tables.


def _markdown(rows: list[Row]) -> str:
    return "\n".join([
        "avg.error, the mean of ‖R_i R_ij − R_j‖_F, averaged over the graphs (± its standard\n"
        "error), and f/|E|, the mean of the squares, which the caption of Table 1 names:\n",
        markdown_table(
            ["n", "φ [rad]", "p", "graphs", "BCDSR, paper", "BCD, SUM, paper", "BCDSR", "BCD",
             "SUM", "f/\\|E\\| (BCD)"],
            map(_error_line, rows),
        ),
        "Optimality: min(λ_min) over the graphs, and how many answers are certified; the largest\n"
        "relative difference of BCDSR's objective (6) from BCD's f:\n",
        markdown_table(
            ["n", "φ [rad]", "p", "BCDSR, paper", "BCD, paper", "SUM, paper", "BCDSR", "BCD",
             "SUM", "BCDSR's objective"],
            map(_optimality_line, rows),
        ),
        "Time: CPU seconds of one thread, median over the graphs, and the number of sweeps. SUM\n"
        "computes µ = −λ_min(Rt) as Algorithm 3 prints it; \"adaptive\" starts at µ = 0:\n",
        markdown_table(
            ["n", "φ [rad]", "p", "BCDSR", "BCD", "SUM", "SUM, adaptive µ",
             "BCDSR : BCD : SUM", "with adaptive µ", "paper"],
            map(_time_line, rows),
        ),
        f"All stop at the paper's rule with ε = {measure.EPSILON:g}, from the shortest paths.\n",
    ])  # fmt: skip


def _head(row: Row) -> list[str]:
    n, phi, p = row.setting
    return [f"{n}", f"{phi:g}", f"{p:g}"]


def _here(row: Row, algorithm: Algorithm, text: str, *names: str) -> str:
    """The text filled with columns of an algorithm's summary; a dash where it did not run."""
    runs = row.runs.get(algorithm.name)
    if runs is None:
        return "–"
    summary = _summary(runs, row.runs[BCD.name])
    return text.format(*(summary[name] for name in names))


def _paper(row: Row, algorithm: Algorithm, text: str, name: str) -> str:
    printed = TABLE_1.get(row.setting)
    return "–" if printed is None else text.format(getattr(printed[algorithm.name], name))


def _error_line(row: Row) -> list[str]:
    error = _standard_error(row.runs[BCD.name], "error")
    return [
        *_head(row),
        f"{len(row.runs[BCD.name])}",
        _paper(row, BCDSR, "{:.4f}", "error"),
        _paper(row, BCD, "{:.4f}", "error"),
        _here(row, BCDSR, "{:.4f}", "error"),
        _here(row, BCD, "{:.4f}", "error") + ("" if error is None else f" ± {error:.4f}"),
        _here(row, SUM, "{:.4f}", "error"),
        _here(row, BCD, "{:.4f}", "squared_error"),
    ]


def _optimality_line(row: Row) -> list[str]:
    return [
        *_head(row),
        *(_paper(row, a, "{:.1e}", "lambda_min") for a in (BCDSR, BCD, SUM)),
        *(
            _here(row, a, "{:.0e}; {} of {}", "lambda_min", "certified", "runs")
            for a in (BCDSR, BCD, SUM)
        ),
        _here(row, BCDSR, "{:.0e}", "relaxed_difference"),
    ]


def _time_line(row: Row) -> list[str]:
    return [
        *_head(row),
        *(
            _here(row, a, "{:.2g} ({:.0f})", "seconds", "iterations")
            for a in (BCDSR, BCD, SUM, ADAPTIVE_SUM)
        ),
        *(
            _ratio({name: _seconds(runs) for name, runs in row.runs.items()}, other)
            for other in (SUM, ADAPTIVE_SUM)
        ),
        _ratio({n: x.seconds for n, x in TABLE_1.get(row.setting, {}).items()}, SUM),
    ]


def _ratio(seconds: dict[str, float], last: Algorithm) -> str:
    """BCDSR : BCD : the last."""
    one = seconds.get(BCD.name)
    if not one:
        return "–"
    first = f"{seconds[BCDSR.name] / one:.0f}" if BCDSR.name in seconds else "–"
    return f"{first} : 1 : {seconds[last.name] / one:.2g}"
