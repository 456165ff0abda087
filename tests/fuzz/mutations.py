"""Changes to good files: fields, lines, bytes, members, arrays, rows."""

from __future__ import annotations

import copy
import io
import json
import re
import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

_FIELDS = (
    *(
        "nan",
        "inf",
        "-inf",
        "1e999",
        "-1e999",
        "1e-320",
        "1e308",
        "-0",
        "0",
        "1",
        "-1",
        "2",
        "1e17",
    ),
    *("", "x", "0x10", "1_000", "1,5", "1.5.2", "--1", "+", "\u0663", "\uff11", "None", "true"),
    *("9223372036854775807", "9223372036854775808", "-9223372036854775809", "1" * 400, "id", "i"),
    *(
        "qw",
        "#",
        '"',
        '""',
        '"a',
        "a b",
        "'",
        "\\",
        "/",
        "a" * 3000,
        "\u00e9\u0000",
        "VERTEX_SE2",
        "FIX",
    ),
    *("EDGE_SE3:QUAT", "EDGE_SE2", "EDGE3", "EDGE2", "VERTEX_SE3:QUAT", "edge_se2", "weight"),
)
_BYTES = (
    *(b"\0", b"\xff", b"\xef\xbb\xbf", b"\r", b"\r\n", b"\t", b";", b",", b'"', b"#", b"\x1a"),
    *(b"\x0c", b"\xc2\x85", b"\xe2\x80\xa8", b" ", b"\n\n", b"{", b"}", b"[", b"]", b":"),
)


def mutated(path: Path, rng: np.random.Generator) -> bytes:
    """The content of a file, changed in one to four places."""
    data = path.read_bytes()
    for _ in range(pick(rng, (1, 1, 1, 2, 3, 4))):
        if data.startswith(b"PK"):
            data = _archive(data, rng)
        elif data.startswith(b"SQLite"):
            data = _sqlite(data, rng)
        elif data.lstrip()[:1] == b"{" and rng.random() < 0.8:
            data = _json(data, rng)
        else:
            data = pick(rng, (_fields, _fields, _lines, _raw))(data, rng)
    return data


def pick(rng: np.random.Generator, choices: Any) -> Any:
    return choices[int(rng.integers(len(choices)))]


def _fields(data: bytes, rng: np.random.Generator) -> bytes:
    """One field replaced, left out, said twice, or exchanged with another."""
    parts = re.split(rb"([ \t\r\n,;]+)", data)
    at = [k for k in range(0, len(parts), 2) if parts[k]]
    if not at:
        return data
    k, other = pick(rng, at), pick(rng, at)
    what = int(rng.integers(6))
    if what <= 1:
        parts[k] = pick(rng, _FIELDS).encode("utf-8", "surrogatepass")
    elif what == 2:
        parts[k] = b""
    elif what == 3:
        parts[k] += b" " + parts[k]
    elif what == 4:
        parts[k], parts[other] = parts[other], parts[k]
    else:
        near = [n for n in at if abs(n - k) < 30]
        parts[k] = parts[pick(rng, near)]
    return b"".join(parts)


def _lines(data: bytes, rng: np.random.Generator) -> bytes:
    """A line left out, said twice, moved, cut, or a strange one put in."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    k, other = int(rng.integers(len(lines))), int(rng.integers(len(lines)))
    what = int(rng.integers(6))
    if what == 0:
        del lines[k]
    elif what == 1:
        lines.insert(other, lines[k])
    elif what == 2:
        lines[k], lines[other] = lines[other], lines[k]
    elif what == 3:
        lines[k] = lines[k][: int(rng.integers(len(lines[k]) + 1))]
    elif what == 4:
        words = [pick(rng, _FIELDS) for _ in range(int(rng.integers(12)))]
        lines.insert(k, " ".join(words).encode("utf-8", "surrogatepass") + b"\n")
    else:
        lines = lines[: k + 1]
    return b"".join(lines)


def _raw(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes put in, left out, changed, or the end cut off."""
    k = int(rng.integers(len(data) + 1))
    what = int(rng.integers(5))
    if what == 0:
        return data[:k] + pick(rng, _BYTES) + data[k:]
    if what == 1:
        return data[:k] + data[k + int(rng.integers(1, 20)) :]
    if what == 2:
        return data[:k]
    if what == 3:
        return data[:k] + rng.bytes(int(rng.integers(1, 8))) + data[k:]
    return data.replace(pick(rng, (b" ", b"\n", b".", b"0", b",")), pick(rng, _BYTES))


