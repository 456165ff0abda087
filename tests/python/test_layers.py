"""Folders are layers: imports run one way, in the orders of docs/architecture.md."""

from __future__ import annotations

import ast
import graphlib
import re
from collections.abc import Mapping
from pathlib import Path

import pytest

import rotavg

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python" / "rotavg"
HEADERS = ROOT / "cpp" / "include" / "rotavg"

Imports = Mapping[str, "set[str]"]


def documented_order(of: str) -> dict[str, int]:
    """The place of every folder; those between commas have the same."""
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    found = re.search(rf"```order {of}\n(.*?)```", page, re.DOTALL)
    assert found is not None, of
    groups = [group.split(",") for group in found[1].split("→")]
    return {name.strip(): place for place, group in enumerate(groups) for name in group}


def python_imports(package: Path) -> dict[str, set[str]]:
    """What every module imports of the package, in functions and for types as well."""
    modules = {
        ".".join(path.relative_to(package.parent).with_suffix("").parts).replace(
            ".__init__", ""
        ): path
        for path in package.rglob("*.py")
    }
    imports: dict[str, set[str]] = {}
    for module, path in modules.items():
        found: set[str] = set()
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names} & modules.keys()
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{module} imports relatively"
                names = {f"{node.module}.{alias.name}" for alias in node.names}
                found |= names & modules.keys()
                if names - modules.keys() and node.module in modules:
                    found.add(node.module)
        imports[module] = found
    return imports


def cpp_imports(headers: Path) -> dict[str, set[str]]:
    """What every header includes of the library, as module names like Python's.

    A header and its `_impl`, the definition of what it declares, are one module.
    """

    def module(path: str) -> str:
        return path[: -len(".hpp")].replace("/", ".").removesuffix("_impl")

    imports: dict[str, set[str]] = {}
    for path in headers.rglob("*.hpp"):
        name = module(path.relative_to(headers.parent).as_posix())
        included = re.findall(
            r'^\s*#\s*include\s*[<"](rotavg/[^>"]+)[>"]', path.read_text("utf-8"), re.MULTILINE
        )
        imports.setdefault(name, set()).update(set(map(module, included)) - {name})
    return imports


def folder_of(module: str) -> str:
    """rotavg.io.g2o is in io, rotavg.io is io, rotavg stands for itself."""
    return module.split(".")[1] if "." in module else module


def folders_of(imports: Imports) -> dict[str, set[str]]:
    folders: dict[str, set[str]] = {}
    for module, imported in imports.items():
        folder = folder_of(module)
        folders.setdefault(folder, set()).update(map(folder_of, imported))
    return {folder: imported - {folder} for folder, imported in folders.items()}


def check(imports: Imports, order: Mapping[str, int]) -> None:
    """No circle between modules, none between folders, and every import goes down the order."""
    graphlib.TopologicalSorter(imports).prepare()  # raises CycleError, which shows the circle
    folders = folders_of(imports)
    graphlib.TopologicalSorter(folders).prepare()
    assert folders.keys() == order.keys(), "docs/architecture.md names other folders"
    upwards = [
        f"{module} imports {other}"
        for module, imported in imports.items()
        for other in sorted(imported)
        if folder_of(module) != folder_of(other)
        and order[folder_of(module)] <= order[folder_of(other)]
    ]
    assert not upwards


def test_python_imports_run_one_way() -> None:
    imports = python_imports(PACKAGE)
    assert "rotavg.solving.solution" in imports["rotavg.solving.solve"]
    assert "rotavg.graph.networkx" in imports["rotavg.graph.measurement_graph"]  # a late one
    assert "rotavg.solving.solution" in imports["rotavg.io.edges"]  # one for types
    order = documented_order("python/rotavg")
    # The core lies below all folders, `python -m rotavg` above.
    check(imports, {**order, "_core": -1, "__main__": len(order)})


def test_cpp_includes_run_one_way() -> None:
    imports = cpp_imports(HEADERS)
    assert "rotavg.graph.measurement_graph" in imports["rotavg.solve.solve"]
    order = documented_order("cpp/include/rotavg")
    check(imports, {**order, "version": -1, "compiled": -1, "rotavg": len(order)})


def test_every_folder_is_on_the_page() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    for root in (PACKAGE, HEADERS):
        for folder in {path.parent.name for path in root.glob("*/*.[hp]*")} - {"__pycache__"}:
            assert re.search(rf"^  {folder}/ +\w", page, re.MULTILINE), folder


def test_no_folder_hides_a_public_name() -> None:
    # `import rotavg.solve` as a folder would put the module where the function was.
    folders = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert "graph" in folders
    assert not folders & set(rotavg.__all__)


@pytest.mark.parametrize(
    ("imports", "error"),
    [
        ({"rotavg.a.x": {"rotavg.b.y"}, "rotavg.b.y": {"rotavg.a.x"}}, graphlib.CycleError),
        ({"rotavg.a.x": {"rotavg.a.y"}, "rotavg.a.y": {"rotavg.a.x"}}, graphlib.CycleError),
        (  # a circle of folders, but none of modules
            {"rotavg.a.x": {"rotavg.b.y"}, "rotavg.b.y": set(), "rotavg.b.z": {"rotavg.a.x"}},
            graphlib.CycleError,
        ),
        ({"rotavg.a.x": {"rotavg.b.y"}, "rotavg.b.y": set()}, AssertionError),
        ({"rotavg.b.y": {"rotavg.c.z"}, "rotavg.c.z": set(), "rotavg.a": set()}, AssertionError),
        ({"rotavg.d.x": set()}, AssertionError),
    ],
)
def test_the_check_finds(imports: Imports, error: type[Exception]) -> None:
    with pytest.raises(error):
        check(imports, {"a": 0, "b": 1, "c": 1})


def test_late_imports_and_those_for_types_count(tmp_path: Path) -> None:
    package = tmp_path / "rotavg"
    (package / "a").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "a" / "__init__.py").write_text("")
    (package / "a" / "x.py").write_text(
        "from typing import TYPE_CHECKING\n\n"
        "if TYPE_CHECKING:\n    from rotavg.a import y\n\n\n"
        "def late():\n    import rotavg\n    from rotavg.a import nothing\n"
    )
    (package / "a" / "y.py").write_text("")
    assert python_imports(package)["rotavg.a.x"] == {"rotavg", "rotavg.a", "rotavg.a.y"}
