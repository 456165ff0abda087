"""The Python reference: docstrings as they are written here, as reStructuredText.

    .. public-names:: rotavg.plot

stands for every name in that module's `__all__`, classes with their public members.
"""

from __future__ import annotations

import importlib
import inspect
import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.domains.python import PyObject
from sphinx.util.docutils import SphinxDirective


def plain(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings use `code` alone: all else that reStructuredText takes for markup is text."""
    for k, line in enumerate(lines):
        pieces = re.split(r"(``?[^`]+``?)", line)
        pieces[::2] = [re.sub(r"([*|]|(?<=\w)_(?!\w))", r"\\\1", piece) for piece in pieces[::2]]
        lines[k] = "".join(pieces)


def readable(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, signature: str, returns: str
) -> tuple[str, str]:
    """Types as they are written, instead of what they are made of, and the values of defaults."""
    if what in ("function", "method", "class") and (written := as_written(obj, what)):
        return written
    return signature, returns


def as_written(obj: Any, what: str) -> tuple[str, str] | None:
    """The parameters and the result of a function whose annotations are text."""
    try:
        found = inspect.signature(obj)
    except (TypeError, ValueError):
        return None
    parameters = list(found.parameters.values())
    if what == "method" and parameters and parameters[0].name in ("self", "cls"):
        parameters = parameters[1:]
    kinds = [p.annotation for p in parameters if p.annotation is not p.empty]
    if found.return_annotation is not found.empty:
        kinds.append(found.return_annotation)
    if not kinds or not all(isinstance(kind, str) for kind in kinds):
        return None
    parts, stars = [], False
    for p in parameters:
        if p.kind is p.KEYWORD_ONLY and not stars:
            parts.append("*")
        stars |= p.kind in (p.KEYWORD_ONLY, p.VAR_POSITIONAL)
        part = {p.VAR_POSITIONAL: "*", p.VAR_KEYWORD: "**"}.get(p.kind, "") + p.name
        part += "" if p.annotation is p.empty else f": {p.annotation}"
        if p.default is not p.empty:
            if "<" in repr(p.default):
                return None
            part += f" = {p.default!r}"
        parts.append(part)
    result = "" if found.return_annotation is found.empty else found.return_annotation
    return f"({', '.join(parts)})", "" if what == "class" else result


def shown(name: str, value: Any) -> list[str]:
    """The directive for a public name."""
    if inspect.isclass(value):
        lines = [f".. autoclass:: {name}"]
        if not issubclass(value, Exception):
            lines.append("   :members:")
        if value.__bases__ != (object,):
            lines.append("   :show-inheritance:")
        return [*lines, ""]
    if inspect.isroutine(value):
        return [f".. autofunction:: {name}", ""]
    module, _, short = name.rpartition(".")
    return [f".. py:data:: {short}", f"   :module: {module}", ""]


class PublicNames(SphinxDirective):
    """`.. public-names:: MODULE [NAMES]`: all of `__all__`, or the names that follow."""

    required_arguments = 1
    optional_arguments = 100
    has_content = False

    def run(self) -> list[nodes.Node]:
        """The entries."""
        module_name, *names = self.arguments
        module = importlib.import_module(module_name)
        lines: list[str] = []
        for name in names or module.__all__:
            lines += shown(f"{module_name}.{name}", getattr(module, name))
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=False)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"
    app.connect("autodoc-process-docstring", plain, priority=400)
    app.connect("autodoc-process-signature", readable)
    app.add_directive("public-names", PublicNames)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
