"""What a file format is, and which one a file is in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Protocol, Union, runtime_checkable

from numpy.typing import NDArray

from rotavg.base.errors import FileAccessError, FormatError, GraphError
from rotavg.graph.conventions import Convention
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.absolute import RotationReader
from rotavg.io.lines import BYTE_ORDER_MARK
from rotavg.io.streams import STDIN, read_all


@runtime_checkable
class SolutionLike(Protocol):
    """What a writer needs of a solution: world_from_node for every node of its graph."""

    @property
    def graph(self) -> MeasurementGraph:
        """The graph that was solved, of n nodes."""
        ...

    @property
    def rotations(self) -> NDArray[Any]:
        """(n, 3, 3), world_from_node."""
        ...

    @property
    def quaternions(self) -> NDArray[Any]:
        """(n, 4), the same as xyzw."""
        ...


def components_to_tell(solution: SolutionLike) -> list[int]:
    """The label of each node's component; none where there is one alone, or no label is known."""
    label: NDArray[Any] | None = getattr(solution, "component", None)
    return [] if label is None or label.max() == 0 else label.tolist()


class WithoutOutliers:
    """A solution that is written with the edges that were not rejected alone."""

    def __init__(self, solution: SolutionLike, kept: MeasurementGraph) -> None:
        self._solution, self.kept = solution, kept

    @property
    def graph(self) -> MeasurementGraph:
        """The graph that was solved: positions and gauge are those of all of it."""
        return self._solution.graph

    @property
    def rotations(self) -> NDArray[Any]:
        """(n, 3, 3), world_from_node."""
        return self._solution.rotations

    @property
    def quaternions(self) -> NDArray[Any]:
        """(n, 4), the same as xyzw."""
        return self._solution.quaternions

    def __getattr__(self, name: str) -> Any:
        if name == "_solution":  # of a copy that is not filled yet
            raise AttributeError(name)
        return getattr(self._solution, name)


def edges_to_write(item: Writable) -> MeasurementGraph:
    """The graph whose edges are written."""
    if isinstance(item, MeasurementGraph):
        return item
    return item.kept if isinstance(item, WithoutOutliers) else item.graph


Writable = Union[MeasurementGraph, SolutionLike]
Content = Union[bytes, Mapping[Path, bytes]]  # of the file itself, or of several files


@dataclass(frozen=True)
class ReadOptions:
    """What the user asks of a reader.

    Attributes:
        unit_weights: weigh every edge 1 and ignore what the file says about weights.
        convention: the family that the file's rotations are in.
        skip_self_edges: leave out edges from a node to itself, instead of refusing them.
        columns: what the columns are; None where the file tells, or its format.
        covariances: whether to estimate those of the edges from what the file has instead of them.
    """

    unit_weights: bool
    convention: Convention
    skip_self_edges: bool = False
    columns: tuple[str, ...] | None = None
    covariances: bool = False

    @property
    def of_graph(self) -> dict[str, Any]:
        """What of it every reader hands on to the graph."""
        return {"convention": self.convention, "skip_self_edges": self.skip_self_edges}


