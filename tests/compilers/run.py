"""Compiles consumer.cpp in every way that users do, without a warning, and runs what comes out.

`./dev compilers` runs all combinations of compiler, standard, optimisation and way to include
rotavg (plainly, or as a system header: GCC's optimisers warn of those, too, where they are inlined
into a user's code), and prints a table. `--quick` is what the tests do: one combination for each
compiler. Eigen and SuiteSparse are always system headers, as their CMake targets make them.
"""

from __future__ import annotations

import argparse
import itertools
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]
_CONSUMER = Path(__file__).with_name("consumer.cpp")
_WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
_COMPILERS = ("g++-11", "g++-12", "clang++-14", "clang++-16")  # Debian 12's oldest and newest
_OPTIMISATIONS = ("-O0", "-O1", "-O2", "-O3")


@dataclass(frozen=True)
class Combination:
    compiler: str
    standard: str  # c++17
    how: str  # -I or -isystem
    optimisation: str  # -O2


@dataclass
class Outcome:
    seconds: float  # of CPU, to compile
    problem: str = ""  # in a word
    output: str = ""

    def __str__(self) -> str:
        return self.problem or f"{self.seconds:.0f} s"


def _all(compilers: list[str]) -> Iterator[Combination]:
    ways = itertools.product(compilers, ("c++17", "c++20"), ("-I", "-isystem"), _OPTIMISATIONS)
    return itertools.starmap(Combination, ways)


def _quick(compilers: list[str]) -> Iterator[Combination]:
    """Of GCC, whose optimisers warn; of Clang, which warns as it parses."""
    for compiler in compilers:
        version = subprocess.run([compiler, "--version"], capture_output=True, text=True).stdout
        if "clang" in version:
            yield Combination(compiler, "c++17", "-I", "-O0")
        else:
            yield Combination(compiler, "c++20", "-isystem", "-O1")


def _run(command: list[str], log: Path) -> tuple[int, float]:
    """Exit status and CPU seconds, its children's among them."""
    with log.open("w") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, usage.ru_utime + usage.ru_stime


def _try(c: Combination, system: list[str], work: Path) -> Outcome:
    name = "_".join((c.compiler.replace("/", "_"), c.standard, c.how, c.optimisation))
    log, program = work / f"{name}.log", str(work / name)
    rotavg = [c.how, str(_ROOT / "cpp" / "include")]
    includes = [*rotavg, *(f"-isystem{directory}" for directory in system)]
    command = [c.compiler, f"-std={c.standard}", c.optimisation, *_WARNINGS, *includes]
    command += [str(_CONSUMER), "-o", program, "-pthread", "-lamd"]
    status, seconds = _run(command, log)
    if status != 0:
        text = log.read_text(errors="replace")
        return Outcome(seconds, f"{max(1, text.count('error: '))} errors", text)
    status, _ = _run([program], log)
    if status != 0:
        return Outcome(seconds, "wrong", log.read_text(errors="replace"))
    return Outcome(seconds)


def _table(outcomes: dict[Combination, Outcome]) -> str:
    rows = [["compiler", "standard", "rotavg by", *_OPTIMISATIONS]]
    ways = dict.fromkeys((c.compiler, c.standard, c.how) for c in outcomes)
    for way in ways:
        cells = (outcomes.get(Combination(*way, o)) for o in _OPTIMISATIONS)
        rows.append([*way, *("" if cell is None else str(cell) for cell in cells)])
    widths = [max(map(len, column)) for column in zip(*rows)]
    rows.insert(1, ["-" * width for width in widths])
    lines = (" | ".join(cell.ljust(w) for cell, w in zip(row, widths)) for row in rows)
    return "\n".join(f"| {line} |" for line in lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("compilers", nargs="*", help=f"programs; default: {', '.join(_COMPILERS)}")
    parser.add_argument("--quick", action="store_true", help="one combination for each compiler")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N")
    parser.add_argument(
        "--system",
        nargs="+",
        default=["/usr/include/eigen3", "/usr/include/suitesparse"],
        metavar="FOLDER",
        help="the headers of Eigen and SuiteSparse (default: as on Debian)",
    )
    arguments = parser.parse_args()
    compilers: list[str] = arguments.compilers or list(_COMPILERS)
    missing = [compiler for compiler in compilers if shutil.which(compiler) is None]
    if missing:
        parser.error(f"not found: {', '.join(missing)}")
    combinations = list((_quick if arguments.quick else _all)(compilers))
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(arguments.jobs) as pool:
        work = Path(folder)
        done = pool.map(lambda c: _try(c, arguments.system, work), combinations)
        outcomes = {}
        for c, outcome in zip(combinations, done):
            outcomes[c] = outcome
            if outcome.problem:
                print(f"{c.compiler} {c.standard} {c.how} {c.optimisation}: {outcome.problem}")
                print(outcome.output, flush=True)
    print(_table(outcomes))
    return int(any(outcome.problem for outcome in outcomes.values()))


if __name__ == "__main__":
    sys.exit(main())
