"""The package as a whole."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
from pathlib import Path

import rotavg


def test_importing_needs_numpy_alone() -> None:
    code = (
        "import sys; before = set(sys.modules); import rotavg;"
        "print(*sorted({m.split('.')[0] for m in set(sys.modules) - before}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "numpy" in loaded
    assert not loaded & {"click", "rich", "scipy", "networkx", "matplotlib", "pandas"}


def test_the_command_names_what_it_misses() -> None:
    code = "import sys; sys.modules['click'] = None; import rotavg.cli; rotavg.cli.main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "the command line needs click: pip install" in done.stderr


def test_types_ship_with_the_package() -> None:
    assert (Path(rotavg.__file__).parent / "py.typed").is_file()


def test_the_stub_of_the_core_matches_the_core(tmp_path: Path) -> None:
    # What pybind11 adds of its own: a metaclass, and an __init__ that only raises.
    allowed = tmp_path / "allowed.txt"
    names = ("MeasurementGraph", "GroundedGraph", "Priors", "Rigs", "Progress", "Progress.__init__",
             "Online", "OnlineState", "OnlineState.__init__")  # fmt: skip
    allowed.write_text("".join(f"rotavg._core.{name}\n" for name in names))
    done = subprocess.run(
        [sys.executable, "-m", "mypy.stubtest", "rotavg._core", "--allowlist", str(allowed)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_version_is_one() -> None:
    assert rotavg.__version__ == importlib.metadata.version("rotavg")
    assert rotavg._core.__version__ == rotavg.__version__


def test_everything_public_is_documented() -> None:
    for name in rotavg.__all__:
        if name != "__version__":
            assert (getattr(rotavg, name).__doc__ or "").strip(), name
