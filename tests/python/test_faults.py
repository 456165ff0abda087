"""Full disks, killed processes, callbacks that raise, threads, forks, and the program's end."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Callable

import pytest

import rotavg

HERE = Path(__file__).resolve().parent
DEVICE = Path("/dev/full")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python; what hangs is a failure."""
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, timeout=120)


def failing_writes(how: str) -> dict[str, dict[str, Any]]:
    pytest.importorskip("resource", reason="limits are those of Unix")
    ended = run(str(HERE / "failing_writes.py"), how)
    assert ended.returncode == 0, ended.stderr
    found: dict[str, dict[str, Any]] = json.loads(ended.stdout)
    assert len(found) > 20
    return found


def test_a_full_disk_leaves_every_file_as_it_was() -> None:
    for name, found in failing_writes("full").items():
        assert found["outcome"].startswith("FileAccessError: FOLDER"), (name, found)
        assert "cannot be written: File too large" in found["outcome"], (name, found)
        assert found["old"], (name, found)
        assert found["beside"] == {}, (name, found)
        assert found["again"], (name, found)


def test_a_killed_process_leaves_every_file_as_it_was() -> None:
    for name, found in failing_writes("killed").items():
        assert found["signal"] != 0, (name, found)
        assert found["outcome"] == "", (name, found)
        assert found["old"], (name, found)
        # What was begun stands beside, under a name that no reader takes for a file of its own.
        assert max(found["beside"].values(), default=0) <= found["size"] // 2, (name, found)
        assert all(n.startswith(".") and n.endswith(".tmp") for n in found["beside"]), (name, found)
        assert found["again"], (name, found)


@pytest.mark.skipif(not DEVICE.exists(), reason="there is no /dev/full")
def test_a_device_that_is_full() -> None:
    graph = rotavg.simulate("cycle", 500).graph
    with pytest.raises(rotavg.FileAccessError, match=r"/dev/full: .*No space left on device"):
        rotavg.write(DEVICE, graph, format="csv")
    report = "/dev/full: cannot be written: No space left on device"
    with pytest.raises(rotavg.FileAccessError, match=report):
        rotavg.write_edges(DEVICE, rotavg.solve(graph))


GRAPHS = [
    rotavg.simulate("sphere", 400, noise=0.1, seed=1).graph,
    rotavg.simulate("erdos_renyi", 300, density=0.3, noise=0.3, outliers=0.1, seed=2).graph,
    rotavg.simulate("band", 1000, noise=0.2, seed=3).graph,
]
WAYS: list[dict[str, Any]] = [
    {},
    {"method": "sum", "max_iterations": 30},
    {"method": "bcd", "init": "chordal", "max_iterations": 30},
]


def answer(graph: rotavg.MeasurementGraph, **options: Any) -> bytes:
    return rotavg.solve(graph, num_threads=2, **options).rotations.tobytes()


def test_solves_in_several_threads_at_once_have_the_same_bits() -> None:
    work = [(graph, way) for graph in GRAPHS for way in WAYS]
    expected = [answer(graph, **way) for graph, way in work]
    barrier = threading.Barrier(4)

    def all_of_them(first: int) -> list[bytes]:
        barrier.wait()
        order = work[first:] + work[:first]
        found = [answer(graph, **way) for graph, way in order]
        return found[len(work) - first :] + found[: len(work) - first]

    with ThreadPoolExecutor(4) as pool:
        assert all(found == expected for found in pool.map(all_of_them, (0, 0, 4, 7)))


def test_what_a_graph_keeps_is_made_once_for_all_threads() -> None:
    for _ in range(20):
        graph = rotavg.simulate("sphere", 200, noise=0.1).graph
        solution = rotavg.solve(graph)
        barrier = threading.Barrier(4)

        def look(
            k: int,
            solution: rotavg.Solution = solution,
            barrier: threading.Barrier = barrier,
        ) -> tuple[Any, ...]:
            barrier.wait()
            graph = solution.graph
            return (
                graph.edges.tobytes(), graph.rotations.tobytes(), graph.weights.tobytes(),
                solution.residual_angles.tobytes(), solution.covariances().tobytes(), str(solution),
            )  # fmt: skip

        with ThreadPoolExecutor(4) as pool:
            assert len(set(pool.map(look, range(4)))) == 1


class MyError(Exception):
    pass


