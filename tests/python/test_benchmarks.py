"""The benchmarks' machinery, with solvers that need no other package."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rotavg
from benchmarks import report
from benchmarks.cases import Case
from benchmarks.compare import GraphResult, Run, Settings, compare, refusals
from benchmarks.evaluate import Evaluator
from benchmarks.peers.measurement_matrix import measurement_matrix
from benchmarks.peers.numpy_paper import Bcd, Sum
from benchmarks.peers.scipy_lbfgs import Lbfgs
from benchmarks.problem import Problem, kept_edges
from benchmarks.report import markdown
from benchmarks.run import main
from benchmarks.solvers import SOLVERS, Solver
from benchmarks.summary import rows

BY_NAME = {solver.name: solver for solver in SOLVERS}


@pytest.fixture(autouse=True)
def _adapters_of_the_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))


def silent(text: str) -> None:
    pass


def test_every_solver_finds_the_proved_optimum_and_is_measured() -> None:
    graph = rotavg.simulate("grid", 64, noise=0.1, seed=1).graph
    names = ["rotavg", "rotavg-newton", "numpy-bcd", "numpy-sum", "scipy-lbfgs"]
    result = compare(Case("grid", graph), [BY_NAME[name] for name in names], Settings(), silent)
    assert [run.solver for run in result.runs] == names
    assert result.best_verdict == "proved"
    assert result.best == pytest.approx(rotavg.solve(graph).objective, rel=1e-12)
    for run in result.runs:
        assert run.outcome == "ok", run.message
        assert 0 <= run.excess < 1e-9
        assert run.verdict == "proved"
        assert 0 < run.cpu_s < run.wall_s + 0.1  # on one thread
        assert run.memory_mib >= 0


@pytest.mark.parametrize("kind", ["complete", "cycle"])  # a dense matrix, a sparse one
def test_numpy_peers_solve_weighted_graphs(kind: str) -> None:
    graph = rotavg.simulate(kind, 50, noise=0.1, seed=3).graph
    graph = graph.with_weights(np.random.default_rng(3).uniform(0.5, 2, graph.num_edges))
    optimum = rotavg.solve(graph).objective
    problem = Case(kind, graph).problem()
    dense = isinstance(measurement_matrix(problem), np.ndarray)
    assert dense == (kind == "complete")
    for solver in (Bcd(problem, ""), Sum(problem, "min_eigenvalue"), Lbfgs(problem, "")):
        solver.solve()
        assert "converged" in solver.claim()
        objective = rotavg.objective(graph, solver.rotations())
        assert objective == pytest.approx(optimum, rel=1e-6)


def test_an_adapter_with_a_wrong_convention_is_refused() -> None:
    wrong = [Solver(name, f"bench_adapters:{name}", "") for name in ("WrongWayIn", "WrongWayOut")]
    refused = refusals([*wrong, BY_NAME["rotavg-bcd"], BY_NAME["numpy-gpm"]], Settings(), silent)
    assert set(refused) == {"WrongWayIn", "WrongWayOut"}
    for reason in refused.values():
        assert "a convention is wrong" in reason


def test_what_goes_wrong_becomes_a_row_and_the_rest_goes_on() -> None:
    graph = rotavg.simulate("cycle", 30, noise=0.1, seed=1).graph
    wrong = [
        Solver(variant, "bench_adapters:GoesWrong", variant)
        for variant in ("crash", "raise", "sleep")
    ]
    missing = Solver("missing", "no_such_package:Solver")
    solvers = [*wrong, missing, BY_NAME["rotavg"]]
    result = compare(Case("cycle", graph), solvers, Settings(repeat=2, timeout=1.0), silent)
    *failed, good, again = result.runs
    assert [(run.solver, run.outcome) for run in failed] == [
        ("crash", "crashed"),
        ("raise", "error"),
        ("sleep", "timeout"),
        ("missing", "missing"),
    ]
    crash, error, timeout, absent = (run.message for run in failed)
    assert crash.startswith("SIGSEGV")
    assert error == "ValueError: no such luck"
    assert timeout == "no result in 1 s"
    assert "no_such_package" in absent
    assert good.succeeded
    assert again.succeeded
    assert "timeout: no result in 1 s" in markdown(result)


def test_the_evaluation_agrees_with_the_solver() -> None:
    graph = rotavg.simulate("sphere", 100, noise=0.2, seed=2).graph
    graph = graph.with_weights(np.random.default_rng(2).uniform(0.5, 2, graph.num_edges))
    early = rotavg.solve(graph, method="bcd", max_iterations=3)
    assert early.certificate is not None
    evaluation = Evaluator(graph)(early.rotations)
    assert evaluation.objective == pytest.approx(early.objective, rel=1e-12)
    assert evaluation.relative_gradient == pytest.approx(early.relative_gradient, rel=1e-9)
    assert evaluation.verdict == "not_certified"
    assert evaluation.relative_gap == pytest.approx(early.certificate.relative_gap, rel=1e-9)


def test_a_row_has_medians_of_the_costs_and_the_worst_of_the_answers() -> None:
    good = Run("s", 1, 0, "ok", cpu_s=1.0, wall_s=4.0, excess=0.0, verdict="proved")
    runs = [
        good,
        replace(good, repeat=1, cpu_s=3.0, wall_s=5.0, excess=0.1, verdict="not_certified"),
        replace(good, repeat=2, cpu_s=2.0, wall_s=9.0, excess=0.01),
        replace(good, threads=2, wall_s=2.0),
        Run("t", 1, 0, "crashed", "SIGSEGV"),
    ]
    one, two, crashed = rows(GraphResult("g", 2, 1, 1.0, "proved", tuple(runs)))
    assert (one.cpu_s, one.wall_s, one.excess) == (2.0, 5.0, 0.1)
    assert one.verdict == "not_certified"
    assert np.isnan(one.speed_up)
    assert two.speed_up == 2.5
    assert crashed.failure == "crashed: SIGSEGV"
    assert np.isnan(crashed.cpu_s)


def test_one_edge_of_a_pair_is_kept() -> None:
    indices = np.array([[2, 0], [0, 1], [0, 2], [1, 0], [1, 2]], dtype=np.int32)
    eye = np.eye(3)
    problem = Problem(indices, np.tile(eye, (5, 1, 1)), np.ones(5), np.tile(eye, (3, 1, 1)))
    assert kept_edges(problem).tolist() == [0, 1, 4]


def test_the_command_writes_table_record_plot_and_readme(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    readme = tmp_path / "README.md"
    readme.write_text("before\n<!-- figures: begin -->old<!-- figures: end -->\nafter\n")
    monkeypatch.setattr(report, "README", readme)
    graph = rotavg.simulate("cycle", 12, noise=0.1, seed=1).graph
    rotavg.write(tmp_path / "ring.g2o", graph)
    options = ["--solver=rotavg", "--repeat=2", f"--output={tmp_path / 'out'}", "--readme"]
    done = CliRunner().invoke(main, [str(tmp_path / "ring.g2o"), *options])
    assert done.exit_code == 0, done.output
    assert "ring: 12 nodes, 12 edges" in done.output
    record = json.loads((tmp_path / "out" / "results.json").read_text())
    assert record["settings"]["repeat"] == 2
    assert [run["outcome"] for run in record["graphs"][0]["runs"]] == ["ok", "ok"]
    assert (tmp_path / "out" / "plot.png").stat().st_size > 10_000
    written = readme.read_text()
    assert "| rotavg | converged, proved" in written
    assert "old" not in written
    assert written.startswith("before\n<!-- figures: begin -->\n")
    assert written.endswith("<!-- figures: end -->\nafter\n")
    assert CliRunner().invoke(main, ["no-such-graph"]).exit_code == 2


@pytest.mark.parametrize("program", ["distributed", "online", "threads", "rigs", "viewgraphs"])
def test_programs_tell_their_options(program: str) -> None:
    called = [sys.executable, "-m", f"benchmarks.{program}", "--help"]
    result = subprocess.run(called, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "usage" in result.stdout.lower()
