"""Tries an installed rotavg: a first program, and that no library comes from outside the wheel."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

import rotavg

# What every Linux has, by the rules of manylinux.
SYSTEM = (
    "ld-linux",
    "libc.",
    "libdl.",
    "libgcc_s.",
    "libm.",
    "libpthread.",
    "librt.",
    "libstdc++.",
)

edges = [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a"), ("a", "c")]
rotvecs = np.radians([[0, 0, 90.5], [0, 0, 89], [0, 0, 91], [0, 0, 90], [0, 0, 180]])
solution = rotavg.solve(rotavg.MeasurementGraph.from_rotvecs(edges, rotvecs))
assert solution.certificate is not None
assert solution.certificate.verdict == "proved", solution

large = rotavg.simulate("sphere", 2500, noise=0.1, seed=1).graph
sphere = rotavg.solve(large, num_threads=2)
assert sphere.certificate is not None
assert sphere.certificate.verdict == "proved", sphere
assert (sphere.rotations == rotavg.solve(large, num_threads=1).rotations).all()

# The modules of rotavg and what they load; numpy and Python answer for themselves.
mapped = {line.split()[-1] for line in Path("/proc/self/maps").read_text().splitlines()}
libraries = {Path(name) for name in mapped if ".so" in name}
outside = [
    str(path)
    for path in libraries
    if not path.is_relative_to(sys.prefix)
    and not path.is_relative_to(sys.base_prefix + "/lib/python" + sys.version[:4].rstrip("."))
    and not path.name.startswith((*SYSTEM, "libpython"))
]
own = sorted(p.name for p in libraries if "rotavg" in str(p))
assert own, "no module of rotavg is loaded"
of_numerics = [name for name in outside if any(k in name for k in ("amd", "suitesparse", "gomp"))]
assert not of_numerics, of_numerics
core = os.environ.get("ROTAVG_CORE", "best")
print(f"rotavg {rotavg.__version__}, core {core}: proved; loads {', '.join(own)}")