@pytest.mark.parametrize("method", ["auto", "bcd", "sum", "newton", "bcdsr"])
@pytest.mark.parametrize("loss", ["l2", "huber", "auto"])
def test_a_callback_that_raises_is_heard_and_does_no_harm(method: Any, loss: Any) -> None:
    if loss != "l2" and method == "bcdsr":
        pytest.skip("not for robust losses")
    graph = rotavg.simulate("erdos_renyi", 60, density=0.3, noise=0.5, seed=4).graph
    options: dict[str, Any] = {"method": method, "loss": loss, "init": "random", "num_threads": 3}
    expected = rotavg.solve(graph, **options)
    calls = 0

    def fail_at(last: int) -> Callable[[rotavg.Progress], None]:
        def callback(progress: rotavg.Progress) -> None:
            nonlocal calls
            calls += 1
            if calls == last:
                raise MyError(f"call {last}")

        return callback

    for last in (1, 2, 3):
        calls = 0
        with pytest.raises(MyError, match=f"^call {last}$"):
            rotavg.solve(graph, callback=fail_at(last), **options)
        assert calls == last  # and not again
    again = rotavg.solve(graph, **options)
    assert again.rotations.tobytes() == expected.rotations.tobytes()


def test_callbacks_that_raise_in_several_threads_at_once() -> None:
    graph = GRAPHS[1]
    expected = answer(graph)

    def one(k: int) -> bytes:
        def callback(progress: rotavg.Progress) -> None:
            if k % 2:
                raise MyError(str(k))

        try:
            return rotavg.solve(graph, num_threads=2, callback=callback).rotations.tobytes()
        except MyError as error:
            return str(error).encode()

    with ThreadPoolExecutor(4) as pool:
        for k, found in enumerate(pool.map(one, range(24))):
            assert found == (str(k).encode() if k % 2 else expected)
    assert answer(graph) == expected


def test_a_solve_within_a_callback() -> None:
    graph, inner = GRAPHS[1], GRAPHS[0]
    expected = answer(inner)
    found = []

    def callback(progress: rotavg.Progress) -> None:
        if not found:
            found.append(answer(inner))

    assert (
        answer(graph) == rotavg.solve(graph, num_threads=2, callback=callback).rotations.tobytes()
    )
    assert found == [expected]


FORK = """
import os, signal, sys, threading, rotavg
graph = rotavg.simulate("band", 1000, noise=0.2, seed=3).graph
solve = lambda **more: rotavg.solve(graph, num_threads=3, **more).rotations.tobytes()
sweeps = dict(method="sum", max_iterations=30)
expected, expected_sum = solve(), solve(**sweeps)

def in_a_child():
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        ok = solve() == expected and solve(**sweeps) == expected_sum
        grandchild = os.fork()
        if grandchild == 0:
            signal.alarm(60)
            os._exit(0 if ok and solve() == expected else 1)
        os._exit(0 if ok and os.waitpid(grandchild, 0)[1] == 0 else 1)
    assert os.waitpid(child, 0)[1] == 0
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
@pytest.mark.parametrize(
    "when",
    [
        "in_a_child(); assert solve() == expected",
        "solve(callback=lambda p: in_a_child() if p.iteration == 3 else None, **sweeps)",
        "busy = threading.Thread(target=lambda: [solve(**sweeps) for _ in range(50)])\n"
        "busy.start()\n"
        "for _ in range(3): in_a_child()\n"
        "busy.join()",
        "import multiprocessing\n"
        "pool = multiprocessing.get_context('fork').Pool(2)\n"
        "assert pool.map(rotavg.solve, [graph] * 4)[3].rotations.tobytes() == expected\n"
        "pool.close(); pool.join()",
    ],
)
def test_a_fork_after_and_during_a_solve(when: str) -> None:
    ended = run("-c", f"import warnings; warnings.simplefilter('ignore')\n{FORK}{when}")
    assert (ended.returncode, ended.stderr) == (0, "")


# These are at one solve. (Of programs whose daemon threads solve in a loop while they end, about
# one in thirty still dies with a signal.)
EXIT = """
import sys, threading, time, rotavg
graph = rotavg.simulate("band", 20000, noise=0.2, seed=1).graph
begun = threading.Event()
endless = dict(max_iterations=10**6, tolerance=0, num_threads=2)
def work():
    begun.set()
    {work}
for _ in range(2):
    threading.Thread(target=work, daemon=True).start()
begun.wait()
time.sleep(0.5)
{end}
"""


@pytest.mark.parametrize(
    "work",
    [
        "rotavg.solve(graph, method='sum', **endless)",
        "rotavg.solve(graph, method='bcd', callback=lambda progress: None, **endless)",
    ],
)
@pytest.mark.parametrize("end", ["", "sys.exit(0)"])
def test_the_program_ends_while_threads_solve(work: str, end: str) -> None:
    ended = run("-c", EXIT.format(work=work, end=end))
    assert (ended.returncode, ended.stderr) == (0, "")
