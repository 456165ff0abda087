from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

knows_numbers: bool

_Table = tuple[NDArray[Any], NDArray[np.float64], NDArray[np.int64]]

def read(
    data: bytes,
    first: int,
    skip: int,
    separator: str,
    kinds: Sequence[tuple[bytes, str]],
    num_threads: int = 0,
) -> tuple[list[_Table], list[tuple[int, bytes]]] | None: ...
def write(
    integers: NDArray[np.int64],
    numbers: NDArray[np.float64],
    tag: str,
    separator: str,
    short_zeros: bool,
    tail: str,
    num_threads: int = 0,
) -> bytes: ...
