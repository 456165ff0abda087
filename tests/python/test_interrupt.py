"""Ctrl-C in the middle of the work."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

SETUP = """
import sys, rotavg
graph = rotavg.simulate("band", 20000, noise=0.2, seed=1).graph
print("ready", flush=True)
"""


@pytest.mark.parametrize(
    "work",
    [
        "rotavg.solve(graph, max_iterations=10**6, tolerance=0)",
        "rotavg.solve(graph, method='sum', max_iterations=10**6, tolerance=0, num_threads=2)",
        "rotavg.solve(graph, method='sum', mu='min_eigenvalue', max_iterations=10**6, tolerance=0)",
        "[rotavg.solve(graph, max_iterations=0) for _ in range(1000)]",
        "[rotavg.hardness(graph) for _ in range(1000)]",
    ],
)
def test_ctrl_c_comes_back_with_keyboard_interrupt(work: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SETUP + work],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.7)
        assert process.poll() is None, process.communicate()[1]
        process.send_signal(signal.SIGINT)
        # Within a second by design; the machine that runs the tests may be busy.
        _, errors = process.communicate(timeout=10)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == -signal.SIGINT
    assert errors.rstrip().endswith("KeyboardInterrupt")
