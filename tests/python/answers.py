"""Solutions that are nobody's answer, so that writing one is tested with any rotations."""

from __future__ import annotations

import dataclasses

import numpy as np

import rotavg
from rotavg.graph.conventions import matrices_from_quaternions


def random_answer(graph: rotavg.MeasurementGraph, seed: int) -> rotavg.Solution:
    quaternions = np.random.default_rng(seed).standard_normal((graph.num_nodes, 4))
    start = rotavg.solve(graph, max_iterations=0)
    return dataclasses.replace(start, rotations=matrices_from_quaternions(quaternions))
