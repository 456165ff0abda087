"""`rotavg solve`, as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import get_args

import click
import numpy as np
import pytest

import rotavg
from rotavg.cli.solve import solve as solve_command
from rotavg.graph.conventions import Convention
from rotavg.io import FORMATS
from rotavg.solving.pose_losses import PoseLoss
from rotavg.solving.robust import Loss
from rotavg.solving.solve import Gauge, Init, Method, Mu, Stop, WeightKind
from test_cli import run


@pytest.fixture
def graph_file(tmp_path: Path) -> Path:
    path = tmp_path / "graph.g2o"
    rotavg.write(path, rotavg.simulate("sphere", 100, noise=0.1, seed=1).graph)
    return path


@pytest.fixture
def update(tmp_path: Path) -> Path:
    """A folder with a graph, rotations of most of its nodes, and some of other nodes."""
    graph = rotavg.simulate("sphere", 100, noise=0.1, seed=1).graph
    rotavg.write(tmp_path / "graph.csv", graph)
    rotavg.write(tmp_path / "older.csv", rotavg.solve(graph.subgraph(range(90))))
    rotavg.write(tmp_path / "older.npz", rotavg.solve(graph))
    (tmp_path / "chordal").write_bytes((tmp_path / "older.csv").read_bytes())
    (tmp_path / "other.txt").write_text("# id qx qy qz qw\n1000 0 0 0 1\n1001 0 0 0 1\n")
    (tmp_path / "bad.txt").write_text("# id qx qy qz qw\n1 0 0 0 1\n2 0 0 0\n")
    np.savez(tmp_path / "none.npz", nodes=np.arange(0), rotations=np.empty((0, 3, 3)))
    np.savez(tmp_path / "wrong.npz", nodes=np.arange(9), rotations=np.ones((9, 3, 3)))
    return tmp_path


def test_solve_prints_a_report_and_writes_the_solution(graph_file: Path, tmp_path: Path) -> None:
    output = tmp_path / "solved.g2o"
    done = run("solve", graph_file, "-o", output)
    assert done.returncode == 0
    assert "proved globally optimal" in done.stdout
    assert output.read_text().count("VERTEX_SE3:QUAT") == 100


def test_solve_prints_one_json_object(graph_file: Path) -> None:
    done = run("solve", graph_file, "--json", "--threads", "1")
    assert done.returncode == 0
    assert done.stderr == ""
    result = json.loads(done.stdout)
    assert 0 < result["residuals"]["median_deg"] < result["residuals"]["largest_deg"] < 180
    assert result["priors"] is None
    assert result["uncertainty"] is None
    assert result["nodes"] == 100
    assert result["components"] == 1
    assert result["status"] == "gradient_converged"
    assert set(result["certificate"]) == {
        "verdict", "lambda_min", "gap", "relative_gap", "method", "failure_probability",
        "shortfall", "tolerance", "sentence",
    }  # fmt: skip
    assert set(result["seconds"]) == {"read", "init", "solve", "certify", "total"}
    expected = rotavg.solve(rotavg.read(graph_file))
    assert result["objective"] == expected.objective
    assert result["iterations"] == expected.iterations


def test_a_solution_may_go_back_into_its_own_pose_graph(graph_file: Path) -> None:
    before = rotavg.read(graph_file)
    assert run("solve", graph_file, "-o", graph_file).returncode == 0
    np.testing.assert_array_equal(rotavg.read(graph_file).rotations, before.rotations)


def test_certificate_tolerance(graph_file: Path) -> None:
    done = run("solve", graph_file, "--certificate-tolerance", "0", "--json")
    assert done.returncode == 1
    certificate = json.loads(done.stdout)["certificate"]
    assert certificate["verdict"] == "not_certified"
    assert certificate["shortfall"] == "leftover"
    assert certificate["sentence"].startswith("optimal to a relative ")
    assert "; the tolerance is 0 (" in certificate["sentence"]
    assert "--certificate-tolerance" in certificate["sentence"]
    done = run("solve", graph_file, "--certificate-tolerance", "0")
    assert done.stdout.startswith("Not certified: 100 rotations")
    assert certificate["sentence"] in done.stdout


def test_the_limits_of_the_proof(graph_file: Path) -> None:
    by_start = ["solve", graph_file, "--json", "--certificate-max-flops", "0"]
    done = run(*by_start, "--certificate-seed", "7")
    certificate = json.loads(done.stdout)["certificate"]
    assert (done.returncode, certificate["method"]) == (0, "random_start")
    assert certificate["failure_probability"] == 1e-12
    assert certificate["sentence"] == "proved globally optimal but for a probability of 1e-12"
    done = run(*by_start, "--certificate-failure-probability", "0")
    certificate = json.loads(done.stdout)["certificate"]
    assert (certificate["verdict"], certificate["method"]) == ("estimated", "eigenvalue")
    done = run(*by_start, "--certificate-failure-probability", "1")
    assert done.returncode == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--mu", "adaptive"], "--mu is for --method sum"),
        (["--accelerate", "--method", "newton"], "--accelerate is for --method bcd or sum"),
        (["--seed", "3"], "--seed is for --init random"),
        (["--loss-scale", "2"], "--loss-scale is for --loss, which is not given or l2"),
        (["--min-cycles", "2"], "--min-cycles is for --cycle-threshold, which is not given"),
        (["--noise-variance", "1"], "--noise-variance is for --covariances, which is not given"),
        (
            ["--certificate-seed", "1", "--no-certify"],
            "--certificate-seed is not possible with --no-certify",
        ),
    ],
)
def test_options_that_would_do_nothing_are_refused(
    graph_file: Path, options: list[str], message: str
) -> None:
    done = run("solve", graph_file, *options)
    assert done.returncode == 2
    assert message in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    "options",
    [
        ["--mu", "adaptive", "--method", "sum"],
        ["--accelerate", "--method", "bcd"],
        ["--seed", "3", "--init", "random"],
        ["--min-cycles", "2", "--cycle-threshold", "30", "--loss", "auto"],
        ["--certificate-seed", "1"],
    ],
)
def test_the_same_options_are_taken_where_they_do(graph_file: Path, options: list[str]) -> None:
    assert run("solve", graph_file, *options).returncode == 0


def test_full_covariances_need_the_information(graph_file: Path) -> None:
    done = run("solve", graph_file, "--anisotropic", "--unit-weights")
    assert done.returncode == 2
    assert "--anisotropic needs the covariances that --unit-weights leaves out" in done.stderr


def test_accelerate_takes_fewer_iterations(graph_file: Path) -> None:
    iterations = []
    for extra in ([], ["--accelerate"]):
        done = run("solve", graph_file, "--method", "sum", "--json", *extra)
        assert done.returncode == 0
        iterations.append(json.loads(done.stdout)["iterations"])
    assert 3 * iterations[1] < iterations[0]


def test_not_solved_is_exit_status_1(graph_file: Path) -> None:
    done = run("solve", graph_file, "--max-iterations", "1", "--json")
    assert done.returncode == 1
    result = json.loads(done.stdout)
    assert result["status"] == "iteration_limit"
    assert result["solved"] is False
    done = run("solve", graph_file, "--max-iterations", "1")
    assert done.returncode == 1
    assert "Not solved" in done.stdout
    assert "stopped early, at the iteration limit" in done.stdout


def test_figures_that_are_not_numbers_are_null_in_json(graph_file: Path) -> None:
    done = run("solve", graph_file, "--time-limit", "0", "--json")
    assert done.returncode == 1
    assert json.loads(done.stdout)["certificate"]["lambda_min"] is None


def test_no_certify(graph_file: Path) -> None:
    done = run("solve", graph_file, "--no-certify", "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["certificate"] is None


def test_the_command_offers_every_choice_of_the_library() -> None:
    offered = {
        p.name: tuple(p.type.choices)
        for p in solve_command.params
        if isinstance(p.type, click.Choice)
    }
    choices = {"method": Method, "init": Init, "stop": Stop, "mu": Mu, "loss": Loss}
    choices["weight_kind"] = WeightKind
    choices["gauge"] = Gauge
    choices["pose_loss"] = PoseLoss
    choices["convention"] = choices["fixed_convention"] = Convention
    expected = {name: get_args(words) for name, words in choices.items()}
    expected["format"] = tuple(form.name for form in FORMATS if form.read)
    expected["output_format"] = tuple(
        form.name for form in FORMATS if form.write and form.has_solutions
    )
    assert offered == expected


def test_solve_starts_from_a_file_of_rotations(update: Path) -> None:
    tree = run("solve", update / "graph.csv", "--init", "shortest_path", "--json")
    cold = json.loads(tree.stdout)
    done = run("solve", update / "graph.csv", "--init", update / "older.csv", "--json")
    assert done.returncode == 0
    warm = json.loads(done.stdout)
    assert warm["init"] == "given"
    assert warm["iterations"] < cold["iterations"]
    assert warm["objective"] == pytest.approx(cold["objective"], rel=1e-9)
    assert warm["certificate"]["verdict"] == "proved"
    assert done.stderr.endswith("older.csv: 10 of 100 nodes of the graph are not in it\n")
    again = run("solve", update / "graph.csv", "--init", update / "older.npz", "--json")
    assert json.loads(again.stdout)["iterations"] == 0
    assert again.stderr == ""


def test_a_word_goes_before_a_file_of_the_same_name(update: Path) -> None:
    for init, used in (("chordal", "chordal"), ("./chordal", "given")):
        done = run("solve", "graph.csv", "--init", init, "--json", cwd=update)
        assert json.loads(done.stdout)["init"] == used


@pytest.mark.parametrize(
    ("init", "message"),
    [
        ("missing.csv", "'missing.csv' is not one of auto, shortest_path"),
        ("chordall", "nor a file that is there"),
        ("other.txt", "other.txt: none of its 2 nodes is in the graph, expected ids as in the"),
        ("bad.txt", "bad.txt:3: found 4 fields"),
        ("graph.csv", "graph.csv:"),
        ("none.npz", "none.npz: "),
        ("wrong.npz", "wrong.npz: rotations of node 0 is no rotation"),
        ("", "'' is not one of auto"),
        (".", "cannot be read: it is a folder, expected a file"),
    ],
)
def test_a_bad_start_is_exit_status_2(init: str, message: str, update: Path) -> None:
    done = run("solve", "graph.csv", "--init", init, "-o", "out.csv", cwd=update)
    assert done.returncode == 2
    assert message in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert not (update / "out.csv").exists()
