"""What edges count for in the floor of a certificate's relative gap (docs/certificate.md)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def counted_weights(
    weights: NDArray[np.float64], lightest: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Of edges of these weights (m,), beside the lightest (m,) of their components.

    None counts for more than 1000 times the lightest, but for at least 1/200 of its own weight, and
    of no more than 1e18 times the lightest (C++: `counted_weight`).
    """
    return np.maximum(
        np.minimum(weights, 1000.0 * lightest), 0.005 * np.minimum(weights, 1e18 * lightest)
    )
