"""What the columns of a table of rotations are, by the names that people give them.

    i j, or id                        node ids; from/to, name1/name2, image_id1/image_id2 ...
    qx qy qz qw, in any order         a quaternion
    rx ry rz                          a rotation vector in radians; rx_deg ry_deg rz_deg in degrees
    r11 r12 ... r33, or r00 ... r22   a matrix, row and column
    weight                            if there is one
    cxx cxy cxz cyy cyz czz           the covariance of the rotation, radians^2, if there is one

Other columns are not read.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from rotavg.graph.covariances import COVARIANCE

Kind = Literal["quaternion", "rotation vector", "matrix"]

_QUATERNION = ("qx", "qy", "qz", "qw")
_VECTOR = ("rx", "ry", "rz")
_DEGREES = ("rxdeg", "rydeg", "rzdeg")
_MATRIX = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
_ROTATIONS: tuple[tuple[Kind, tuple[str, ...]], ...] = (
    ("quaternion", _QUATERNION),
    ("matrix", _MATRIX),
    ("rotation vector", _VECTOR),
    ("rotation vector", _DEGREES),
)
EXPECTED = "i and j (or id), a rotation (qx qy qz qw, rx ry rz or r11 ... r33), and weight"

_ENDS = {
    "i": 0, "from": 0, "source": 0, "src": 0, "first": 0, "u": 0,
    "j": 1, "to": 1, "target": 1, "dst": 1, "second": 1, "v": 1,
}  # fmt: skip
_NODE = (
    "id|node|nodeid|image|imageid|img|imgid|name|imagename|frame|frameid|cam|camera|view|idx|index"
)
_NUMBERED = re.compile(rf"(?:{_NODE})([012ijab])")
_NODES = re.compile(rf"(?:{_NODE}|filename|file|timestamp)")
_SPELT = (
    (re.compile(r"(?:q|quat|quaternion)([xyzw])"), "q{}"),
    (re.compile(r"(?:r|rv|rvec|rotvec|rot|rotationvector|w|omega|so3)([xyz])(?:rads?)?"), "r{}"),
    (
        re.compile(r"(?:r|rv|rvec|rotvec|rot|rotationvector|w|omega|so3)([xyz])deg(?:rees?)?"),
        "r{}deg",
    ),
    (re.compile(r"(?:r|m|rot)([123][123])"), "r{}"),
)
_ZERO_BASED = re.compile(r"(?:r|m|rot)([012])([012])")
_UNREAD = ("", "_")


@dataclass(frozen=True)
class Layout:
    """Where what stands in a row of a table.

    Attributes:
        words: the names of all columns, as given.
        ids: places of the node ids, of which there are one or two.
        kind: of the rotation.
        rotation: places of its numbers: x y z w, x y z, or nine row by row.
        weight: place of the weight; None without one.
        component: place of the label of the node's component; None without one.
        covariance: places of the upper triangle, row by row; empty without one.
        degrees: whether a rotation vector is in degrees.
    """

    words: tuple[str, ...]
    ids: tuple[int, ...]
    kind: Kind
    rotation: tuple[int, ...]
    weight: int | None
    component: int | None
    covariance: tuple[int, ...] = ()
    degrees: bool = False

    @property
    def numbers(self) -> tuple[int, ...]:
        """Places of all that must be numbers: the rotation, the covariance, and the weight."""
        numbers = (*self.rotation, *self.covariance)
        return numbers if self.weight is None else (*numbers, self.weight)

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of the columns that are not read."""
        read = {*self.ids, *self.numbers, self.component}
        names = (word for place, word in enumerate(self.words) if place not in read)
        return tuple(name for name in names if name not in _UNREAD)


def layout_of(words: Sequence[str], num_ids: int) -> Layout | None:
    """The layout that these names of columns say; None where a part is not there, or twice."""
    plain = [re.sub(r"[^a-z0-9]", "", word.lower()) for word in words]
    ids = _edge_ends(plain) if num_ids == 2 else _node(plain)
    names = [_name(word) for word in plain]
    if any(_ZERO_BASED.fullmatch(word) and "0" in word for word in plain):
        names = [_one_based(word) for word in plain]
    found = _rotation(names)
    if found is None:
        names = [f"q{name}" if name in ("x", "y", "z", "w") else name for name in names]
        found = _rotation(names)
    if found is None:
        return None
    kind, wanted = found
    weight = "weight" if "weight" in names else "w"  # a w that is not of a quaternion
    spread = COVARIANCE if num_ids == 2 and set(COVARIANCE) <= set(names) else ()
    single = [*wanted, *spread, *([weight] if weight in names else [])]
    if ids is None or any(names.count(name) > 1 for name in single):
        return None
    return Layout(
        words=tuple(words),
        ids=ids,
        kind=kind,
        rotation=tuple(names.index(name) for name in wanted),
        weight=names.index(weight) if weight in names and num_ids == 2 else None,
        component=names.index("component") if "component" in names and num_ids == 1 else None,
        covariance=tuple(names.index(name) for name in spread),
        degrees=wanted == _DEGREES,
    )


def _rotation(names: Sequence[str]) -> tuple[Kind, tuple[str, ...]] | None:
    """The first kind of rotation that is all there, and its names."""
    for kind, wanted in _ROTATIONS:
        if set(wanted) <= set(names):
            return kind, wanted
    return None


def _name(word: str) -> str:
    """One of our names for a column, or else the word."""
    for pattern, ours in _SPELT:
        found = pattern.fullmatch(word)
        if found:
            return ours.format(found[1])
    return "weight" if word in ("weight", "weights") else word


def _one_based(word: str) -> str:
    found = _ZERO_BASED.fullmatch(word)
    return f"r{int(found[1]) + 1}{int(found[2]) + 1}" if found else _name(word)


def _edge_ends(words: Sequence[str]) -> tuple[int, int] | None:
    """Places of i and j."""
    places: tuple[list[int], list[int]] = ([], [])
    marks = {place: _mark(word) for place, word in enumerate(words)}
    zero_based = "0" in marks.values()
    ends = {"0": 0, "1": 1} if zero_based else {"1": 0, "2": 1}
    ends.update({"i": 0, "a": 0, "j": 1, "b": 1})
    for place, word in enumerate(words):
        end = _ENDS.get(word, ends.get(marks[place]))
        if end is not None:
            places[end].append(place)
    if len(places[0]) != 1 or len(places[1]) != 1:
        return None
    return places[0][0], places[1][0]


def _mark(word: str) -> str:
    """What tells the ends of an edge apart: image1, id_i, ...; "" without such."""
    found = _NUMBERED.fullmatch(word)
    if found:
        return found[1]
    for prefix in ("from", "to", "source", "target", "src", "dst"):
        if word.startswith(prefix) and _NODES.fullmatch(word[len(prefix) :]):
            return "i" if _ENDS[prefix] == 0 else "j"
    return ""


def _node(words: Sequence[str]) -> tuple[int] | None:
    """Place of the node's id."""
    places = [place for place, word in enumerate(words) if word == "id"]
    if not places:
        places = [place for place, word in enumerate(words) if _NODES.fullmatch(word)]
    return (places[0],) if len(places) == 1 else None
