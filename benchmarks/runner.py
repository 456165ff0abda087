"""One solver on one problem in a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks.child import Job
from benchmarks.solvers import Solver

ROOT = Path(__file__).resolve().parents[1]

# Reading, conversion into the solver's types and the small problem before, all together.
PREPARATION_LIMIT_S = 300.0

_THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


@dataclass(frozen=True)
class Limits:
    """What every solver may use: processors, seconds of wall time to solve, memory."""

    threads: int = 1
    timeout: float = 60.0
    memory_gib: float = 16.0


@dataclass(frozen=True, eq=False)
class Measurement:
    """What came of one run.

    Attributes:
        outcome: "ok", "timeout", "crashed" (ended by a signal), "error" (an exception) or
            "missing" (a package is not installed).
        message: what went wrong, in one line.
        rotations: (n, 3, 3) world_from_node, None unless "ok".
        cpu_s, wall_s: of the call that solves: all threads, all child processes.
        prepare_s: wall time of the conversion before it.
        memory_mib: resident memory that conversion and solution added at their peak.
        claim: what the solver says of its answer.
    """

    outcome: str
    message: str = ""
    rotations: NDArray[np.float64] | None = None
    cpu_s: float = np.nan
    wall_s: float = np.nan
    prepare_s: float = np.nan
    memory_mib: float = np.nan
    claim: str = ""


def measure(solver: Solver, problem: Path, warm_up: Path, limits: Limits) -> Measurement:
    """Run the solver once; whatever happens to its process is told, not raised."""
    with TemporaryDirectory(prefix="rotavg-bench-") as folder:
        job = Job(
            adapter=solver.adapter,
            variant=solver.variant,
            problem=str(problem),
            warm_up=str(warm_up),
            rotations=f"{folder}/rotations.npy",
            record=f"{folder}/record.json",
            **asdict(limits),
        )
        ended, output = _run(job, limits)
        if not ended:
            return Measurement("timeout", f"not prepared in {PREPARATION_LIMIT_S:g} s")
        return _read(job, ended.returncode, output)


def _run(job: Job, limits: Limits) -> tuple[subprocess.Popen[bytes] | None, str]:
    """The ended process, None where it had to be killed, and what it printed."""
    command = [sys.executable, "-m", "benchmarks.child", json.dumps(asdict(job))]
    with Path(f"{job.record}.log").open("w+b") as log:
        process = subprocess.Popen(
            command,
            cwd=ROOT,
            env=_environment(os.environ, limits.threads),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        ended: subprocess.Popen[bytes] | None = process
        try:
            process.wait(PREPARATION_LIMIT_S + limits.timeout)
        except subprocess.TimeoutExpired:
            ended = None
        finally:
            _kill_group(process)
        log.seek(0)
        return ended, log.read().decode(errors="replace")


def _kill_group(process: subprocess.Popen[bytes]) -> None:
    """End whatever is left of the process and of those that it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _read(job: Job, returncode: int, output: str) -> Measurement:
    if returncode == -signal.SIGALRM:
        return Measurement("timeout", f"no result in {job.timeout:g} s")
    if returncode < 0:
        name = signal.Signals(-returncode).name
        return Measurement("crashed", f"{name}: {_last_line(output)}")
    record_file = Path(job.record)
    record = json.loads(record_file.read_text(encoding="utf-8")) if record_file.exists() else {}
    if "error" in record:
        return Measurement("missing" if record["missing"] else "error", record["error"])
    if returncode != 0 or not record:
        return Measurement("crashed", f"exit status {returncode}: {_last_line(output)}")
    return Measurement("ok", rotations=np.load(job.rotations), **record)


def _last_line(output: str) -> str:
    lines = output.strip().splitlines()
    return lines[-1].strip() if lines else "no message"


def _environment(inherited: Mapping[str, str], threads: int) -> dict[str, str]:
    return {**inherited, **dict.fromkeys(_THREAD_VARIABLES, str(threads))}
