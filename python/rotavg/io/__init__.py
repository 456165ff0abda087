"""Reading measurement graphs from files, writing graphs and solutions to them.

A further format is one more file with a `Format` in it, listed in `formats.py`.
"""

from rotavg.io.covariances import write_covariances
from rotavg.io.diagnostics import write_diagnostics
from rotavg.io.edges import write_edges
from rotavg.io.formats import FORMATS, check_writable, losses, read, write
from rotavg.io.gravity import read_gravity, write_gravity
from rotavg.io.priors import read_priors
from rotavg.io.registry import Format
from rotavg.io.rigs import read_rigs
from rotavg.io.rotations import read_rotations

__all__ = [
    "FORMATS",
    "Format",
    "check_writable",
    "losses",
    "read",
    "read_gravity",
    "read_priors",
    "read_rigs",
    "read_rotations",
    "write",
    "write_covariances",
    "write_diagnostics",
    "write_edges",
    "write_gravity",
]
