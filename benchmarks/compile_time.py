"""What programs that use the C++ library cost to compile: CPU seconds and peak memory.

`./dev bench compile`, or `python -m benchmarks.compile_time`. No cache and no precompiled header
has a part in it.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

_ROOT = Path(__file__).resolve().parents[1]
_COMPILERS = ("g++", "clang++", "clang++-14", "clang++-16", "clang++-19")
_INCLUDES = ("/usr/include/eigen3", "/usr/include/suitesparse")


def _programs() -> dict[str, tuple[str, list[str]]]:
    """Source and further options by name."""
    readme = (_ROOT / "README.md").read_text(encoding="utf-8")
    found = re.search(r"```cpp\n(.*?)```", readme, re.DOTALL)
    assert found, "the README has no C++ program"
    sources = {
        name: (path.read_text(encoding="utf-8"), ["-DROTAVG_COMPILED"])
        for name in ("certify", "solve")
        for path in [_ROOT / "cpp" / "src" / f"{name}.cpp"]
    }
    return {
        "the README's program": (found[1], []),
        "the same, rotavg::compiled": (found[1], ["-DROTAVG_COMPILED"]),
        "solve/bcd.hpp alone": ("#include <rotavg/solve/bcd.hpp>\n", []),
        "Eigen/Core alone": ("#include <Eigen/Core>\nint main() {}\n", []),
        **{f"cpp/src/{name}.cpp": source for name, source in sources.items()},
    }


def _compile(compiler: str, source: str, options: list[str]) -> tuple[float, float]:
    """CPU seconds and peak megabytes of one compilation."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "program.cpp"
        file.write_text(source, encoding="utf-8")
        command = [compiler, "-std=c++17", *options, "-c", str(file), "-o", f"{file}.o"]
        child = os.posix_spawnp(compiler, command, {**os.environ, "CCACHE_DISABLE": "1"})
        _, status, usage = os.wait4(child, 0)
    if status != 0:
        raise click.ClickException(f"failed: {' '.join(command)}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


@click.command()
@click.option("--compiler", "compilers", multiple=True, help="Default: g++ and clang, if there.")
@click.option("--include", "includes", multiple=True, default=_INCLUDES, show_default=True)
@click.option("--optimisation", default="-O2", show_default=True)
@click.option(
    "--runs", type=click.IntRange(1), default=1, show_default=True, help="The least counts."
)
def main(
    compilers: tuple[str, ...], includes: tuple[str, ...], optimisation: str, runs: int
) -> None:
    """CPU seconds and peak memory of compiling programs that use the C++ library."""
    compilers = compilers or tuple(name for name in _COMPILERS if shutil.which(name))
    table = Table("program", *(f"{name} (CPU s / MB)" for name in compilers))
    folders = [f"-I{_ROOT / 'cpp' / 'include'}", *(f"-isystem{path}" for path in includes)]
    for name, (source, options) in _programs().items():
        cells = []
        for compiler in compilers:
            costs = [
                _compile(compiler, source, [optimisation, *folders, *options]) for _ in range(runs)
            ]
            cells.append(f"{min(c[0] for c in costs):.1f} / {min(c[1] for c in costs):.0f}")
        table.add_row(name, *cells)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
