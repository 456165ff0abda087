"""The array interface against numbers of all kinds, from several threads at once.

    python -m tests.fuzz.arrays --cases 20000 --threads 2
    python -m tests.fuzz.arrays --seed 7 --cases 1      # one case again

Every case makes a small graph of edges, rotations, weights and nodes that are nearly right, and
solves it in one of the ways that there are. A graph is refused by a rotavg.Error, or else solved to
finite rotations that are rotations. Anything else is a fault: another exception, an error that
speaks of the library's insides, NaN. Case k has the seed `--seed` + k, in whichever thread.
"""

from __future__ import annotations

import argparse
import sys
import traceback
import warnings
from concurrent.futures import ThreadPoolExecutor
from typing import Any, get_args

import numpy as np

import rotavg
from rotavg.solving.solve import Init

ODD = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-320, -1.0, 1e308, 1e-100, 1e100, 1e-101, 1e101, 2.0)
INSIDES = ("vector", "basic_string", "std::", "bad_alloc", "deque", "array::")
METHODS = ("auto", "bcd", "sum", "newton", "staircase", "bcdsr")
INITS = get_args(Init)
LOSSES = ("l2", "huber", "l1", "cauchy", "geman_mcclure", "tls", "auto")


def one_graph(rng: np.random.Generator) -> rotavg.MeasurementGraph:
    """Nearly right arrays of one kind or another as a graph; raises rotavg.Error."""
    n, m = int(rng.integers(1, 12)), int(rng.integers(0, 40))
    if rng.random() < 0.02:  # enough for several threads
        n, m = int(rng.integers(2, 3000)), int(rng.integers(2000, 20000))
    edges = rng.integers(0, n, size=(m, 2))
    if rng.random() < 0.7:  # no edge from a node to itself
        edges[:, 1] = (edges[:, 0] + rng.integers(1, max(n, 2), size=m)) % max(n, 2)
    if rng.random() < 0.2:
        edges = edges * int(rng.choice([1, -1, 2**40, 2**62])) - int(rng.integers(3))
    vectors = rng.normal(size=(m, 3)) * 10.0 ** rng.integers(-9, 2)
    rotations = rotavg.MeasurementGraph.from_rotvecs([(0, 1)] * m, vectors).rotations if m else None
    rotations = np.empty((0, 3, 3)) if rotations is None else rotations.copy()
    weights = 10.0 ** rng.uniform(*rng.choice([[-1, 1], [-12, 12], [-100, 100]]), size=m)
    for array in (rotations, weights):
        if rng.random() < 0.2 and array.size:
            array.flat[int(rng.integers(array.size))] = rng.choice(ODD)
    layout = int(rng.integers(5))
    given: Any = rotations
    if layout == 1:
        given = np.asfortranarray(rotations)
    elif layout == 2:
        given = rotations.astype(np.float32)
    elif layout == 3:
        given = np.repeat(rotations, 2, axis=0)[::2]
    nodes = None
    if rng.random() < 0.3:
        nodes = rng.permutation(np.unique(np.append(edges, [n, n + 1])))
    return rotavg.MeasurementGraph(
        edges, given, None if rng.random() < 0.2 else weights, nodes, skip_self_edges=True
    )


def one_case(seed: int) -> str:
    """What went wrong, or nothing."""
    rng = np.random.default_rng(seed)
    try:
        graph = one_graph(rng)
        solution = rotavg.solve(
            graph,
            method=str(rng.choice(METHODS)),
            init=str(rng.choice(INITS)),
            loss=str(rng.choice(LOSSES)) if rng.random() < 0.3 else "l2",
            num_threads=int(rng.choice([1, 2, 3, 8, 50])),
            max_iterations=int(rng.choice([0, 1, 20, 200])),
            seed=int(rng.integers(5)),
            time_limit=20,
        )
        R = solution.rotations
        if not np.isfinite(R).all() or np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max() > 1e-9:
            return f"seed {seed}: no rotations: {R.tolist()}"
        if not np.isfinite(solution.objective):
            return f"seed {seed}: the objective is {solution.objective}"
    except rotavg.Error as error:
        if any(word in str(error) for word in INSIDES):
            return f"seed {seed}: {error}\n{traceback.format_exc()}"
    except Exception:
        return f"seed {seed}: {traceback.format_exc()}"
    return ""


def fuzz(cases: int, seed: int, threads: int) -> list[str]:
    """What went wrong in so many cases."""
    with warnings.catch_warnings(), ThreadPoolExecutor(threads) as pool:
        warnings.simplefilter("ignore")
        return [fault for fault in pool.map(one_case, range(seed, seed + cases)) if fault]


def main() -> None:
    """Fuzz and print what went wrong; exit status 1 if anything did."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=20000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    faults = fuzz(arguments.cases, arguments.seed, arguments.threads)
    print(f"{arguments.cases} cases, {len(faults)} faults")
    print("\n".join(faults[:5]))
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
