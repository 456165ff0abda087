"""Makes notebooks of pages of the documentation: their text, and their programs as cells.

    python examples/notebooks.py     # writes examples/*.ipynb anew

The tests compare, and run the pages' programs; the notebooks hold no outputs.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = {"tutorial": "docs/tutorial.md", "conventions": "docs/conventions.md"}


def notebook(page: Path) -> str:
    """A page as a notebook."""
    pieces = re.split(r"```python\n(.*?)```\n?", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    cells = []
    for k, piece in enumerate(pieces):
        text = piece.strip()
        if not text:
            continue
        cell: dict[str, object] = {"id": f"cell-{k}", "metadata": {}}
        if k % 2:
            cell.update(cell_type="code", execution_count=None, outputs=[])
        else:
            cell["cell_type"] = "markdown"
            # Links lead from the folder examples/ to the pages.
            text = re.sub(r"\]\((?!https?:|#)([^)]+)\)", r"](../docs/\1)", text)
        cell["source"] = text.splitlines(keepends=True)
        cells.append(dict(sorted(cell.items())))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    content = {
        "cells": cells,
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def main() -> None:
    """Write all."""
    for name, page in PAGES.items():
        path = ROOT / "examples" / f"{name}.ipynb"
        path.write_text(notebook(ROOT / page), encoding="utf-8")


if __name__ == "__main__":
    main()
