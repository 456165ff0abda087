"""A graph in parts on Dask: limits, lost workers, interruption, the command."""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg

distributed = pytest.importorskip("distributed", reason="needs the extra [distributed]")
pytest.importorskip("pymetis", reason="needs the extra [distributed]")

import dask  # noqa: E402

import rotavg.distributed.chebyshev as chebyshev  # noqa: E402
from rotavg.distributed import Interrupted, solve  # noqa: E402
from rotavg.distributed.cluster import local_cluster  # noqa: E402
from rotavg.distributed.deadline import Deadline  # noqa: E402

front = importlib.import_module("rotavg.distributed.solve")  # the function has its name

pytestmark = pytest.mark.filterwarnings("default")  # Dask's and Tornado's own

RUNNING = distributed.core.Status.running
GRAPH = rotavg.simulate("erdos_renyi", 90, noise=0.3, density=0.3, seed=4).graph


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=2, dashboard_address=":0"
    ) as one:
        yield one


@pytest.fixture(scope="module")
def processes() -> Iterator[Any]:
    with ExitStack() as two:
        yield local_cluster(two, workers=2)


def in_files(folder: Path, graph: rotavg.MeasurementGraph, count: int) -> Path:
    folder.mkdir()
    for k, rows in enumerate(np.array_split(np.arange(len(graph.edges)), count)):
        piece = rotavg.MeasurementGraph(graph.edges[rows], graph.rotations[rows])
        rotavg.write(folder / f"{k}.txt", piece)
    return folder


def test_limits_and_callbacks(client: Any) -> None:
    graph = GRAPH
    few = solve(graph, client=client, parts=3, max_rounds=1, certify=False)
    assert not few.converged
    assert few.reason == "the limit of 1 rounds"
    assert few.certificate is None
    stopped = solve(graph, client=client, parts=3, callback=lambda r: r.number < 2, certify=False)
    assert (stopped.reason, len(stopped.rounds)) == ("stopped", 3)
    late = solve(graph, client=client, parts=3, time_limit=0.0, certify=False)
    assert late.reason == "the time limit of 0.0 s"


