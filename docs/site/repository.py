"""What makes pages of the repository a site: its index is the sidebar, and the site's root."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

ENTRY = """<!doctype html>
<meta charset="utf-8">
<meta http-equiv="refresh" content="0; url={first}.html">
<title>rotavg</title>
<a href="{first}.html">The documentation of rotavg</a>
"""


def add_sidebar(app: Sphinx, docname: str, source: list[str]) -> None:
    """Headings of the index become captions of the sidebar, the links in its tables entries."""
    if docname != app.config.root_doc:
        return
    folder = posixpath.dirname(docname)
    trees = ""
    for section in re.split(r"^## ", source[0], flags=re.MULTILINE)[1:]:
        caption = section.splitlines()[0]
        links = re.findall(r"^\| *\[([^\]]+)\]\(([^)#]+)\.(?:md|rst)\)", section, re.MULTILINE)
        pages = [
            f"{title} </{posixpath.normpath(posixpath.join(folder, link))}>"
            for title, link in links
        ]
        if pages:
            head = f"```{{toctree}}\n:hidden:\n:caption: {caption}\n\n"
            trees += "\n\n" + head + "\n".join(pages) + "\n```\n"
    source[0] += trees


def add_entry(app: Sphinx, exception: Exception | None) -> None:
    """The site's root leads to its first page."""
    if exception is None and app.builder.name == "html":
        page = ENTRY.format(first=app.config.root_doc)
        (Path(app.outdir) / "index.html").write_text(page, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_lexer("order", TextLexer)  # the orders of docs/architecture.md
    app.connect("source-read", add_sidebar)
    app.connect("build-finished", add_entry)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
