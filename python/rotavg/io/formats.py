"""The list of known formats, and the front door to them: `read` and `write`."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path

from rotavg.base.errors import FormatError, IncompleteWarning
from rotavg.graph.conventions import Convention
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import (
    atomic,
    colmap_database,
    colmap_images,
    colmap_model,
    colmap_models,
    csv_text,
    g2o,
    glomap,
    irotavg,
    jrl,
    npz,
    onedsfm,
    open3d,
    pyfg,
    registry,
    text,
    tum,
)
from rotavg.io.g2o_write import PoseFile
from rotavg.io.lost import isolated, lost, lost_ids
from rotavg.io.outliers import check_drops_outliers, without_outliers
from rotavg.io.pose_priors import priors_in
from rotavg.io.registry import (
    Format,
    ReadOptions,
    SolutionLike,
    Writable,
    components_to_tell,
)

# In the order in which they are asked whether they recognise a content: the vaguest come last.
FORMATS: tuple[Format, ...] = (
    npz.NPZ,
    colmap_database.COLMAP_DATABASE,
    colmap_images.COLMAP_IMAGES,
    colmap_models.COLMAP_BINARY,
    colmap_model.COLMAP_MODEL,
    open3d.OPEN3D,
    jrl.JRL,
    pyfg.PYFG,
    g2o.G2O,
    g2o.TORO,
    tum.TUM,
    onedsfm.ONEDSFM,
    glomap.GLOMAP,
    irotavg.IROTAVG,
    csv_text.CSV,
    text.TEXT,
)


TABLES = (text.TEXT, csv_text.CSV)


def read(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    convention: Convention | None = None,
    unit_weights: bool = False,
    skip_self_edges: bool = False,
    columns: str | Sequence[str] | None = None,
    covariances: bool = False,
) -> MeasurementGraph:
    """Read a measurement graph.

    Args:
        path: the file, or the folder of a 1DSfM data set; the format is told by its content or,
            failing that, by its name.
        format: the name of a format (docs/formats.md), to leave nothing to be told.
        convention: the family that the rotations are in, "pose" or "vision", where the format
            leaves that open: text, csv and npz, "pose" by default.
        unit_weights: weigh every edge 1 and ignore what the file says about weights.
        skip_self_edges: leave out edges from a node to itself, instead of refusing them.
        columns: what the columns of a text or CSV file are that has no header to say so, such as
            "i,j,qw,qx,qy,qz,weight" or a list of these words: rotations as quaternions,
            rotation vectors "rx,ry,rz" in radians ("rx_deg,ry_deg,rz_deg" in degrees), or matrices
            "r11,r12,...,r33"; "_" for a column that is not to be read.
        covariances: whether to estimate the covariance of every relative rotation of a COLMAP
            database from the inliers of its pair (docs/covariances.md; needs pycolmap, the extra
            [colmap]). Other formats hold covariances, which are always read, or do not.

    Returns:
        The graph (pose family). Its `notes` tell what was skipped or mended on the way, its
        `source` lets `write` put back what a graph has no place for.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it holds no measurement graph; the message names the line and the reason. Or
            the format has a convention of its own, which is another.
    """
    words = None if columns is None else words_of(columns)
    path, data, chosen = input_of(path, format, words)
    if chosen.read is None:
        raise FormatError(
            f"{chosen.name} {registry.why_not_read(chosen)}, {registry.expected(FORMATS)}",
            path=path,
        )
    if words is not None and chosen not in TABLES:
        found = f"columns are given, and {chosen.name} has its own"
        raise FormatError(f"{found}: expected them for text or csv", path=path)
    family = chosen.family(path, convention)
    options = ReadOptions(unit_weights, family, skip_self_edges, words, bool(covariances))
    return chosen.read(path, data, options)


def write(
    path: str | os.PathLike[str],
    graph_or_solution: Writable,
    *,
    format: str | None = None,
    drop_outliers: bool = False,
) -> None:
    """Write a measurement graph, or a solution, to a file, replacing one that is there.

    The new content appears all at once or not at all. A pose graph that was read from a file goes
    back into it: everything but the new poses stays as it was. Where it has translations, positions
    are solved for (see `rotavg.positions`), after a robust loss of the rotations with
    what it has left of the edges.

    Args:
        path: the file; its name tells the format ("out.g2o", "out.txt", "out.csv", "out.npz" ...).
            Of the solution of a COLMAP database it may be a folder, new or empty: a model.
        graph_or_solution: a MeasurementGraph or a Solution.
        format: the name of a format (docs/formats.md), whatever the file's name.
        drop_outliers: leave the edges out of a pose graph (g2o, toro, open3d) that a robust loss
            has rejected, of the rotations or of refined poses (`inlier_graph`). Poses are those
            of the whole solution.

    Warns:
        IncompleteWarning: the positions cannot be solved for, so that the translations in a pose
            graph's file stay as they were; or the format has no place for the ids, for weights
            that are not all equal, or for nodes without an edge.

    Raises:
        FileAccessError: the file cannot be written, or the folder has other things in it; what was
            there before is untouched.
        GraphError: outliers are to be dropped, and all edges are.
        FormatError: unknown format, or one that cannot hold this (say, names as ids in g2o).
        SolverError: the positions cannot be solved for, and the format (tum, colmap_images,
            open3d) has no others.
    """
    if not isinstance(graph_or_solution, (MeasurementGraph, SolutionLike)):
        found = type(graph_or_solution).__name__
        raise FormatError(f"found a {found} to write, expected a MeasurementGraph or a Solution")
    is_solution = not isinstance(graph_or_solution, MeasurementGraph)
    path, chosen = _output(path, format, is_solution and _is_of_database(graph_or_solution))
    chosen.check_writes(path, is_solution, FORMATS)
    assert chosen.write is not None
    if drop_outliers:
        graph_or_solution = without_outliers(FORMATS, path, chosen, graph_or_solution)
    content = chosen.write(path, graph_or_solution)
    atomic.write_files({path: content} if isinstance(content, bytes) else content)
    if isinstance(graph_or_solution, MeasurementGraph):
        gone = lost(chosen, graph_or_solution)
    else:
        gone = lost_ids(chosen, graph_or_solution.graph)
    for loss in gone:
        warnings.warn(f"{path}: {loss}", IncompleteWarning, stacklevel=2)


def check_writable(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    solution: bool = False,
    source: Path | None = None,
    drop_outliers: bool = False,
) -> None:
    """Raise what `write` would raise for this path, as far as it can be told before the work.

    `solution` says that it is a solution that will be written, not a graph; `source` where its
    graph is from, a file that only a format that puts the solution back into it may replace;
    `drop_outliers` that it is written without these.
    """
    of_database = solution and source is not None and colmap_model.begins_as_database(source)
    path, chosen = _output(path, format, of_database)
    chosen.check_writes(path, solution, FORMATS)
    chosen.check_place(path, source)
    if drop_outliers:
        check_drops_outliers(FORMATS, path, chosen)
    if not chosen.puts_back:
        atomic.check_distinct([path], [source])
    new_folder = chosen.main_file and not path.parent.exists()
    atomic.check_writable(path.parent if new_folder else path)


def losses(
    path: str | os.PathLike[str], graph: MeasurementGraph, format: str | None = None
) -> tuple[str, ...]:
    """What of a graph is not in the file that `write` makes of it, or is made up.

    But for what `write` warns of.
    """
    _, chosen = _output(path, format, _is_of_database(graph))
    told = []
    if graph.translations is not None and not chosen.has_translations:
        told.append(f"the translations are not in it, {chosen.name} has no place for them")
    if graph.translations is None and chosen.puts_back:
        told.append("the graph has no translations: those in it are zero and mean nothing")
    source = graph.source
    if graph.covariances is not None and not chosen.has_covariances:
        told.append(f"the covariances are not in it, {chosen.name} is written without")
    put_back = (
        isinstance(source, PoseFile)
        and chosen.puts_back
        and chosen.recognises(source.data[: registry.HEAD_SIZE])
    )
    known = priors_in(source)
    if known is not None and not put_back:
        told.append(f"{known.knows} not in it")
    if isinstance(source, PoseFile) and not put_back:
        if source.vertices:
            told.append(f"the poses of {len(source.vertices)} vertices are not in it")
        if source.fixed:
            told.append(f"which {len(source.fixed)} vertices are fixed is not in it")
    return tuple(told)


def input_of(
    path: str | os.PathLike[str], format: str | None, columns: Sequence[str] | None = None
) -> tuple[Path, bytes, Format]:
    """The file to read, its content, and its format."""
    path = Path(path)
    if format is not None:
        chosen = registry.named(FORMATS, format)
        path = chosen.file_of(path)
        return path, registry.read_bytes(FORMATS, path), chosen
    path = registry.in_folder(FORMATS, path)
    data = registry.read_bytes(FORMATS, path)
    if columns is not None:
        return path, data, table_format(path, data)
    return path, data, registry.of_content(FORMATS, path, data)


def words_of(columns: str | Sequence[str]) -> tuple[str, ...]:
    """The words in what says the columns."""
    words = columns.replace(",", " ").split() if isinstance(columns, str) else columns
    return tuple(str(word).strip() for word in words)


def table_format(path: Path, data: bytes) -> Format:
    """Which of the two formats a table is in whose columns the user knows."""
    return csv_text.CSV if csv_text.CSV.is_name(path) or b'"' in data else text.TEXT


def _is_of_database(item: Writable) -> bool:
    """Whether it is a graph from a COLMAP database, or a solution of one."""
    graph = item if isinstance(item, MeasurementGraph) else item.graph
    return isinstance(graph.source, colmap_database.ColmapImages)


def _output(
    path: str | os.PathLike[str], format: str | None, of_database: bool = False
) -> tuple[Path, Format]:
    """The file to write and its format; a folder is a model of what is `of_database`."""
    path = Path(path)
    if format is not None:
        chosen = registry.named(FORMATS, format, to_write=True)
    elif of_database and (path.is_dir() or not (path.suffix or path.exists())):
        chosen = colmap_model.COLMAP_MODEL
    else:
        path = registry.in_folder([form for form in FORMATS if form.read], path)
        chosen = registry.by_suffix(FORMATS, path, to_write=True)
    return chosen.file_of(path), chosen


def losses_of_solution(
    path: str | os.PathLike[str], solution: SolutionLike, format: str | None = None
) -> tuple[str, ...]:
    """What of a solution is not in the file that `write` makes of it, but for its graph."""
    _, chosen = _output(path, format, _is_of_database(solution))
    label = components_to_tell(solution)
    if not label or chosen.has_components or chosen.puts_back:
        return ()
    return (
        f"{max(label) + 1} components, each with a gauge of its own, and {chosen.name} does not "
        "tell them apart (csv, text and npz do)",
    )


def num_nodes_written(
    path: str | os.PathLike[str], graph: MeasurementGraph, format: str | None = None
) -> int:
    """How many nodes of a graph a reader finds in the file that `write` makes of it."""
    _, chosen = _output(path, format, _is_of_database(graph))
    return graph.num_nodes - (0 if chosen.has_isolated else len(isolated(graph)))


def warned_losses(
    path: str | os.PathLike[str], graph: MeasurementGraph, format: str | None = None
) -> tuple[str, ...]:
    """What `write` warns of where it writes this graph."""
    return lost(_output(path, format, _is_of_database(graph))[1], graph)


def has_positions(path: str | os.PathLike[str], format: str | None = None) -> bool:
    """Whether `write` puts the positions of a solution into this file."""
    return _output(path, format)[1].has_positions
