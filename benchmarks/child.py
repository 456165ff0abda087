"""The process in which one solver solves one problem once: `python -m benchmarks.child JOB`.

JOB is the JSON text of a `Job`. The rotations and a record of the measurement go into its files.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import resource
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.problem import Adapter, Problem


@dataclass(frozen=True)
class Job:
    """What to run, and where things are.

    Attributes:
        adapter, variant: as in `Solver`.
        problem: the problem's file.
        warm_up: file of a small problem that is solved first, so that what a library does once,
            at its first call, is not measured.
        rotations, record: files to write.
        threads: processors to use.
        timeout: seconds of wall time for `solve`; the process ends itself then.
        memory_gib: limit on the address space.
    """

    adapter: str
    variant: str
    problem: str
    warm_up: str
    rotations: str
    record: str
    threads: int
    timeout: float
    memory_gib: float


def main(text: str) -> None:
    """Run the job; what goes wrong in it is written into the record."""
    job = Job(**json.loads(text))
    record: dict[str, object] = {}
    try:
        _confine(job)
        record = _measure(job)
    except Exception as error:
        first_line = (str(error).strip() or "no message").splitlines()[0]
        record["error"] = f"{type(error).__name__}: {first_line}"
        record["missing"] = isinstance(error, ModuleNotFoundError)
        raise
    finally:
        Path(job.record).write_text(json.dumps(record), encoding="utf-8")


def _measure(job: Job) -> dict[str, object]:
    module, _, name = job.adapter.partition(":")
    adapter_class = getattr(importlib.import_module(module), name)

    def adapter(path: str) -> Adapter:
        time_limit = 0.9 * job.timeout
        problem = Problem.load(Path(path), threads=job.threads, time_limit=time_limit)
        solver: Adapter = adapter_class(problem, job.variant)
        return solver

    adapter(job.warm_up).solve()
    gc.collect()

    before_mib = _reset_peak_memory()
    prepare_start = time.perf_counter()
    solver = adapter(job.problem)
    # SIGALRM's default action ends the process even in the midst of a library's C++ code.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, job.timeout)
    wall, cpu = time.perf_counter(), _cpu_seconds()
    solver.solve()
    cpu, end = _cpu_seconds() - cpu, time.perf_counter()
    signal.setitimer(signal.ITIMER_REAL, 0)
    peak_mib = _status_mib("VmHWM")

    np.save(job.rotations, np.asarray(solver.rotations(), dtype=np.float64))
    return {
        "cpu_s": cpu,
        "wall_s": end - wall,
        "prepare_s": wall - prepare_start,
        "memory_mib": peak_mib - before_mib,
        "claim": solver.claim(),
    }


def _confine(job: Job) -> None:
    """Allow this process, and so every thread that a library may start, what the job says."""
    limit = int(job.memory_gib * 2**30)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: job.threads])


def _cpu_seconds() -> float:
    """CPU time of all threads of this process and of the processes that it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _reset_peak_memory() -> float:
    """Resident memory in MiB, from which `VmHWM` counts from now on (Linux, proc(5))."""
    with contextlib.suppress(OSError):  # without it, the peak includes that of the imports
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _status_mib("VmRSS")


def _status_mib(field: str) -> float:
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) / 1024
    return float("nan")


if __name__ == "__main__":
    main(sys.argv[1])
