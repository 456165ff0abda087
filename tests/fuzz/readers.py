"""Readers against files that are nearly right: graphs, rotations, or an error that says where.

    python -m tests.fuzz.readers --cases 20000            # all readers; about half a minute each
    python -m tests.fuzz.readers --format g2o --seed 7 --cases 1   # one case again, and its file

Every case takes a good file of the format, changes it in a few places, and reads it. What is read
must be sound: finite rotations, and finite ones solved for. What is refused must be refused by a
rotavg.Error that names the file. Anything else is a fault: another exception, a warning from NumPy,
more than `SLOW` seconds. Case k of a run has the seed `--seed` + k.
"""

from __future__ import annotations

import argparse
import re
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import rotavg
from rotavg.io import FORMATS
from rotavg.io.pose_priors import priors_in
from rotavg.io.priors import priors_of_poses
from tests.fuzz.beside import BESIDE, good_files_beside
from tests.fuzz.good_files import good_files
from tests.fuzz.mutations import mutated, pick

READERS = (*(form.name for form in FORMATS if form.read or form.rotations), *BESIDE)
SLOW = 1.0  # seconds of processor time; the files are tiny


@dataclass
class Tally:
    """What became of the cases of one reader."""

    read: int = 0
    refused: int = 0
    with_line: int = 0
    slowest: float = 0.0
    faults: list[str] = field(default_factory=list)
    messages: Counter[str] = field(default_factory=Counter)


@contextmanager
def alarm(seconds: int) -> Iterator[None]:
    """TimeoutError in what takes longer, where the system can."""

    def ring(*_: object) -> None:
        raise TimeoutError(f"still at it after {seconds} s")

    if not hasattr(signal, "SIGALRM"):
        yield
        return
    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _sound(graph: rotavg.MeasurementGraph, solve: bool) -> None:
    R = graph.rotations
    assert np.isfinite(R).all()
    assert graph.num_edges == 0 or np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max() < 1e-9
    assert (graph.weights > 0).all()
    assert np.isfinite(graph.weights).all()
    if solve and graph.num_edges > 0:
        solution = rotavg.solve(graph, max_iterations=200, num_threads=1)
        assert np.isfinite(solution.rotations).all()
        assert np.isfinite(solution.objective)


def _read(form: Any, path: Path, how: int) -> None:
    """Read a file in one of the ways that there are."""
    told = form.name if how % 2 else None
    columns = "i,j,qw,qx,qy,qz,weight" if how % 11 == 7 and form.name in ("text", "csv") else None
    # A solution's file, or one by hand, may be taken for a graph, and the other way round.
    rarely = 9 if path.parent.name == "s" else 1
    if form.read is None or (form.rotations is not None and how % 10 < rarely):
        ids, rotations = rotavg.read_rotations(path, format=told)
        assert np.isfinite(rotations).all()
        assert len(ids) == len(rotations)
    else:
        graph = rotavg.read(
            path,
            format=told,
            unit_weights=how % 5 == 0,
            skip_self_edges=how % 7 == 0,
            columns=columns,
        )
        _sound(graph, solve=how % 8 == 0)
        found = priors_in(graph.source)
        if found is not None:
            priors = priors_of_poses(found, graph)
            assert not priors.fixed
            for R, weight in priors.absolute.values():
                assert np.isfinite(R).all()
                assert 0 < weight < np.inf
            for known in priors.positions.values():
                assert all(np.isfinite(part).all() for part in known)


def one_case(read: Callable[[], None], place: str, tally: Tally) -> None:
    """Read, and keep what came of it; an error has to name the place."""
    began = time.thread_time()
    try:
        with alarm(60), warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", rotavg.IncompleteWarning)
            read()
        tally.read += 1
    except rotavg.Error as error:
        tally.refused += 1
        line = getattr(error, "line", None)
        tally.with_line += line is not None
        tally.messages[
            re.sub(r"'[^']*'|[-\d.e+]+", "~", str(error).replace(place, "PATH"))[:90]
        ] += 1
        if place not in str(error):
            tally.faults.append(f"the error does not name the file: {error}")
    except Exception:
        tally.faults.append(traceback.format_exc(limit=-4))
    seconds = time.thread_time() - began
    tally.slowest = max(tally.slowest, seconds)
    if seconds > SLOW:
        tally.faults.append(f"took {seconds:.1f} s")


def fuzz(name: str, cases: int, seed: int, keep: Path | None = None) -> Tally:
    """So many cases of one reader; files with which something went wrong go to `keep`."""
    form = next((form for form in FORMATS if form.name == name), None)
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder:
        good = (
            good_files_beside(Path(folder) / "good", name)
            if form is None
            else good_files(Path(folder) / "good")[name]
        )
        read = BESIDE[name].read if form is None else partial(_read, form)
        for k in range(cases):
            rng = np.random.default_rng(seed + k)
            source = pick(rng, good)
            path = Path(folder) / "case" / source.parent.name / source.name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(mutated(source, rng))
            place = str(path.parent if form and form.main_file else path)
            before = len(tally.faults)
            one_case(partial(read, path, int(rng.integers(1000))), place, tally)
            if len(tally.faults) > before:
                tally.faults[-1] = f"seed {seed + k}: {tally.faults[-1]}"
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{name}_{seed + k}_{source.name}").write_bytes(path.read_bytes())
    return tally


def main() -> None:
    """Fuzz, print a line for each format and what went wrong; exit status 1 if anything did."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--format", action="append", metavar="NAME", help="default: all")
    parser.add_argument("--cases", type=int, default=20000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path("build/fuzz"), metavar="FOLDER")
    parser.add_argument("--messages", action="store_true", help="print the commonest errors")
    arguments = parser.parse_args()
    wrong = 0
    for name in arguments.format or READERS:
        tally = fuzz(name, arguments.cases, arguments.seed, arguments.keep)
        print(
            f"{name}: {tally.read} read, {tally.refused} refused ({tally.with_line} with a line), "
            f"slowest {tally.slowest:.2f} s, {len(tally.faults)} faults",
            flush=True,
        )
        for fault in tally.faults[:5]:
            print(fault)
        if arguments.messages:
            for message, count in tally.messages.most_common(40):
                print(f"  {count:6d}  {message}")
        wrong += len(tally.faults)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
