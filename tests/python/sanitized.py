"""A little of everything with modules that were built with sanitizers: ./dev sanitize.

ROTAVG_MODULES is the folder with them; the address sanitizer's library has to be preloaded.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np


def load(folder: Path) -> list[str]:
    """The modules in the folder in place of those that are installed; their names."""
    names = []
    for path in sorted(folder.glob("_*.so")):
        name = f"rotavg.{path.name.partition('.')[0]}"
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
        names.append(name)
    return names


def main() -> None:
    print("with", ", ".join(load(Path(os.environ["ROTAVG_MODULES"]))))
    import rotavg
    from tests.fuzz.arrays import fuzz as fuzz_arrays
    from tests.fuzz.readers import fuzz as fuzz_readers

    warnings.simplefilter("ignore")
    simulation = rotavg.simulate("sphere", 60, noise=0.05, seed=1)
    graph = simulation.graph
    one = rotavg.solve(graph, num_threads=1)
    for method in ("bcd", "sum", "newton", "staircase"):
        solution = rotavg.solve(graph, method=method, num_threads=3, callback=lambda _: True)
        assert abs(solution.objective - one.objective) < 1e-6 * one.objective, method
    assert (rotavg.solve(graph, num_threads=4).rotations == one.rotations).all()
    down = simulation.ground_truth.transpose(0, 2, 1) @ [0, 1, 0]
    priors = rotavg.Priors(
        fixed={0: simulation.ground_truth[0]},
        absolute={7: (simulation.ground_truth[7], 2.0)},
        gravity={node: (down[node], 5.0) for node in range(10, 20)},
    )
    assert rotavg.solve(graph, priors=priors).verdict == "proved"
    rotavg.solve(graph, priors=priors, loss="auto")
    for loss in ("auto", "l1", "tls"):
        rotavg.solve(graph, loss=loss)
    one.covariances()
    rotavg.certify(graph, simulation.ground_truth)
    with tempfile.TemporaryDirectory() as folder:
        for name in ("a.g2o", "a.txt", "a.csv"):
            rotavg.write(Path(folder) / name, graph)
            back = rotavg.read(Path(folder) / name)
            assert np.abs(back.rotations - graph.rotations).max() < 1e-14
    faults = fuzz_arrays(cases=100, seed=0, threads=2)
    for form in ("g2o", "text", "csv", "1dsfm"):
        faults += fuzz_readers(form, cases=100, seed=0).faults
    assert not faults, "\n".join(faults[:3])
    print("sanitizers are silent")


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    main()
