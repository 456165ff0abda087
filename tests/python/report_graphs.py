"""Solutions to report on: small and large, with and without positions, with names that bite."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs

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


def doubted() -> rotavg.Solution:
    """Robustly, with a cycle check: edges of every verdict, and a part held by wrong ones."""
    main = rotavg.simulate("erdos_renyi", 60, density=0.3, noise=0.03, outliers=0.3, seed=1)
    part = rotavg.simulate("complete", 8, noise=0.03, seed=2)
    # Four links that pull the part in four directions, and a leaf.
    pulls = matrices_from_rotvecs(1.5 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]))
    links = np.swapaxes(main.ground_truth[:4], 1, 2) @ pulls @ part.ground_truth[:4]
    graph = rotavg.MeasurementGraph(
        np.concatenate(
            [main.graph.edges, part.graph.edges + 60, [[k, 60 + k] for k in range(4)], [[7, 68]]]
        ),
        np.concatenate([main.graph.rotations, part.graph.rotations, links, links[:1]]),
    )
    return rotavg.solve(graph, loss="huber", cycle_threshold=np.radians(15))


def in_two_parts() -> rotavg.MeasurementGraph:
    """Two rings of 8 and 5 nodes, with noise that differs between the axes."""
    rings = [rotavg.simulate("cycle", n, noise=0.1, seed=n).graph for n in (8, 5)]
    spread = np.diag([4.0, 1.0, 0.25]) * 0.01
    return rotavg.MeasurementGraph(
        np.concatenate([rings[0].edges, rings[1].edges + 8]),
        np.concatenate([ring.rotations for ring in rings]),
        covariances=np.tile(spread, (13, 1, 1)),
    )


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
