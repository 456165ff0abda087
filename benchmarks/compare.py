"""Every solver on every graph, with repeats in turn; what came of it, run by run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Callable

import rotavg
from benchmarks.cases import Case
from benchmarks.check import refusal, write_check_problem
from benchmarks.evaluate import Evaluator
from benchmarks.runner import Limits, Measurement, measure
from benchmarks.solvers import Solver

Say = Callable[[str], None]


@dataclass(frozen=True)
class Settings:
    """How to measure: numbers of threads, repeats, and limits for each process."""

    threads: tuple[int, ...] = (1,)
    repeat: int = 1
    timeout: float = 60.0
    memory_gib: float = 16.0

    def limits(self, threads: int) -> Limits:
        """The limits for one process."""
        return Limits(threads, self.timeout, self.memory_gib)


@dataclass(frozen=True)
class Run:
    """One run of a solver: a `Measurement` without the rotations, and rotavg's `Evaluation`.

    `excess` is (f - f*) / f*, f* the least objective that any run found.
    """

    solver: str
    threads: int
    repeat: int
    outcome: str
    message: str = ""
    claim: str = ""
    cpu_s: float = math.nan
    wall_s: float = math.nan
    prepare_s: float = math.nan
    memory_mib: float = math.nan
    objective: float = math.nan
    excess: float = math.nan
    relative_gradient: float = math.nan
    verdict: str = ""
    relative_gap: float = math.nan

    @property
    def succeeded(self) -> bool:
        """Whether there is an answer."""
        return self.outcome == "ok"


@dataclass(frozen=True)
class GraphResult:
    """All runs on one graph.

    Attributes:
        best: the least objective, NaN without any answer.
        best_verdict: the best verdict that rotavg gives to any answer: what is known of `best`.
    """

    name: str
    nodes: int
    edges: int
    best: float
    best_verdict: str
    runs: tuple[Run, ...]


VERDICTS = ("", "not_certified", "estimated", "proved")  # from the worst to the best


def refusals(solvers: Sequence[Solver], settings: Settings, say: Say) -> dict[str, str]:
    """Names of the solvers that cannot be measured, and why; see `benchmarks.check`."""
    found: dict[str, str] = {}
    with TemporaryDirectory(prefix="rotavg-bench-") as folder:
        check_problem = Path(folder) / "check.npz"
        write_check_problem(check_problem)
        for solver in solvers:
            reason = refusal(solver, check_problem, settings.limits(settings.threads[0]))
            if reason:
                found[solver.name] = reason
                say(f"{solver.name} is not measured: {reason}")
    return found


def compare(case: Case, solvers: Sequence[Solver], settings: Settings, say: Say) -> GraphResult:
    """Run every solver on one graph."""
    with TemporaryDirectory(prefix="rotavg-bench-") as folder:
        problem, warm_up = Path(folder) / "problem.npz", Path(folder) / "check.npz"
        case.problem().save(problem)
        write_check_problem(warm_up)
        evaluator = Evaluator(case.graph)
        runs: list[Run] = []
        for solver, threads, repeat in _in_turn(solvers, settings):
            if any(_same(run, solver, threads) and not run.succeeded for run in runs):
                continue  # what failed once is not repeated
            measured = measure(solver, problem, warm_up, settings.limits(threads))
            run = Run(solver.name, threads, repeat, measured.outcome)
            run = _evaluated(run, measured, evaluator)
            runs.append(run)
            ended = f"{run.cpu_s:.4g} s CPU" if run.succeeded else f"{run.outcome}: {run.message}"
            say(f"{case.name}: {solver.name}, threads {threads}, run {repeat + 1}: {ended}")
    return _finished(case, runs)


def _in_turn(solvers: Sequence[Solver], settings: Settings) -> Iterator[tuple[Solver, int, int]]:
    """Repeats outermost, so that a busy minute of the machine does not hit one solver alone."""
    for repeat in range(settings.repeat):
        for solver in solvers:
            for threads in settings.threads:
                yield solver, threads, repeat


def _same(run: Run, solver: Solver, threads: int) -> bool:
    return (run.solver, run.threads) == (solver.name, threads)


def _evaluated(run: Run, measured: Measurement, evaluator: Evaluator) -> Run:
    if measured.rotations is None:
        return replace(run, message=measured.message)
    try:
        evaluation = evaluator(measured.rotations)
    except rotavg.Error as error:
        return replace(run, outcome="error", message=f"its answer is refused: {error}")
    return replace(
        run,
        claim=measured.claim,
        cpu_s=measured.cpu_s,
        wall_s=measured.wall_s,
        prepare_s=measured.prepare_s,
        memory_mib=measured.memory_mib,
        objective=evaluation.objective,
        relative_gradient=evaluation.relative_gradient,
        verdict=evaluation.verdict,
        relative_gap=evaluation.relative_gap,
    )


def _finished(case: Case, runs: Sequence[Run]) -> GraphResult:
    best = min((run.objective for run in runs if run.succeeded), default=math.nan)
    # Rounding blurs what is below a millionth of the weights: the certificate's resolution, too.
    scale = max(best, 1e-6 * float(case.graph.weights.sum()))
    return GraphResult(
        name=case.name,
        nodes=case.graph.num_nodes,
        edges=case.graph.num_edges,
        best=best,
        best_verdict=max((run.verdict for run in runs), key=VERDICTS.index, default=""),
        runs=tuple(replace(run, excess=(run.objective - best) / scale) for run in runs),
    )
