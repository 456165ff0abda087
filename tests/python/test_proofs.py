"""Every optimum is proved, at any noise and weight; and what is said where one is not."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rotavg
from rotavg.graph.conventions import quaternions_from_matrices
from shared_data import shared_data

POSE_GRAPHS = ["tinyGrid3D", "smallGrid3D", "sphere2500", "torus3D", "parking-garage"]
NOISES = [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3, 1e-1]


def certificate(solution: rotavg.Solution) -> rotavg.Certificate:
    assert solution.certificate is not None
    return solution.certificate


@pytest.mark.parametrize("unit_weights", [False, True])
@pytest.mark.parametrize("name", POSE_GRAPHS)
def test_the_public_pose_graphs_are_proved(name: str, unit_weights: bool) -> None:
    graph = rotavg.read(shared_data(f"g2o/{name}.g2o"), unit_weights=unit_weights)
    found = certificate(rotavg.solve(graph))
    assert (found.verdict, found.failure_probability) == ("proved", 0.0)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize(
    ("kind", "n", "options"),
    [
        ("erdos_renyi", 200, {"density": 0.04}),
        ("erdos_renyi", 1000, {"density": 0.008}),
        ("erdos_renyi", 1000, {"density": 0.03}),
        ("sphere", 900, {}),
        ("grid", 400, {}),
        ("cycle", 500, {}),
        ("complete", 40, {}),
        ("band", 600, {}),
    ],
)
def test_simulated_graphs_are_proved(
    kind: str, n: int, options: dict[str, float], noise: float
) -> None:
    for seed in range(2):
        graph = rotavg.simulate(kind, n, noise=noise, seed=seed, **options).graph  # type: ignore[arg-type]
        found = certificate(rotavg.solve(graph))
        assert found.verdict == "proved", found


@pytest.mark.parametrize("digits", [4, 6, 9])
def test_graphs_read_from_rounded_text_are_proved(digits: int, tmp_path: Path) -> None:
    graph = rotavg.simulate("erdos_renyi", 1000, density=0.008, noise=0.0, seed=3).graph
    quaternions = quaternions_from_matrices(graph.rotations)
    lines = [
        f"{i} {j} " + " ".join(f"{x:.{digits}f}" for x in q)
        for (i, j), q in zip(graph.edges, quaternions)
    ]
    path = tmp_path / "graph.txt"
    path.write_text("\n".join(lines))
    assert certificate(rotavg.solve(rotavg.read(path))).verdict == "proved"


@pytest.mark.parametrize("weight", [0.1, 1.0, 10.0, 100.0])
@pytest.mark.parametrize("noise", [1e-4, 1e-3, 1e-2])
def test_gravity_is_proved_at_any_weight(weight: float, noise: float) -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(3, 12))
        simulation = rotavg.simulate("erdos_renyi", n, density=0.7, noise=noise, seed=seed)
        down = simulation.ground_truth.transpose(0, 2, 1) @ [0.0, 1.0, 0.0]
        down += noise * rng.standard_normal(down.shape)
        down /= np.linalg.norm(down, axis=1, keepdims=True)
        priors = rotavg.Priors(gravity={k: (down[k], weight) for k in range(n)})
        solution = rotavg.solve(simulation.graph, priors=priors)
        assert certificate(solution).verdict == "proved", certificate(solution)


@pytest.mark.parametrize("name", ["g_4_0.01_0", "g_8_0.001_2"])
def test_tiny_graphs_with_gravity_from_files_are_proved(name: str) -> None:
    path = shared_data(f"../cases/gravity/{name}.txt")
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "rotavg",
            "solve",
            path,
            "--gravity",
            path.with_name(name + "_gravity.txt"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "proved globally optimal" in done.stdout


def test_what_a_robust_loss_leaves_next_to_no_weight_is_proved() -> None:
    # Ten edges that agree to 1e-7 rad, and one that is off by much.
    simulation = rotavg.simulate("complete", 5, noise=1e-7, seed=4)
    rotations = np.array(simulation.graph.rotations)
    rotations[3] = rotations[3] @ rotations[5] @ rotations[7]
    graph = rotavg.MeasurementGraph(simulation.graph.edges, rotations)
    solution = rotavg.solve(graph, loss="auto")
    assert np.flatnonzero(solution.is_outlier).tolist() == [3]
    assert certificate(solution).verdict == "proved", certificate(solution)


@pytest.mark.parametrize(
    ("shortfall", "changes", "words"),
    [
        ("leftover", {"relative_gap": 1.8e-6}, "optimal to a relative 1.8e-06; the tolerance is"),
        ("negative", {"relative_gap": 0.5}, "a better answer may exist, by a relative 0.5 at most"),
        ("negative", {"relative_gap": 1.0}, "not certified: a better answer may exist"),
        ("relaxation", {"relative_gap": 0.01}, "optimal to a relative 0.01; the relaxation is"),
        ("stopped", {}, "not certified: the work was stopped before the proof"),
        ("undecided", {}, "nothing was proved, and nothing refuted"),
    ],
)
def test_every_shortfall_has_its_sentence(
    shortfall: str, changes: dict[str, float], words: str
) -> None:
    solution = rotavg.solve(rotavg.simulate("complete", 8, noise=0.1, seed=1).graph)
    fallen_short = dataclasses.replace(
        certificate(solution),
        verdict=rotavg.Verdict.NOT_CERTIFIED,
        shortfall=rotavg.Shortfall(shortfall),
        **changes,  # type: ignore[arg-type]
    )
    assert words in fallen_short.sentence
    printed = str(dataclasses.replace(solution, certificate=fallen_short))
    assert fallen_short.sentence in printed
    assert printed.startswith("Not certified: 8 rotations")
    assert ("better answer may exist" in printed) == (shortfall == "negative")


def test_the_shortfall_is_what_keeps_the_answer_from_being_proved() -> None:
    graph = rotavg.simulate("sphere", 400, noise=0.1, seed=1).graph
    near = rotavg.solve(graph, method="bcd", tolerance=1e-4)
    assert certificate(near).shortfall == "leftover"
    assert certificate(rotavg.solve(graph, tolerance=1e-4)).verdict == "proved"  # it goes on
    hard = rotavg.simulate("erdos_renyi", 30, density=0.2, noise=1.5, seed=2).graph
    shortfalls = {
        certificate(rotavg.solve(hard, init="random", seed=seed, method="newton")).shortfall.value
        for seed in range(5)
    }
    assert shortfalls == {"negative"}
    stopped = rotavg.certify(graph, near.rotations, time_limit=0.0)
    assert stopped.shortfall == "stopped"


def test_a_proof_with_a_probability_says_so() -> None:
    graph = rotavg.simulate("erdos_renyi", 300, density=0.1, noise=0.1, seed=1).graph
    solution = rotavg.solve(graph, certificate_max_flops=0)
    found = certificate(solution)
    assert (found.verdict, found.method) == ("proved", "random_start")
    assert found.failure_probability == 1e-12
    assert "proved globally optimal but for a probability of 1e-12" in str(solution)
    other = rotavg.certify(graph, solution.rotations, max_flops=0, seed=5, failure_probability=1e-6)
    assert (other.verdict, other.failure_probability) == ("proved", 1e-6)
    for bad in (1.0, -0.1, "small"):
        with pytest.raises(rotavg.OptionError, match="failure_probability is"):
            rotavg.certify(graph, solution.rotations, failure_probability=bad)  # type: ignore[arg-type]


INTERRUPTED = """
import os, signal, threading
import rotavg
graph = rotavg.simulate("band", 60000, noise=0.2, seed=1).graph
R = rotavg.solve(graph, certify=False).rotations

def told(progress):  # R has converged: what comes next is its certificate, which takes longer
    threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()

try:
    rotavg.solve(graph, init=R, callback=told, method="bcd", tolerance=1e-8)
except rotavg.Interrupted as stop:
    c = stop.solution.certificate
    print(stop.solution.status.converged, c.verdict if c else None)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals are others there")
def test_ctrl_c_while_certifying_keeps_the_answer() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() in ("True not_certified", "True None"), done.stderr


def test_the_cli_writes_what_had_converged_when_it_was_interrupted(tmp_path: Path) -> None:
    path, output = tmp_path / "graph.txt", tmp_path / "solved.txt"
    rotavg.write(path, rotavg.simulate("complete", 12, noise=0.1, seed=1).graph)
    program = f"""
import sys, rotavg
from rotavg.cli.main import run
solve = rotavg.solve
def interrupted(*args, **settings):
    raise rotavg.Interrupted(solve(*args, **{{**settings, "certify": False}}))
rotavg.solve = interrupted
sys.argv = ["rotavg", "solve", {str(path)!r}, "-o", {str(output)!r}]
run()
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 130
    assert re.search(r"(?m)^interrupted$", done.stderr)
    assert len(rotavg.read_rotations(output)[1]) == 12