def _json(data: bytes, rng: np.random.Generator) -> bytes:
    """A value somewhere inside replaced, left out or said twice."""
    try:
        value = json.loads(data)
    except ValueError:
        return _raw(data, rng)
    places = list(_places(value))
    if not places:
        return data
    holder, key = pick(rng, places)
    what = int(rng.integers(4))
    strange = (
        None,
        True,
        0,
        -1,
        1e308,
        float("nan"),
        float("inf"),
        2**70,
        "",
        "x",
        [],
        {},
        [[]],
        {"a": 1},
    )
    if what <= 1:
        holder[key] = copy.deepcopy(pick(rng, strange))
    elif what == 2:
        del holder[key]
    elif isinstance(holder, list):
        holder.append(holder[key])
    return json.dumps(value).encode()


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inside in items:
        yield value, key
        if isinstance(inside, (dict, list)):
            yield from _places(inside)


def _archive(data: bytes, rng: np.random.Generator) -> bytes:
    """An array of an archive changed, or the archive's bytes."""
    if rng.random() < 0.2:
        return _raw(data, rng)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except Exception:
        return data
    if not arrays:
        return data
    name = pick(rng, list(arrays))
    array = np.array(arrays[name])
    what = int(rng.integers(7))
    if what == 0:
        del arrays[name]
    elif what == 1 and array.size and array.dtype.kind == "f":
        array.flat[int(rng.integers(array.size))] = pick(
            rng, (np.nan, np.inf, -1, 0, 1e308, 1e-320)
        )
        arrays[name] = array
    elif what == 2 and array.ndim:
        arrays[name] = array[: int(rng.integers(len(array) + 1))]
    elif what == 3 and array.dtype.kind != "U":
        arrays[name] = array.astype(
            pick(rng, ("U8", "i4", "f4", "c16", "?", "u8")), casting="unsafe"
        )
    elif what == 4:
        arrays[name] = array.T if rng.random() < 0.5 else array.ravel()
    elif what == 5 and array.size and array.dtype.kind == "i":
        array.flat[int(rng.integers(array.size))] = pick(rng, (-1, 2**31 - 1, 0, 1))
        arrays[name] = array
    else:
        arrays[pick(rng, list(arrays))] = pick(
            rng, (np.array(1), np.array("x"), np.empty((0, 3)), array)
        )
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def _sqlite(data: bytes, rng: np.random.Generator) -> bytes:
    """A value of a database changed, a column or table left out, or bytes of it."""
    if rng.random() < 0.2:
        return _raw(data, rng)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.db"
        path.write_bytes(data)
        connection = sqlite3.connect(path)
        try:
            connection.execute("PRAGMA synchronous = OFF")  # nobody waits for the disk
            tables = [row[0] for row in connection.execute("SELECT name FROM sqlite_master")]
            table = pick(rng, tables or ["images"])
            columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
            column = pick(rng, columns or ["name"])
            what = int(rng.integers(8))
            values = (None, "", "x", 0, -1, 2**62, 1.5, b"", b"\0" * 31, b"\xff" * 32, b"\0" * 32)
            if what == 0:
                connection.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
            elif what == 1:
                connection.execute(f"DROP TABLE {table}")
            elif what == 2:
                connection.execute(f"DELETE FROM {table} WHERE rowid % 2 = 0")
            else:
                which = "1" if rng.random() < 0.3 else f"rowid % 3 = {int(rng.integers(3))}"
                connection.execute(
                    f"UPDATE {table} SET {column} = ? WHERE {which}", (pick(rng, values),)
                )
            connection.commit()
        except (sqlite3.Error, UnicodeDecodeError, IndexError):
            pass
        finally:
            connection.close()
        return path.read_bytes()
