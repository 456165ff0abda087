"""Does the certificate ever say something false? Random small graphs, dense eigenvalues, restarts.

    python -m benchmarks.false_proofs --graphs 100000 --seed 1

Graphs of 2 to 12 nodes with parallel edges, weights over up to six orders of magnitude and noise
from none to rotations at random. Each is solved from a random start by a method drawn at random,
half of them with proofs by a random start alone, and certified away from the optimum as well. Of
each certificate

- f(R) - gap is a lower bound: no restart ends below it (estimates, which say that they are, are
  counted where they are wrong);
- where S is said to be positive, or to have a negative eigenvalue, its dense ones agree.

Exit status 1, and the graph's number, where one fails.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter

import numpy as np

import rotavg


def random_rotations(rng: np.random.Generator, count: int) -> np.ndarray:
    """Uniform on SO(3), (count, 3, 3)."""
    quaternions = rng.normal(size=(count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def rotations_of(rotvecs: np.ndarray) -> np.ndarray:
    """Rodrigues' formula, (k, 3) to (k, 3, 3)."""
    angle = np.linalg.norm(rotvecs, axis=1)[:, None, None]
    K = np.zeros((len(rotvecs), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -rotvecs[:, 2], rotvecs[:, 1], -rotvecs[:, 0]
    K -= K.transpose(0, 2, 1)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1.0, np.sin(safe) / safe)
    cosine = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    return np.eye(3) + sine * K + cosine * K @ K


def random_graph(rng: np.random.Generator) -> rotavg.MeasurementGraph:
    """Connected; of 2 to 12 nodes."""
    n = int(rng.integers(2, 13))
    tree = [(int(rng.integers(0, j)), j) for j in range(1, n)]
    more = rng.integers(0, n, size=(int(rng.integers(0, 3 * n)), 2))
    edges = np.array([*tree, *(tuple(pair) for pair in more if pair[0] != pair[1])])
    truth = random_rotations(rng, n)
    measured = truth[edges[:, 0]].transpose(0, 2, 1) @ truth[edges[:, 1]]
    noise = rng.choice([0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.1, 0.5, 1.0, np.inf])
    if np.isinf(noise):
        measured = random_rotations(rng, len(edges))
    elif noise > 0.0:
        measured = measured @ rotations_of(noise * rng.normal(size=(len(edges), 3)))
    weights = 10.0 ** rng.uniform(0.0, rng.choice([0.0, 2.0, 6.0]), size=len(edges))
    return rotavg.MeasurementGraph(edges, measured, weights=weights)


def smallest_eigenvalue(graph: rotavg.MeasurementGraph, R: np.ndarray) -> float:
    """Of S = Lambda(R) - Rt (Theorem 1), dense."""
    n = len(graph.nodes)
    row = {node: k for k, node in enumerate(graph.nodes)}
    S = np.zeros((3 * n, 3 * n))
    for (i, j), R_ij, w in zip(graph.edges, graph.rotations, graph.weights):
        a, b = 3 * row[i], 3 * row[j]
        S[a : a + 3, b : b + 3] -= w * R_ij
        S[b : b + 3, a : a + 3] -= w * R_ij.T
    for k in range(n):
        at = slice(3 * k, 3 * k + 3)
        sum_k = sum(-S[at, 3 * m : 3 * m + 3] @ R[m].T @ R[k] for m in range(n) if m != k)
        S[at, at] += (sum_k + sum_k.T) / 2.0
    return float(np.linalg.eigvalsh(S)[0])


def check(number: int, seed: int, counts: Counter[str]) -> list[str]:
    """What is false of one graph; what was seen is counted."""
    rng = np.random.default_rng([seed, number])
    graph = random_graph(rng)
    max_flops = 1e12 if rng.integers(0, 2) else 0.0  # or no factorisation at all
    solution = rotavg.solve(
        graph,
        method=str(rng.choice(["auto", "bcd", "sum", "newton"])),
        init="random",
        seed=number,
        certificate_seed=number,
        certificate_max_flops=max_flops,
    )
    others = [rotavg.solve(graph, init="random", seed=k, certify=False) for k in range(3)]
    best = min(run.objective for run in (solution, *others))
    total = float(np.sum(graph.weights))
    few_epsilon = 16 * np.finfo(float).eps
    rounding = few_epsilon * (np.sqrt(total * best) + few_epsilon * total)
    counts["a restart ended lower"] += solution.objective > best * (1 + 1e-9) + rounding

    turned = rotations_of(rng.uniform(0, 1) * rng.normal(size=(len(graph.nodes), 3)))
    away = solution.rotations @ turned
    faults = []
    for name, R, certificate in (
        ("solution", solution.rotations, solution.certificate),
        ("away", away, rotavg.certify(graph, away, max_flops=max_flops)),
    ):
        counts[f"{name}: {certificate.verdict} by {certificate.method}"] += 1
        bound = rotavg.objective(graph, R) - certificate.gap
        if certificate.method == "eigenvalue":  # says of itself that it is an estimate
            counts["an estimate was wrong"] += not bound <= best + rounding
        elif not bound <= best + rounding:
            faults.append(f"{name}: f - gap = {bound}, but a restart ends at {best}")
        least, told = smallest_eigenvalue(graph, R), certificate.lambda_min
        by_S = certificate.method in ("factorization", "random_start")
        if certificate.verdict == "proved" and by_S and least < -1e-7 * total - certificate.gap:
            faults.append(f"{name}: proved by {certificate.method}, but lambda_min is {least}")
        if told < 0 and least > 0.5 * told + 1e-9 * total:
            faults.append(f"{name}: refuted with lambda_min {told}, which is {least}")
    return faults


def main() -> int:
    """Check so many graphs; 1 if anything was false."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--graphs", type=int, default=10000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    counts: Counter[str] = Counter()
    false = 0
    for number in range(arguments.first, arguments.first + arguments.graphs):
        for fault in check(number, arguments.seed, counts):
            print(f"graph {number} (seed {arguments.seed}): {fault}", flush=True)
            false += 1
    for what, count in sorted(counts.items()):
        print(f"{count:8d}  {what}")
    print(f"{false} false of {arguments.graphs} graphs, seed {arguments.seed}")
    return 1 if false else 0


if __name__ == "__main__":
    sys.exit(main())
