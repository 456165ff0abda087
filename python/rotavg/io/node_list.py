"""Lists of nodes, such as the images of a part of a scene: an id or a name on each line."""

from __future__ import annotations

import os
from pathlib import Path

from rotavg.base.errors import FormatError, GraphError
from rotavg.graph.ids import IdArray, as_ids, unique_ids
from rotavg.io import registry
from rotavg.io.lines import BYTE_ORDER_MARK, ids_of


def read_node_list(path: str | os.PathLike[str]) -> IdArray:
    """Read the distinct ids (k,) of nodes; names may have blanks in them, blank lines are skipped.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: there is no node in it, or something else than text.
    """
    path = Path(path)
    data = registry.read_bytes((), path, "a list of nodes")
    if b"\0" in data:
        raise FormatError("the file is binary, expected a node on each line", path=path)
    texts = enumerate(data.removeprefix(BYTE_ORDER_MARK).splitlines(), start=1)
    nodes = [(line, text.strip()) for line, text in texts if text.strip()]
    ids = ids_of(path, [text for _, text in nodes], [line for line, _ in nodes])
    try:
        return unique_ids(as_ids(ids, "ids of nodes"))
    except GraphError as error:
        raise FormatError(str(error), path=path) from None
