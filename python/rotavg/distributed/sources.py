"""Where the edges come from: files, or functions that are called on workers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Callable, Union

from rotavg.base.errors import Error, FormatError, GraphError, SolverError
from rotavg.distributed.edges import Edges
from rotavg.graph.measurement_graph import MeasurementGraph

Chunk = Callable[[], Union[MeasurementGraph, Edges]]


def chunks_of(client: Any, source: str | Path | Sequence[Chunk]) -> Iterator[Any]:
    """Futures of `Edges`: of every file of a folder, or of every function."""
    if isinstance(source, (str, Path)):
        folder = Path(source)
        if not folder.is_dir():
            raise FormatError("is no folder, expected one of files with edges", path=str(folder))
        names = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        files = [path for path in names if not path.is_dir()]
        for path in files:
            if not path.is_file():  # a link to nowhere
                raise FormatError("is no file, expected one with edges", path=str(path))
        if not files:
            raise FormatError("holds no file, expected parts of a graph", path=str(folder))
        yield from (client.submit(_read, str(path), pure=False) for path in files)
        return
    for number, chunk in enumerate(source):
        if not callable(chunk):
            found = f"source {number} is a {type(chunk).__name__}"
            raise GraphError(f"{found}, expected a function of no arguments")
        yield client.submit(_called, chunk, number, pure=False)


def _read(path: str) -> Edges:
    from rotavg.io import read

    graph = read(path)
    try:
        return Edges.of(graph)
    except GraphError as error:
        raise FormatError(str(error), path=path) from None


def _called(chunk: Chunk, number: int) -> Edges:
    function = chunk.func if isinstance(chunk, partial) else chunk
    name = f"source {number}, {getattr(function, '__name__', type(function).__name__)}"
    try:
        made = chunk()
    except Error:
        raise
    except Exception as error:
        raise SolverError(f"{name}: {type(error).__name__}: {error}") from error
    try:
        return made.checked() if isinstance(made, Edges) else Edges.of(made)
    except GraphError as error:
        raise GraphError(f"{name}: {error}") from error
