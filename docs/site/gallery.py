"""Pictures that the build makes: what a program of a gallery draws stands below it.

The programs save their pictures with `savefig("NAME.png")`. They run in order, in one namespace, in
build/docs/pictures; the pages stay plain Markdown without pictures in the repository.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "build" / "docs" / "pictures"
GALLERIES = ("docs/gallery",)


def draw(app: Sphinx, docname: str, source: list[str]) -> None:
    """Run the programs of a gallery, and show what each has saved."""
    if docname not in GALLERIES:
        return
    import matplotlib

    matplotlib.use("Agg")
    PICTURES.mkdir(parents=True, exist_ok=True)
    names: dict[str, object] = {}
    before = Path.cwd()

    def with_pictures(found: re.Match[str]) -> str:
        program = found[1]
        exec(compile(program, docname, "exec"), names)
        saved = re.findall(r'savefig\("([\w-]+\.png)"', program)
        title = re.sub(r"\W+", " ", program.splitlines()[0]).strip()
        return found[0] + "".join(
            f"\n\n![{title}](/build/docs/pictures/{name})\n" for name in saved
        )

    os.chdir(PICTURES)
    try:
        source[0] = re.sub(r"```python\n(.*?)```", with_pictures, source[0], flags=re.DOTALL)
    finally:
        os.chdir(before)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("source-read", draw)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