def test_the_time_limit_holds_for_the_proof(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def late(now: bool) -> Any:
        def prove(rounds: Any, *arguments: Any, **options: Any) -> Any:
            if now:
                rounds.deadline = Deadline(0.0)
            else:  # in the middle
                run = chebyshev.Chebyshev.run

                def late_run(self: Any, *given: Any) -> Any:
                    self.deadline = Deadline(0.0)
                    return run(self, *given)

                monkeypatch.setattr(chebyshev.Chebyshev, "run", late_run)
            return whole(rounds, *arguments, **options)

        return prove

    whole = front.prove
    for now in (True, False):
        monkeypatch.setattr(front, "prove", late(now))
        found = solve(GRAPH, client=client, parts=3, tolerance=1e-6)
        assert found.converged
        assert not found.solved
        assert found.certificate is not None
        assert found.certificate.shortfall == "stopped"
        assert found.certificate.gap >= found.objective
        assert "stopped before the proof" in str(found)


def test_ctrl_c_in_the_proof_keeps_the_answer(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(front, "prove", interrupted)
    with pytest.raises(Interrupted) as stopped:
        solve(GRAPH, client=client, parts=3, tolerance=1e-6)
    found = stopped.value.solution
    assert found.objective == pytest.approx(rotavg.solve(GRAPH).objective, rel=1e-9)
    assert found.certificate is not None
    assert found.certificate.shortfall == "stopped"
    assert len(found.gather()[0]) == len(GRAPH.nodes)


@pytest.mark.parametrize(
    ("loss", "stages"),
    [
        ("l2", ["_read", "_split", "solve_alone", "solve_region", "_applied", "_write"]),
        ("auto", ["solve_alone_robustly", "reweighted"]),
    ],
)
def test_a_worker_may_die_at_any_time(
    processes: Any,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    loss: Any,
    stages: list[str],
) -> None:
    folder = in_files(tmp_path / "edges", GRAPH, 3)
    submit = distributed.Client.submit
    left = list(stages)

    def deadly(self: Any, function: Any, *arguments: Any, **options: Any) -> Any:
        future = submit(self, function, *arguments, **options)
        what = arguments[0] if function.__name__ == "_with_others" else function
        if left and what.__name__ == left[0]:
            left.pop(0)
            victim = next(iter(processes.run(os.getpid).values()))
            os.kill(victim, signal.SIGKILL)
        return future

    monkeypatch.setattr(distributed.Client, "submit", deadly)
    with solve(folder, client=processes, parts=2, loss=loss, tolerance=1e-6) as found:
        found.write(tmp_path / "out")
    assert left == []
    assert found.solved
    if loss == "l2":
        assert found.objective == pytest.approx(rotavg.solve(GRAPH).objective, rel=1e-9)
    nodes = [np.load(file)["nodes"] for file in sorted((tmp_path / "out").iterdir())]
    assert np.array_equal(np.sort(np.concatenate(nodes)), GRAPH.nodes)


def test_ctrl_c_is_not_lost_where_an_object_is_deleted(client: Any) -> None:
    class Deleted:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    def drop_one(round: Any) -> None:
        if round.number == 1:
            objects.clear()  # what is raised in __del__ would be dropped

    objects = [Deleted()]
    with pytest.raises(KeyboardInterrupt):
        solve(GRAPH, client=client, parts=3, tolerance=0.0, max_rounds=50, callback=drop_one)
    assert objects == []


def deadly_source() -> Any:
    os.kill(os.getpid(), signal.SIGKILL)


def test_where_no_worker_is_left_it_is_told() -> None:
    def all_go(round: Any) -> None:
        one.cluster.scale(0)

    soon = {"distributed.scheduler.no-workers-timeout": "1s"}
    with (
        dask.config.set(soon),
        distributed.Client(
            processes=False, n_workers=1, dashboard_address=":0", silence_logs=50
        ) as one,
        pytest.raises(rotavg.SolverError, match="no worker is left of the cluster"),
    ):
        solve(GRAPH, client=one, parts=2, tolerance=0.0, callback=all_go)


def test_a_task_that_kills_every_worker_is_told(processes: Any) -> None:
    with pytest.raises(rotavg.SolverError, match="workers died at one task"):
        solve([deadly_source], client=processes, parts=2)


@pytest.mark.parametrize("wait", [0.5, 1000.0])
def test_places_that_are_given_up_are_filled_again(
    processes: Any, monkeypatch: pytest.MonkeyPatch, wait: float
) -> None:
    monkeypatch.setattr("rotavg.distributed.cluster._GIVEN_UP", wait)  # else it is Dask that does
    cluster = processes.cluster
    deadline = time.monotonic() + 240.0
    while not cluster.workers:  # what other tests have ended may be given up itself
        assert time.monotonic() < deadline
        time.sleep(0.1)
    name, nanny = next(iter(cluster.workers.items()))
    processes.sync(nanny.close)  # as where its process dies while it starts
    while (now := cluster.workers.get(name, nanny)) is nanny or now.status != RUNNING:
        assert time.monotonic() < deadline
        time.sleep(0.1)


SLOW = """
import sys, time
import numpy as np
import rotavg
from rotavg.distributed import solve

def slow():
    print("reading", flush=True)
    time.sleep(600)

def tell(round):
    print("round", flush=True)

if __name__ == "__main__":
    graph = rotavg.simulate("sphere", 2000, noise=0.1, seed=1).graph
    try:
        solve([slow] if sys.argv[1] == "reading" else graph, parts=4, tolerance=0.0, callback=tell)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
        raise SystemExit(130)
"""


@pytest.mark.parametrize("stage", ["reading", "round"])
def test_ctrl_c_ends_all_processes(tmp_path: Path, stage: str) -> None:
    (tmp_path / "slow.py").write_text(SLOW)
    command = [sys.executable, "slow.py", stage]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == f"{stage}\n"
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the workers get it, too
        said = process.stdout.read()  # until the last of the processes has ended
        errors = process.stderr.read()
        assert process.wait(60) == 130
    assert "interrupted" in said
    print(errors)
    assert "Traceback" not in errors, errors
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.1)
    else:
        pytest.fail("a process is left")


def test_the_command_takes_a_folder(tmp_path: Path) -> None:
    graph = GRAPH
    (tmp_path / "edges").mkdir()
    for k, rows in enumerate(np.array_split(np.arange(len(graph.edges)), 3)):
        piece = rotavg.MeasurementGraph(graph.edges[rows], graph.rotations[rows])
        rotavg.write(tmp_path / "edges" / f"{k}.txt", piece)
    command = [sys.executable, "-m", "rotavg", "solve", "edges", "--distributed"]
    run = partial(subprocess.run, capture_output=True, text=True, check=False, cwd=tmp_path)
    done = run([*command, "--parts", "2", "-o", "out", "--json"])
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["objective"] == pytest.approx(rotavg.solve(graph).objective, rel=1e-9)
    assert told["certificate"]["verdict"] == "proved"
    assert len(list((tmp_path / "out").iterdir())) == 2
    for option, message in (
        ("--anisotropic", "--anisotropic is not possible with --distributed"),
        ("--scheduler=tcp://127.0.0.1:9", "no scheduler answers at"),
    ):
        done = run([*command, option])
        assert done.returncode == 2
        assert message in done.stderr
        assert "Traceback" not in done.stderr
    done = run([*command[:-1], "--parts", "2"])
    assert "--parts is for --distributed, which is not given" in done.stderr