@dataclass(frozen=True)
class Format:
    """A file format, stated once.

    Attributes:
        name: what users call it.
        suffixes: how its files are named, lower case: an ending with a dot, or a pattern of the
            whole name; the first is the usual one.
        recognises: whether the beginning of a file (up to 64 KiB) is in this format.
        claims: whether one that is named as such files are can be in no other.
        read: (path, whole content, options) -> graph; raises FormatError. None: it is not read.
        write: (path, graph or solution) -> content; raises FormatError. None: it is not written.
        convention: the family of its rotations.
        any_convention: whether users may say that a file is in the other family.
        has_graphs, has_solutions: what can be written.
        has_weights: whether a graph's weights can be written.
        has_ids: whether the ids of a graph's nodes can be written.
        has_isolated: whether a graph's nodes without an edge can be written.
        has_components: whether a solution's file tells which node is in which component.
        has_covariances: whether a graph's file holds the covariances of the edges.
        has_translations: whether a graph's translations can be written.
        has_positions: whether a solution is written with positions.
        puts_back: whether a solution goes back into the file that its graph came from.
        magic: a beginning that tells that the reader opens the file itself.
        main_file: of a format that is a folder, the file in it that is read.
        check_place: raises what speaks against writing to this path a solution of the graph in that
            file (None: not known), as far as it can be told before the work.
        rotations: how it carries absolute rotations. None: it does not, or they are not read.
    """

    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[bytes], bool]
    read: Callable[[Path, bytes, ReadOptions], MeasurementGraph] | None
    write: Callable[[Path, Writable], Content] | None
    convention: Convention = "pose"
    claims: Callable[[bytes], bool] = lambda head: False
    any_convention: bool = False
    has_graphs: bool = True
    has_solutions: bool = True
    has_weights: bool = True
    has_ids: Callable[[MeasurementGraph], bool] = lambda graph: True
    has_isolated: bool = True
    has_components: bool = False
    has_covariances: bool = False
    has_translations: bool = False
    has_positions: bool = False
    puts_back: bool = False
    magic: bytes = b""
    main_file: str = ""
    rotations: RotationReader | None = None
    check_place: Callable[[Path, Path | None], None] = lambda path, source: None

    def is_name(self, path: Path) -> bool:
        """Whether files of this format are named so."""
        return is_named(path, self.suffixes)

    def family(self, path: Path, asked: Convention | None) -> Convention:
        """The family of a file's rotations, as asked for if the format leaves it open.

        Raises FormatError if the format has another by definition.
        """
        if asked is None or asked == self.convention:
            return self.convention
        if asked not in ("pose", "vision"):
            raise FormatError(f"convention is {asked!r}, expected 'pose' or 'vision'")
        if not self.any_convention:
            raise FormatError(
                f"{self.name} is in the {self.convention} family by definition, "
                f"not in the {asked} family",
                path=path,
            )
        return asked

    def check_writes(self, path: Path, solution: bool, others: Sequence[Format] = ()) -> None:
        """FormatError if the format has no place for a solution (or, if not so, for a graph).

        It lists those of the others that are written.
        """
        if self.write is None:
            found = f"{self.name} is a format for input only"
            raise FormatError(f"{found}, {expected(others, True)}", path=path)
        if not (self.has_solutions if solution else self.has_graphs):
            found, other = ("solution", "graph") if solution else ("graph", "solution")
            raise FormatError(
                f"found a {found} to write, expected a {other}: {self.name} holds no other",
                path=path,
            )

    def file_of(self, path: Path) -> Path:
        """The file to read or write where the user names `path`: of a folder, its main file."""
        inside = self.main_file and not self.is_name(path)
        return path / self.main_file if inside else path


HEAD_SIZE = 1 << 16
_COMPRESSION_MAGIC = {
    "gzip": b"\x1f\x8b",
    "bzip2": b"BZh",
    "xz": b"\xfd7zXZ\x00",
    "zstd": b"\x28\xb5\x2f\xfd",
}


def is_named(path: Path, suffixes: Sequence[str]) -> bool:
    """Whether the file's name has one of these endings or patterns (see `Format`)."""
    patterns = (f"*{s}" if s.startswith(".") else s for s in suffixes)
    return any(fnmatchcase(path.name.lower(), pattern) for pattern in patterns)


def named(formats: Sequence[Format], name: str, *, to_write: bool = False) -> Format:
    """The format of this name; FormatError lists those that can be read, or written."""
    for form in formats:
        if form.name == name:
            return form
    raise FormatError(f"unknown format {name!r}, {expected(formats, to_write)}")


