"""Runs a coverage-guided fuzzer of tests/fuzz/*.cpp from seeds that are made here.

    ./dev fuzz 600                                                 # both, 600 seconds each
    python -m tests.fuzz.coverage build/sanitize/tests/fuzz/fuzz_readers --seconds 60

What it finds interesting is kept in build/fuzz/NAME and run first the next time; an input that
crashes it lies in build/fuzz, named in its output; run with that as its argument, the fuzzer fails
again.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

from tests.fuzz.good_files import good_files

BUILD = Path(__file__).resolve().parents[2] / "build" / "fuzz"
# Which reader the first byte of an input stands for.
READERS = {"g2o": b"\x00", "text": b"\x02", "csv": b"\x04"}
ROTATIONS, GRAVITY = b"\x06", b"\x07"


def seeds(name: str) -> list[bytes]:
    """Inputs to begin with."""
    if name != "fuzz_readers":  # numbers of moderate size
        rng = np.random.default_rng(0)
        return [rng.integers(16, 256, size=40 * k, dtype=np.uint8).tobytes() for k in range(1, 13)]
    found = [GRAVITY + b"a 0 1 0\nb 0 0.5 -1\n"]
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        good = good_files(Path(folder))
        for form, byte in READERS.items():
            for path in good[form]:
                is_solution = path.parent.name == "s" and form != "g2o"
                lines = path.read_bytes().splitlines(keepends=True)
                found.append((ROTATIONS if is_solution else byte) + b"".join(lines[:8]))
    return found


def run(program: Path, seconds: int) -> int:
    """Replay what is known, and go on from there; the fuzzer's exit status."""
    corpus = BUILD / program.name
    corpus.mkdir(parents=True, exist_ok=True)
    for k, content in enumerate(seeds(program.name)):
        (corpus / f"seed_{k}").write_bytes(content)
    options = [f"-max_total_time={seconds}", "-timeout=10", "-rss_limit_mb=4096", "-max_len=4096"]
    options += [f"-artifact_prefix={BUILD}/", "-print_final_stats=1", "-verbosity=0"]
    sanitizers = {"ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    done = subprocess.run(
        [program, *options, corpus], env={**os.environ, **sanitizers}, check=False
    )
    return done.returncode


def main() -> None:
    """Exit status 1 if a fuzzer found something."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("programs", nargs="+", type=Path)
    parser.add_argument("--seconds", type=int, default=60, help="each")
    arguments = parser.parse_args()
    found = [run(program.resolve(), arguments.seconds) for program in arguments.programs]
    sys.exit(any(found))


if __name__ == "__main__":
    main()
