"""Whether another reading fits clearly better: the same errors, of two ways to read something."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Below it, radians, whatever is wrong is small.
NOISE_WORTH_A_LOOK = float(np.radians(0.5))
ROUNDED = NOISE_WORTH_A_LOOK / 10  # below, errors are as good as none
# Clear at a glance: of so few errors, so many times smaller.
FACTOR = 4
LEAST_FEW = 3
# Where it is not so much better: the mean logarithm of the ratio of so many independent errors, by
# so many of its standard errors. (By chance in one of 10^6; and a tenth is worth the words.)
LEAST_SEPARATE = 20
_LEAST_GAIN = np.log(1.1)
_STANDARD_ERRORS = 5


def is_clearly_better(read: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether the errors (k,) of another reading are clearly smaller than those as it was read."""
    if len(read) < LEAST_FEW or np.median(read) < NOISE_WORTH_A_LOOK:
        return False
    return bool(np.median(other) < np.median(read) / FACTOR) or is_better_on_average(read, other)


def is_better_on_average(read: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """The same of many independent errors, whatever noise and outliers do to most of them."""
    if len(read) < LEAST_SEPARATE:
        return False
    gain = np.log(np.maximum(read, ROUNDED) / np.maximum(other, ROUNDED))
    return bool(gain.mean() > max(_LEAST_GAIN, _STANDARD_ERRORS * standard_error(gain)))


def standard_error(values: NDArray[np.float64]) -> float:
    """Of the mean of independent values (k,)."""
    return float(values.std(ddof=1) / np.sqrt(len(values)))
