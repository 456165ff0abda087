"""Solutions to report on: small and large, with and without positions, with names that bite."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import rotavg

NASTY = "</script><script>document.title = 'broken'</script>"


def named() -> rotavg.Solution:
    """Two components and a lonely node; names that are markup; a few outliers."""
    a = rotavg.simulate("erdos_renyi", 60, density=0.2, noise=0.05, outliers=0.1, seed=1).graph
    b = rotavg.simulate("cycle", 7, noise=0.05, seed=2).graph
    names = [f'<b>{k}</b> & "{k}".jpg' for k in range(60)] + [f"{NASTY}{k}" for k in range(7)]
    graph = rotavg.MeasurementGraph(
        np.array(names)[np.concatenate([a.indices, b.indices + 60])],
        np.concatenate([a.rotations, b.rotations]),
        nodes=[*names, "lonely"],
        notes=("3 lines <skipped>",),
    )
    return rotavg.solve(graph)


def posed(folder: Path) -> rotavg.Solution:
    """A trajectory from a g2o file with positions."""
    simulation = rotavg.simulate("sphere", 400, noise=0.05, seed=1)
    assert simulation.positions is not None
    path = folder / "poses.g2o"
    rotavg.write(path, simulation.graph)
    with path.open("a") as stream:
        for node, place in enumerate(simulation.positions.tolist()):
            stream.write(f"VERTEX_SE3:QUAT {node} {' '.join(map(repr, place))} 0 0 0 1\n")
    return rotavg.solve(rotavg.read(path))


def large() -> rotavg.Solution:
    """More than 1e5 edges."""
    return rotavg.solve(rotavg.simulate("band", 11120, noise=0.05, seed=1).graph)
