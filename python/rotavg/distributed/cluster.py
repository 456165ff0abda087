"""The processes of one machine as a cluster, and what goes wrong with clusters."""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing import resource_tracker
from typing import Any

from rotavg.base.errors import SolverError, require

ON_THIS_MACHINE = {
    # A task that is taken from one worker by another takes its part along.
    "distributed.scheduler.work-stealing": False,
    # Else the profiler looks at every worker a hundred times a second.
    "distributed.worker.profile.enabled": False,
    # A process that dies closes its connections; one that is slow to answer is only busy.
    "distributed.comm.timeouts.tcp": "1 hour",
    "distributed.comm.timeouts.connect": "10 minutes",
    # Where none can be started any more, what waits for one would wait for ever.
    "distributed.scheduler.no-workers-timeout": "3 minutes",
}

_GIVEN_UP = 20.0  # seconds


def local_cluster(processes: ExitStack, workers: int | None = None) -> Any:
    """A client of processes on this machine, for as long as they are wanted.

    Args:
        processes: what ends them.
        workers: how many; by default one for each processor.
    """
    distributed = require("distributed", "distributed")
    config = require("dask", "distributed").config
    with _left_to_this_process(), config.set(ON_THIS_MACHINE):
        try:
            local = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address=":0",
                silence_logs=logging.CRITICAL,
            )
        except RuntimeError as error:
            raise SolverError(
                f"processes cannot be started here: {error} A program that does so needs "
                "`if __name__ == '__main__':` around what it does, as they import it"
            ) from error
        processes.enter_context(local)
        _keep_filled(local)
        return processes.enter_context(distributed.Client(local))


def _keep_filled(local: Any) -> None:
    """Have places filled again that Dask gives up.

    It does so where a process dies while it starts, and where one that died has not come back
    within 15 seconds, which on a busy machine is soon. What it does not take away by itself, as of
    a process that never came to the scheduler, is taken away after that time.
    """
    status = require("distributed", "distributed").core.Status
    ended: dict[Any, float] = {}  # since when, by the one who started the process

    def fill() -> None:
        if local.status != status.running:  # it is closed
            periodic.stop()
            return
        for name, nanny in list(local.workers.items()):
            if nanny.status not in (status.closed, status.failed):
                continue
            if time.monotonic() - ended.setdefault(nanny, time.monotonic()) > _GIVEN_UP:
                del local.workers[name], ended[nanny]
        if len(local.workers) < len(local.worker_spec):
            local.scale(len(local.worker_spec))

    periodic = require("tornado.ioloop", "distributed").PeriodicCallback(fill, 1000.0)
    local.loop.add_callback(periodic.start)


@contextmanager
def _left_to_this_process() -> Iterator[None]:
    """Ctrl-C waits; threads and processes that are started here never see it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # where that starts later, it unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def told_plainly() -> Iterator[None]:
    """What becomes of a cluster, as an error of ours."""
    distributed = require("distributed", "distributed")
    try:
        yield
    except distributed.KilledWorker as error:
        raise SolverError(
            f"workers died at one task, {error.allowed_failures + 1} of them: most likely there is "
            "not enough memory; expected more parts or fewer workers on a machine"
        ) from error
    except _without_workers(distributed) as error:
        raise SolverError(
            "no worker is left of the cluster, or all pause for want of memory, and none has come "
            f"for {error.timeout:g} s; expected more parts or fewer workers on a machine"
        ) from error
    except (distributed.CancelledError, distributed.comm.CommClosedError) as error:
        raise SolverError(f"the cluster was lost: {error}") from error


def _without_workers(distributed: Any) -> tuple[type[Any], ...]:
    """What tasks fail with where all workers are gone; schedulers wait as they are configured."""
    error = getattr(distributed.scheduler, "NoWorkerError", None)  # of newer ones
    return () if error is None else (error,)
