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
    """Names of types as they are written, instead of what Sphinx makes of them in unions."""
    return tuple(
        text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)
        for text in (signature, returns)
    )


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
