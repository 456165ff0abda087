"""Equations as MathML, which browsers draw themselves: no script, nothing from the network."""

from __future__ import annotations

import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

TAG = re.compile(r"\\tag\{([^}]*)\}")  # the paper's number of an equation


def inline(self: HTML5Translator, node: nodes.math) -> None:
    """An equation in the text."""
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def display(self: HTML5Translator, node: nodes.math_block) -> None:
    """An equation of its own."""
    latex, number = TAG.sub("", node.astext()), TAG.search(node.astext())
    self.body.append(f'<div class="equation">{convert(latex, display="block")}')
    if number:
        self.body.append(f'<span class="eqno">({number[1]})</span>')
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
