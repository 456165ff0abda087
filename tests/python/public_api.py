"""What users may rely on (docs/stability.md), one name a line: Python, the command line and C++.

python tests/python/public_api.py     # writes public_api.txt and public_api_cpp.txt anew
"""

from __future__ import annotations

import dataclasses
import enum
import importlib
import inspect
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rotavg
from rotavg.cli.main import commands

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
MODULES = ("rotavg", *(f"rotavg.{name}" for name in sorted({*dir(rotavg)} - {*rotavg.__all__})))
# Beside the first list of rotavg.hpp: what its functions take and return.
CPP_STRUCTS = (
    "certify/bound.hpp",
    "certify/component_certificate.hpp",
    "graph/edges.hpp",
    "graph/measurement.hpp",
    "io/format_error.hpp",
    "io/g2o.hpp",
    "io/g2o_write.hpp",
    "io/graph_file.hpp",
    "io/node_ids.hpp",
    "io/node_table.hpp",
    "io/source.hpp",
    "io/text.hpp",
    "io/vertex_poses.hpp",
    "robust/edge_knowledge.hpp",
    "robust/loss.hpp",
    "robust/rig_estimate.hpp",
    "solve/options.hpp",
    "solve/progress.hpp",
    "solve/result.hpp",
    "solve/status.hpp",
    "types.hpp",
)


def signature(function: Any) -> str:
    """Parameters with their types and defaults, as they are written."""
    parts, star = [], False
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is parameter.KEYWORD_ONLY and not star:
            parts.append("*")
            star = True
        star |= parameter.kind is parameter.VAR_POSITIONAL
        text = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        text += name
        if parameter.annotation is not parameter.empty:
            text += f": {parameter.annotation}"
        default = parameter.default
        if default is not parameter.empty:
            text += f" = {default}" if isinstance(default, enum.Enum) else f" = {default!r}"
        parts.append(text)
    return f"({', '.join(parts)})"


def members(name: str, cls: type) -> Iterator[str]:
    """The public members of a class, but for those of classes outside the package."""
    if issubclass(cls, enum.Enum):
        yield from (f"{name}.{member.name}" for member in cls)
    fields = {}
    if dataclasses.is_dataclass(cls):
        fields = {field.name: field.type for field in dataclasses.fields(cls)}
    yield from (f"{name}.{field}: {kind}" for field, kind in fields.items())
    for base in cls.__mro__:
        if not base.__module__.startswith("rotavg"):
            continue
        for attribute, value in vars(base).items():
            if attribute.startswith("_") or attribute in fields:
                continue
            if isinstance(value, (classmethod, staticmethod)):
                yield f"{name}.{attribute}{signature(value.__func__)}"
            elif inspect.isfunction(value):
                yield f"{name}.{attribute}{signature(value)}"
            elif isinstance(value, property) or hasattr(value, "attrname"):
                yield f"{name}.{attribute}"
        if not dataclasses.is_dataclass(base):
            for attribute, annotation in vars(base).get("__annotations__", {}).items():
                if not attribute.startswith("_"):
                    yield f"{name}.{attribute}: {annotation}"


def python_names() -> Iterator[str]:
    """Every public name of Python."""
    for module_name in MODULES:
        module = importlib.import_module(module_name)
        for name in module.__all__:
            value, full = getattr(module, name), f"{module_name}.{name}"
            if not inspect.isclass(value):
                yield full + (signature(value) if inspect.isfunction(value) else "")
            elif value.__module__.startswith("rotavg") and value is not rotavg.Progress:
                bases = [
                    base.__name__
                    for base in value.__bases__
                    if not base.__module__.startswith("rotavg") or hasattr(rotavg, base.__name__)
                ]
                yield f"class {full}({', '.join(bases)})"
                plain = issubclass(value, (Exception, enum.Enum)) or dataclasses.is_dataclass(value)
                if not plain:
                    yield f"{full}{signature(value)}"
                yield from members(full, value)
            else:
                yield f"class {full}"


def command_names() -> Iterator[str]:
    """Subcommands with their arguments and options."""
    for name, command in commands.commands.items():
        for parameter in command.params:
            option = "/".join((*parameter.opts, *parameter.secondary_opts))
            yield f"rotavg {name} {option}"


def cpp_names(output: Path) -> Iterator[str]:
    """Names of C++, as Doxygen finds them; see docs/site/cpp_reference.py."""
    sys.path.insert(0, str(ROOT / "docs" / "site"))
    import cpp_reference

    cpp_reference.run_doxygen(output=output)
    everything = (ROOT / "cpp/include/rotavg/rotavg.hpp").read_text("utf-8")
    entry_points = re.findall(r"#include <rotavg/(.*)>", everything.partition("#ifndef")[0])
    for path in sorted({*entry_points, *CPP_STRUCTS}):
        yield f"#include <rotavg/{path}>"
        for file in cpp_reference.headers(path.rpartition("/")[0]):
            if cpp_reference.location(file) == f"rotavg/{path}":
                for line in cpp_reference.header(file):
                    found = re.match(r"( *)\.\. cpp:(?!namespace)([\w-]+):: (.*)", line)
                    if found:
                        yield f"{found[1]}  {found[2]} {found[3]}"


def python_text() -> str:
    """The content of public_api.txt."""
    return "\n".join(dict.fromkeys([*python_names(), *command_names()])) + "\n"


def cpp_text(output: Path) -> str:
    """The content of public_api_cpp.txt; Doxygen writes into the folder `output`."""
    return "\n".join(cpp_names(output)) + "\n"


if __name__ == "__main__":
    (HERE / "public_api.txt").write_text(python_text(), encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        (HERE / "public_api_cpp.txt").write_text(cpp_text(Path(folder)), encoding="utf-8")
