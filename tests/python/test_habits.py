"""What users of Python expect of every package: copies, notebooks, frames, completion, types."""

from __future__ import annotations

import copy
import inspect
import pickle
import pydoc
import re
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg

ROOT = Path(__file__).resolve().parents[2]

SIMULATION = rotavg.simulate("sphere", 60, noise=0.05, outliers=0.05, seed=1)
GRAPH = SIMULATION.graph
TRUTH = SIMULATION.ground_truth
GRAVITY = {node: (TRUTH[node].T @ [0, 1, 0], 10.0) for node in range(60)}
PRIORS = rotavg.Priors(fixed={0: TRUTH[0]}, gravity=GRAVITY)
SOLUTIONS = {
    "l2": rotavg.solve(GRAPH),
    "auto": rotavg.solve(GRAPH, loss="auto"),
    "priors": rotavg.solve(GRAPH, priors=PRIORS),
    "robust priors": rotavg.solve(GRAPH, priors=PRIORS, loss="geman_mcclure"),
    "two components": rotavg.solve(
        rotavg.MeasurementGraph.from_rotvecs([("a", "b"), ("c", "d")], np.ones((2, 3)))
    ),
}

COPIES: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}


def same(a: Any, b: Any) -> bool:
    return np.array_equal(np.asarray(a), np.asarray(b))


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("name", SOLUTIONS)
def test_a_copy_of_a_solution_is_as_good(name: str, how: str) -> None:
    solution = SOLUTIONS[name]
    again = COPIES[how](solution)
    assert same(again.rotations, solution.rotations)
    assert not again.rotations.flags.writeable
    assert str(again) == str(solution)
    assert again.certificate == solution.certificate
    assert list(again) == list(solution)
    assert same(again.residual_angles, solution.residual_angles)
    if name != "two components":  # which has no cycle to tell the noise
        assert same(again.covariances(), solution.covariances())
    warm = rotavg.solve(again.graph, init=again)
    assert warm.init == "solution"


@pytest.mark.parametrize("how", COPIES)
def test_a_copy_of_a_graph_has_the_same_bits(how: str) -> None:
    for graph in (GRAPH, SOLUTIONS["two components"].graph):
        again = COPIES[how](graph)
        for name in ("nodes", "edges", "indices", "rotations", "weights"):
            assert same(getattr(again, name), getattr(graph, name)), name
            assert not getattr(again, name).flags.writeable
        assert same(rotavg.solve(again).rotations, rotavg.solve(graph).rotations)
        with pytest.raises(AttributeError, match="cannot be changed"):
            again.weights = np.ones(3)


@pytest.mark.parametrize("how", COPIES)
def test_so_have_all_other_results(how: str) -> None:
    results: list[Any] = [
        SIMULATION,
        SIMULATION.truth,
        rotavg.compare(SOLUTIONS["l2"], TRUTH),
        rotavg.hardness(GRAPH),
        rotavg.cycle_evidence(GRAPH, 0.1),
        SOLUTIONS["l2"].trace,
        SOLUTIONS["auto"].robust,
        GRAPH.translations,
    ]
    for result in results:
        again = COPIES[how](result)
        assert type(again) is type(result)
        for name, value in vars(result).items():
            if isinstance(value, np.ndarray):
                assert np.array_equal(getattr(again, name), value, equal_nan=value.dtype == float)
                assert getattr(again, name).flags.writeable == value.flags.writeable, name


def test_errors_keep_what_they_know() -> None:
    with pytest.raises(rotavg.GraphError) as caught:
        rotavg.MeasurementGraph([(0, 1), (1, 1)], [np.eye(3)] * 2)
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.edge) == (str(caught.value), 1)
    interrupted = pickle.loads(pickle.dumps(rotavg.Interrupted(SOLUTIONS["l2"])))
    assert same(interrupted.solution.rotations, SOLUTIONS["l2"].rotations)


