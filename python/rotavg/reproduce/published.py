"""The figures that the paper prints in Table 1."""

from __future__ import annotations

from typing import NamedTuple


class Printed(NamedTuple):
    """One algorithm's columns."""

    error: float
    lambda_min: float
    seconds: float


class Setting(NamedTuple):
    """One row's simulated graphs: complete ones on n nodes, a fraction p of the edges dropped.

    `phi` is the noise angle's standard deviation in radians: the paper says variance, but its
    figures fit the standard deviation.
    """

    n: int
    phi: float
    p: float


def _row(*figures: float) -> dict[str, Printed]:
    return {
        name: Printed(*figures[3 * k : 3 * k + 3]) for k, name in enumerate(("BCDSR", "BCD", "SUM"))
    }


TABLE_1: dict[Setting, dict[str, Printed]] = {
    Setting(20, 0.2, 0.0): _row(
        0.2102, -3.46e-15, 0.2390, 0.2098, -1.08e-16, 0.0120, 0.2098, 7.06e-16, 0.0069
    ),
    Setting(20, 0.2, 0.3): _row(
        0.2019, -2.40e-14, 0.2352, 0.2018, -9.26e-17, 0.0124, 0.2018, -1.69e-16, 0.0070
    ),
    Setting(20, 0.5, 0.0): _row(
        0.5026, -9.06e-15, 0.2438, 0.5013, -6.88e-15, 0.0126, 0.5013, -1.43e-15, 0.0095
    ),
    Setting(20, 0.5, 0.3): _row(
        0.5088, 5.19e-15, 0.2671, 0.5086, -2.79e-15, 0.0124, 0.5086, -1.11e-14, 0.0105
    ),
    Setting(200, 0.2, 0.0): _row(
        0.2230, -1.05e-11, 59.22, 0.2229, -1.19e-14, 0.1126, 0.2229, 2.12e-14, 0.0622
    ),
    Setting(200, 0.2, 0.3): _row(
        0.2176, -1.41e-13, 55.82, 0.2163, -2.90e-14, 0.1245, 0.2163, 3.36e-15, 0.0734
    ),
    Setting(200, 0.5, 0.0): _row(
        0.5505, -8.38e-12, 55.72, 0.5502, -2.11e-14, 0.1236, 0.5502, 3.99e-16, 0.0635
    ),
    Setting(200, 0.5, 0.3): _row(
        0.5513, -2.04e-14, 57.54, 0.5539, -4.17e-14, 0.1482, 0.5539, -1.10e-15, 0.0640
    ),
    Setting(2000, 0.2, 0.0): _row(
        0.2409, -127.11, 15139.34, 0.2248, 7.78e-14, 9.53, 0.2248, -1.68e-13, 2.54
    ),
    Setting(2000, 0.2, 0.3): _row(
        0.2398, -134.41, 15278.67, 0.2232, -2.49e-13, 9.52, 0.2232, -3.00e-13, 2.55
    ),
    Setting(2000, 0.5, 0.0): _row(
        0.5699, -153.72, 15374.61, 0.5526, -3.64e-13, 9.64, 0.5526, -2.74e-13, 2.59
    ),
    Setting(2000, 0.5, 0.3): _row(
        0.5783, -156.04, 15392.96, 0.5569, 3.49e-13, 9.97, 0.5569, -6.42e-13, 2.61
    ),
}