def by_suffix(formats: Sequence[Format], path: Path, *, to_write: bool = False) -> Format:
    """The format that the file's name tells; FormatError as for `named`."""
    for form in formats:
        if form.is_name(path):
            return form
    told = "a folder's name" if path.is_dir() else "the name"
    raise FormatError(f"{told} does not tell the format, {expected(formats, to_write)}", path=path)


def how_used(path: Path) -> str:
    """What a note of prior knowledge in a file of measurements ends with."""
    return (
        "; `rotavg solve` uses them where it can, in Python "
        f"rotavg.solve(graph, priors=rotavg.read_priors({str(path)!r}, graph))"
    )


def why_not_read(form: Format) -> str:
    """Of a format that graphs are not read from, after its name."""
    return "holds rotations alone (rotavg compare, read_rotations)" if form.rotations else (
        "is a format for output only"
    )  # fmt: skip


def of_content(formats: Sequence[Format], path: Path, data: bytes) -> Format:
    """The format that the content tells, or failing that the name."""
    head = data[:HEAD_SIZE]
    for form in formats:
        if form.is_name(path) and form.claims(head):
            return form
    for form in formats:
        if form.recognises(head):
            return form
    try:
        return by_suffix(formats, path)
    except FormatError:
        found = "neither content nor name tells the format"
        raise FormatError(f"{found}, {expected(formats, False)}", path=path) from None


def in_folder(formats: Sequence[Format], path: Path) -> Path:
    """The file to read of a folder that one of the formats is made of; `path` if it is none."""
    if path.is_dir():
        for form in formats:
            if form.main_file and (path / form.main_file).is_file():
                return path / form.main_file
    return path


def read_bytes(formats: Sequence[Format], path: Path, what: str = "a measurement graph") -> bytes:
    """The whole file, or the beginning of one that its reader opens itself.

    Raises FileAccessError if it cannot be read, FormatError if it is empty or compressed.
    """
    if str(path) == "-":
        reason = "standard input is /dev/stdin"
        raise FileAccessError(f"cannot be read: {reason}", path=path)
    if path.is_dir():
        inside = [form for form in formats if form.main_file]
        folders = "; ".join(f"{form.name}: a folder with {form.main_file}" for form in inside)
        hint = f" ({folders})" if folders else ""
        raise FileAccessError(f"cannot be read: it is a folder, expected a file{hint}", path=path)
    try:
        data = _magic_of(formats, path) or read_all(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be read: {reason}", path=path) from error
    content = data.removeprefix(BYTE_ORDER_MARK)
    if not content or content.isspace():
        raise FormatError(f"the file is empty, expected {what}", path=path)
    for compression, magic in _COMPRESSION_MAGIC.items():
        if data.startswith(magic):
            raise FormatError(f"the file is compressed ({compression}), unpack it first", path=path)
    return data


@contextmanager
def blame_line(path: Path, lines: Sequence[int] | None = None) -> Iterator[None]:
    """Turn a GraphError about an edge into a FormatError about the line it was read from."""
    try:
        yield
    except GraphError as error:
        line = None if lines is None or error.edge is None else int(lines[error.edge])
        raise FormatError(str(error), path=path, line=line) from error


def _magic_of(formats: Sequence[Format], path: Path) -> bytes:
    magics = [form.magic for form in formats if form.magic]
    if path == STDIN or not path.is_file():  # a pipe can be read but once
        return b""
    with path.open("rb") as stream:
        head = stream.read(max(map(len, magics), default=0))
    return next((magic for magic in magics if head.startswith(magic)), b"")


def expected(formats: Sequence[Format], to_write: bool = False) -> str:
    """What to say of the formats that can be read, or written."""
    able = [form for form in formats if (form.write if to_write else form.read or form.rotations)]
    known = ", ".join(f"{form.name} ({'/'.join(form.suffixes) or 'a folder'})" for form in able)
    return f"expected one of the formats that are {'written' if to_write else 'read'}: {known}"