class Cells(HTMLParser):
    """The text of every cell, and that all tags are closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open[-1] in ("td", "th"):
            self.cells[-1] += data


def test_notebooks_show_what_print_says() -> None:
    solution = SOLUTIONS["auto"]
    parser = Cells()
    parser.feed(solution._repr_html_())
    assert not parser.open
    said = [line.strip() for line in str(solution).splitlines()[1:]]
    pairs = list(zip(parser.cells[::2], parser.cells[1::2]))
    assert [" ".join(f"{name:<11} {text}".split()) for name, text in pairs] == [
        " ".join(line.split()) for line in said
    ]
    noted = GRAPH.with_notes("a < b & c")._repr_html_()
    parser = Cells()
    parser.feed(noted)
    assert parser.cells[-1] == "a < b & c"


def test_reprs_tell_what_arrays_there_are_and_not_what_is_in_them() -> None:
    data = rotavg.simulate("sphere", 60, noise=0.05, outliers=0.2, outlier_clusters=3, seed=1)
    solution = rotavg.solve(data.graph, loss="auto")
    assert solution.robust is not None
    assert f"edge_weights=<float64 ({data.graph.num_edges},)>" in repr(solution.robust)
    assert f"loss='{solution.robust.loss}'" in repr(solution.robust)
    evidence = rotavg.cycle_evidence(data.graph, 0.1)
    for result in (solution.robust, solution.trace, rotavg.compare(solution, data.truth), evidence):
        shown = repr(result)
        assert "\n" not in shown
        assert len(shown) < 500
    known = {node: np.eye(3) for node in range(2500)}
    gravity = {node: ([0, 1, 0], 1.0) for node in range(3)}
    priors = rotavg.Priors(fixed=known, gravity=gravity)
    assert "fixed=<dict of 2500>, absolute={}, gravity=<dict of 3>" in repr(priors)
    rigs = rotavg.Rigs({node: (node // 2, node % 2) for node in range(60)})
    for summarised in (priors, rigs, data, rotavg.hardness(data.graph)):
        shown = repr(summarised)
        assert "\n" not in shown
        assert len(shown) < 500
    small = rotavg.compare(np.eye(3)[None].repeat(3, axis=0), np.eye(3)[None].repeat(3, axis=0))
    assert "nodes=[0, 1, 2]" in repr(small)


def test_completion_shows_public_names_only() -> None:
    shown = dir(rotavg)
    assert set(rotavg.__all__) <= set(shown)
    assert not [name for name in shown if name.startswith("_") and name != "__version__"]
    for name in set(shown) - set(rotavg.__all__):
        assert inspect.ismodule(getattr(rotavg, name)), name


def test_modules_are_there_at_their_first_use() -> None:
    code = (
        "import sys, rotavg\n"
        "assert not {'rotavg.plot', 'rotavg.report', 'rotavg.colmap'} & set(sys.modules)\n"
        "print(rotavg.plot.residuals, rotavg.report.Run, rotavg.images.measure,"
        " rotavg.colmap.reconstruct, rotavg.partners.to_gtsam, rotavg.io.FORMATS)\n"
        "assert not {'matplotlib', 'plotly', 'cv2', 'pycolmap', 'gtsam'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    with pytest.raises(AttributeError, match="no attribute 'plots'"):
        rotavg.plots  # noqa: B018


def test_constructors_say_what_they_take() -> None:
    expected = set(inspect.signature(rotavg.MeasurementGraph).parameters) - {"edges", "rotations"}
    for name in ("from_quaternions", "from_rotvecs", "from_scipy"):
        parameters = inspect.signature(getattr(rotavg.MeasurementGraph, name)).parameters
        assert expected <= set(parameters), name
        assert not any(p.kind is p.VAR_KEYWORD for p in parameters.values())


def test_help_tells_what_there_is() -> None:
    text = pydoc.plain(pydoc.render_doc(rotavg))
    for name in ("MeasurementGraph", "solve", "certify", "Priors", "plot", "rotavg.Error"):
        assert name in text
    for name in rotavg.__all__:
        if name != "__version__":
            assert len(pydoc.plain(pydoc.render_doc(getattr(rotavg, name)))) > 100, name


def test_scipy_rotations_are_understood_where_matrices_are() -> None:
    transform = pytest.importorskip("scipy.spatial.transform")
    relative = transform.Rotation.from_matrix(GRAPH.rotations)
    graph = rotavg.MeasurementGraph(GRAPH.edges, relative)
    assert np.abs(graph.rotations - GRAPH.rotations).max() < 1e-14
    truth = transform.Rotation.from_matrix(TRUTH)
    value = rotavg.objective(GRAPH, TRUTH)
    assert rotavg.objective(GRAPH, truth) == pytest.approx(value, rel=1e-12)
    assert np.allclose(rotavg.gradient(GRAPH, truth), rotavg.gradient(GRAPH, TRUTH), atol=1e-12)
    assert rotavg.certify(GRAPH, truth).verdict == rotavg.certify(GRAPH, TRUTH).verdict
    assert rotavg.solve(GRAPH, init=truth).init == "given"
    held = rotavg.solve(GRAPH, priors=rotavg.Priors(fixed={0: truth[0]}))
    assert np.abs(held[0] - TRUTH[0]).max() < 1e-12
    assert rotavg.compare(truth, TRUTH).mean < 1e-7


def test_masked_numbers_are_refused_and_lists_of_scipy_rotations_understood() -> None:
    transform = pytest.importorskip("scipy.spatial.transform", reason="SciPy is not installed")
    turns = [transform.Rotation.from_rotvec([0.1 * k, 0.0, 0.2]) for k in range(3)]
    edges, matrices = [(0, 1), (1, 2), (2, 0)], np.array([turn.as_matrix() for turn in turns])
    graph = rotavg.MeasurementGraph(edges, turns)
    np.testing.assert_allclose(graph.rotations, matrices, atol=1e-15)
    mask = np.zeros(matrices.shape, np.bool_)
    rotavg.MeasurementGraph(edges, np.ma.masked_array(matrices, mask=mask))  # nothing is masked
    mask[1] = True
    with pytest.raises(rotavg.GraphError, match="rotations are masked in part"):
        rotavg.MeasurementGraph(edges, np.ma.masked_array(matrices, mask=mask))
    with pytest.raises(rotavg.GraphError, match="weights are masked in part"):
        rotavg.MeasurementGraph(edges, matrices, np.ma.masked_array(np.ones(3), mask=[0, 1, 0]))


def test_frames_go_out_and_come_back() -> None:
    pandas = pytest.importorskip("pandas")
    frame = GRAPH.with_weights(np.arange(1.0, GRAPH.num_edges + 1)).to_dataframe()
    again = rotavg.MeasurementGraph.from_dataframe(frame)
    assert same(again.edges, GRAPH.edges)
    assert np.abs(again.rotations - GRAPH.rotations).max() < 1e-14
    assert same(again.weights, np.arange(1.0, GRAPH.num_edges + 1))

    named = pandas.DataFrame(
        {"j": ["b", "c"], "i": ["a", "b"], "rz": [0.1, 0.2], "ry": 0.0, "rx": 0.0, "more": "x"}
    )
    graph = rotavg.MeasurementGraph.from_dataframe(named, convention="vision")
    assert graph.edges.tolist() == [["a", "b"], ["b", "c"]]
    assert np.arctan2(graph.rotations[:, 0, 1], graph.rotations[:, 0, 0]) == pytest.approx(
        [0.1, 0.2]
    )
    matrices = pandas.DataFrame(
        {"i": [0], "j": [1], **{f"r{a}{b}": [float(a == b)] for a in range(3) for b in range(3)}}
    )
    assert same(rotavg.MeasurementGraph.from_dataframe(matrices).rotations[0], np.eye(3))

    told = SOLUTIONS["auto"].edges_to_dataframe()
    assert told["is_outlier"].sum() == SOLUTIONS["auto"].is_outlier.sum()
    assert same(told["residual"], SOLUTIONS["auto"].residual_angles)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"i": [0]}, "expected i and j"),
        ({"i": [0], "j": [1]}, "expected qx qy qz qw, rx ry rz .* or r00 to r22"),
        ({"i": [0], "j": [1], "rx": [0.0], "ry": ["x"], "rz": [0.0]}, "are no numbers"),
        ({"i": [0], "j": [1], "rx": [0.0], "ry": [np.nan], "rz": [0.0]}, "expected finite"),
        ({"i": [0], "j": [1], "qx": [0], "qy": [0], "qz": [0], "qw": [0]}, "quaternion is zero"),
    ],
)
def test_frames_that_are_no_graphs_are_refused(columns: dict[str, Any], message: str) -> None:
    pandas = pytest.importorskip("pandas")
    with pytest.raises(rotavg.GraphError, match=message):
        rotavg.MeasurementGraph.from_dataframe(pandas.DataFrame(columns))


def test_what_is_no_frame_is_refused() -> None:
    with pytest.raises(rotavg.GraphError, match=r"expected a pandas\.DataFrame"):
        rotavg.MeasurementGraph.from_dataframe([1, 2])


def test_noise_and_graphs_of_ones_own() -> None:
    ring = [(0, 1), (1, 2), (2, 3), (3, 0)]

    def about_z(rng: np.random.Generator, m: int) -> Any:
        return np.stack([np.zeros(m), np.zeros(m), rng.uniform(0.1, 0.2, m)], axis=1)

    simulation = rotavg.simulate(ring, 4, noise=about_z, seed=5)
    assert simulation.graph.edges.tolist() == [list(edge) for edge in ring]
    i, j = np.array(ring).T
    truth = simulation.ground_truth
    error = truth[j].transpose(0, 2, 1) @ truth[i] @ simulation.graph.rotations
    angles = np.arctan2(error[:, 1, 0], error[:, 0, 0])
    assert ((angles > 0.1) & (angles < 0.2)).all()
    assert np.abs(error[:, 2, 2] - 1).max() < 1e-12
    again = rotavg.simulate(np.array(ring), 4, noise=about_z, seed=5)
    assert same(again.graph.rotations, simulation.graph.rotations)


@pytest.mark.parametrize(
    ("edges", "message"),
    [
        ([(0, 1, 2)], "expected integers"),
        ([(0.0, 1.0)], "expected integers"),
        ([], "expected integers"),
        ([(0, 4)], r"edge 0 is \(0, 4\), expected nodes 0 to 3"),
    ],
)
def test_graphs_of_ones_own_are_checked(edges: Any, message: str) -> None:
    with pytest.raises(rotavg.GraphError, match=message):
        rotavg.simulate(edges, 4)


def test_results_become_a_table_for_a_paper() -> None:
    table = rotavg.report.latex_table(
        {"a_b & c": SOLUTIONS["l2"], "auto": SOLUTIONS["auto"]}, TRUTH
    )
    lines = table.splitlines()
    assert lines[0] == r"\begin{tabular}{lrrrrrrr}"
    assert lines[-1] == r"\end{tabular}"
    rows = [line for line in lines if line.endswith(r"\\")]
    assert {len(re.split(r"(?<!\\)&", row)) for row in rows} == {8}
    assert rows[1].startswith(r"a\_b \& c & ")
    median = np.degrees(rotavg.compare(SOLUTIONS["l2"], TRUTH).median)
    assert f"{median:.4g}" in rows[1]
    with pytest.raises(rotavg.GraphError, match="no solutions"):
        rotavg.report.latex_table({})


def test_the_readmes_programs_have_types(tmp_path: Path) -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    programs = []
    for k, block in enumerate(re.findall(r"```python\n(.*?)```", readme, re.DOTALL)):
        programs.append(tmp_path / f"program{k}.py")
        programs[-1].write_text(block)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", *map(str, programs)],
        cwd=ROOT,
        env={"MYPYPATH": str(ROOT / "python"), "PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
