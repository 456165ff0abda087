"""The report: what it says is true, and it is one page that keeps to itself."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from report_graphs import NASTY, doubted, in_two_parts, large, named, posed
from report_pages import Text
from rotavg import report
from rotavg.report import tables
from rotavg.report.style import VERDICTS
from rotavg.report.verdict import statement


def figures(page: str) -> dict[str, dict[str, list[dict[str, object]]]]:
    found = re.search(
        r'<script type="application/json" id="figures">\n(.*?)\n</script>', page, re.S
    )
    assert found is not None
    result: dict[str, dict[str, list[dict[str, object]]]] = json.loads(found[1])
    return result


def test_names_are_shown_and_never_run() -> None:
    solution = named()
    page = report.html(solution, title="<i>title</i>")
    text = Text(page)
    assert text.of("h1") == ["<i>title</i>"]
    worst = int(np.argmax(solution.residual_angles))
    assert str(solution.graph.edges[worst, 0]) in text.of("td")
    assert NASTY not in page
    assert f"{NASTY}0" in text.of("td")  # the first node of a component, as text
    assert "Note: 3 lines <skipped>" in text.of("p")
    assert [name for name, _ in text.tags].count("script") == 3
    hover = figures(page)["space"]["data"][1]["text"]
    assert isinstance(hover, list)
    assert hover[0] == "&lt;b&gt;0&lt;/b&gt; &amp; &quot;0&quot;.jpg"


def test_nothing_is_loaded_from_anywhere(tmp_path: Path) -> None:
    for solution in (named(), posed(tmp_path)):
        for tag, attributes in Text(report.html(solution)).tags:
            for name in ("src", "href", "action", "srcset", "data"):
                assert attributes.get(name) in (None, "data:,"), tag


def test_the_tables_tell_the_worst_edges_and_the_components() -> None:
    solution = named()
    graph, degrees = solution.graph, np.degrees(solution.residual_angles)
    table = tables.worst_edges(solution, limit=10)
    assert "10 worst of" in table.caption
    for row, k in zip(table.rows, np.argsort(-degrees)[:10]):
        assert row[:4] == [*graph.edges[k].tolist(), degrees[k], graph.weights[k]]
        assert row[-1] == k
    rows = tables.components(solution).rows
    assert [row[1] for row in rows] == [60, 7, 1]
    assert rows[2][2:6] == [0, 0.0, "", ""]
    assert sum(float(row[3]) for row in rows) == pytest.approx(solution.objective, rel=1e-12)
    only = solution.graph.subgraph(graph.nodes[solution.component == 1])
    assert rows[1][3] == pytest.approx(rotavg.solve(only).objective, rel=1e-6)
    assert rows[1][5] == pytest.approx(degrees[solution.component[graph.indices[:, 0]] == 1].max())


def test_with_priors_the_page_speaks_of_their_world() -> None:
    eye = np.eye(3)
    priors = rotavg.Priors(
        fixed={3: eye, 4: eye},
        absolute={0: (eye[[1, 2, 0]], 2.0)},
        gravity={k: ([0, 1, 1], 3.0) for k in (4, 6)},
    )
    solution = rotavg.solve(in_two_parts(), priors=priors)
    table = tables.components(solution)
    assert "Component 1 is in the world of the priors. In each other, the first" in table.caption
    assert float(table.rows[0][3]) > 1
    assert sum(float(row[3]) for row in table.rows) == pytest.approx(solution.objective, rel=1e-12)
    said = " ".join(Text(report.html(solution)).of("p"))
    assert "no other rotations fit these measurements and priors better." in said
    assert "points in the world of the priors (components that they do not hold in their" in said
    assert "the frame of the first node" not in said


@pytest.mark.parametrize("loss", ["l2", "cauchy"])
def test_with_covariances_the_page_speaks_of_what_was_minimised(loss: Any) -> None:
    solution = rotavg.solve(in_two_parts(), anisotropic="log", loss=loss)
    said = statement(solution)
    assert (said.level, "local minimum" in said.headline) == ("open", True)
    assert "there is no certificate" in said.details[0]
    assert "proved globally optimal" in said.details[1]
    assert ("final weights" in said.details[1]) == (loss == "cauchy")
    assert "asked for" not in " ".join(said.details)
    rows = tables.components(solution).rows
    assert sum(float(row[3]) for row in rows) == pytest.approx(solution.objective, rel=1e-9)
    proved = rotavg.solve(in_two_parts(), anisotropic=True, loss=loss)
    assert statement(proved).level == "proved"
    rows = tables.components(proved).rows
    assert sum(float(row[3]) for row in rows) == pytest.approx(proved.objective, rel=1e-9)
    early = rotavg.solve(in_two_parts(), anisotropic="log", max_iterations=0, certify=False)
    assert statement(early).level == "failed"
    assert len(statement(early).details) == 1


@pytest.fixture(scope="module")
def solved() -> rotavg.Solution:
    return rotavg.solve(rotavg.simulate("complete", 20, noise=0.1, seed=1).graph)


@pytest.mark.parametrize(
    ("changes", "certificate", "level", "words"),
    [
        ({}, {}, "proved", "Proved: no other rotations fit these measurements better."),
        ({}, {"verdict": rotavg.Verdict.ESTIMATED}, "estimated", "This is not a proof."),
        ({}, {"verdict": rotavg.Verdict.NOT_CERTIFIED}, "failed", "Not certified: other rotations"),
        (
            {},
            {
                "verdict": rotavg.Verdict.NOT_CERTIFIED,
                "shortfall": rotavg.Shortfall.STOPPED,
                "gap": np.inf,
            },
            "open",
            "Converged, but stopped before the",
        ),
        (
            {},
            {
                "verdict": rotavg.Verdict.NOT_CERTIFIED,
                "shortfall": rotavg.Shortfall.LEFTOVER,
                "relative_gap": 1.8e-6,
            },
            "open",
            "Optimal to a relative 1.8e-06; the tolerance is 1e-06.",
        ),
        (
            {},
            {
                "verdict": rotavg.Verdict.NOT_CERTIFIED,
                "shortfall": rotavg.Shortfall.UNDECIDED,
                "gap": np.inf,
            },
            "open",
            "Converged; nothing was established",
        ),
        (
            {},
            {"method": "random_start", "failure_probability": 1e-12},
            "proved",
            "Proved, but for a probability of 1e-12: no other",
        ),
        (
            {"status": rotavg.Status.TIME_LIMIT},
            {"verdict": rotavg.Verdict.NOT_CERTIFIED, "method": "none", "gap": np.inf},
            "failed",
            "Not solved: stopped early, at the time limit.",
        ),
        ({"certificate": None}, None, "open", "optimality unknown"),
        (
            {"certificate": None, "status": rotavg.Status.STOPPED},
            None,
            "failed",
            "Not solved: stopped early, by the callback.",
        ),
    ],
)
def test_the_headline_claims_no_more_than_is_known(
    solved: rotavg.Solution,
    changes: dict[str, object],
    certificate: dict[str, object] | None,
    level: str,
    words: str,
) -> None:
    if certificate is not None:
        assert solved.certificate is not None
        changes = {**changes, "certificate": dataclasses.replace(solved.certificate, **certificate)}  # type: ignore[arg-type]
    solution = dataclasses.replace(solved, **changes)  # type: ignore[arg-type]
    said = statement(solution)
    assert said.level == level
    assert words in said.headline
    assert ("proved" in said.headline.lower()) == (level == "proved")
    page = report.html(solution)
    assert said.headline in Text(page).of("p")
    assert not {"inf", "nan"} & set(re.findall(r"\w+", " ".join(said.details)))


def test_with_robust_weights_the_proof_is_of_the_weighted_problem(
    solved: rotavg.Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "final weights" not in " ".join(statement(solved).details)
    weights = np.linspace(0.1, 1, solved.graph.num_edges)
    monkeypatch.setattr(rotavg.Solution, "edge_weights", property(lambda _: weights))
    assert "final weights" in " ".join(statement(solved).details)
    verdicts = np.where(weights < 0.5, "robust_weight", "inlier")
    monkeypatch.setattr(
        rotavg.Solution, "edge_verdicts", property(lambda _: verdicts), raising=False
    )
    table = tables.worst_edges(solved)
    for row in table.rows:
        cells = dict(zip(table.columns, row))
        edge = int(cells["row"])
        assert cells["verdict"] == verdicts[edge]
        assert cells["final weight"] == weights[edge]
    page = report.html(solved)
    assert "final weight" in Text(page).of("button")
    assert len(figures(page)["residuals"]["data"]) == 2


def test_the_robust_section_tells_what_became_of_the_edges() -> None:
    solution = doubted()
    fit = solution.robust
    assert fit is not None
    page = report.html(solution)
    text = Text(page)
    cells = text.of("td")
    assert {"huber", f"{fit.objective:.9g}", f"{np.degrees(fit.noise):.3g}°"} <= set(cells)
    for verdict in ("inlier", "bridge", "robust_weight", "cycle_check", "weak_part"):
        count = int((solution.edge_verdicts == verdict).sum())
        assert count > 0
        assert cells[cells.index(verdict) + 1] == str(count)  # the table of verdicts comes first
    said = " ".join(text.of("p"))
    assert "that is proved of no robust loss" in said
    assert (
        "Proved, for the least squares on the edges it kept: no other rotations fit these" in said
    )
    assert "1 part of the graph is held by outliers alone" in said
    drawn = figures(page)["weights"]["data"]
    told = [verdict for verdict in VERDICTS if (solution.edge_verdicts == verdict).any()]
    assert [str(trace["name"]).split()[0] for trace in drawn] == told
    left = solution.edge_weights / solution.graph.weights
    floor = np.degrees(fit.noise) / 100
    for trace in drawn:
        x, y, rows = (unpacked(trace[name]) for name in ("x", "y", "customdata"))
        k = rows.reshape(-1, 2)[:, 0].astype(int)
        assert set(solution.edge_verdicts[k]) == {str(trace["name"]).split()[0]}
        np.testing.assert_allclose(y, left[k])
        np.testing.assert_allclose(x, np.degrees(solution.residual_angles[k]).clip(min=floor))
    table = tables.worst_edges(solution, limit=20)
    verdicts = [row[table.columns.index("verdict")] for row in table.rows]
    assert "The 20 worst of 566 edges, and further 10 of cycle_check, 4 of weak_part" in (
        table.caption
    )
    assert verdicts[20:] == ["cycle_check"] * 10 + ["weak_part"] * 4 + ["bridge"]


def unpacked(values: Any) -> NDArray[np.float64]:
    """An array as Plotly writes it, in base 64."""
    if isinstance(values, dict):
        values = np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"])
    return np.asarray(values, dtype=np.float64)


@pytest.mark.parametrize(
    "loss", ["l2", "huber", "l1", "l_half", "cauchy", "geman_mcclure", "tls", "auto"]
)
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_every_loss_is_reported_without_nonsense(loss: Any, noise: float, tmp_path: Path) -> None:
    graph = rotavg.simulate("complete", 20, noise=noise, outliers=0.2, seed=3).graph
    solution = rotavg.solve(graph, loss=loss)
    page = report.html(solution)
    rotavg.write_edges(tmp_path / "edges.csv", solution)
    shown = Text(page)
    assert ("Robust loss" in shown.of("h2")) == (loss != "l2")
    assert ("weights" in figures(page)) == (loss != "l2")
    for said in (
        str(solution),
        " ".join(words for _, words in shown.shown),
        (tmp_path / "edges.csv").read_text(),
    ):
        assert not re.search(r"\b(nan|inf|None|True|False)\b", said, re.IGNORECASE)
    assert not re.search(r"\b(NaN|Infinity)\b", json.dumps(figures(page)))


def test_a_hundred_thousand_edges_stay_below_15_mb() -> None:
    solution = large()
    assert solution.graph.num_edges > 100_000
    page = report.html(solution)
    assert len(page.encode()) < 8_000_000  # of which plotly.js is 5
    assert "200 worst of 100" in page


def test_the_smallest_graphs_have_a_report() -> None:
    exact = rotavg.MeasurementGraph.from_rotvecs([("a", "b")], [[0, 0, 1]])
    assert "Proved" in report.html(rotavg.solve(exact))
    assert "Proved" in report.html(rotavg.solve(exact, max_iterations=0))
    report.html(rotavg.solve(exact, time_limit=0.0))


def test_long_traces_are_thinned(solved: rotavg.Solution) -> None:
    k = 100_000
    trace = rotavg.Trace(*(np.linspace(2, 1, k) for _ in range(4)), seconds=np.arange(k) / 1e3)
    page = report.html(dataclasses.replace(solved, trace=trace))
    assert len(page) < 6_000_000


def test_who_adds_what(tmp_path: Path) -> None:
    """Tables of nodes, frames and sensors: the costliest first, shares of the whole objective."""
    graph = rotavg.simulate("complete", 12, noise=0.1, outliers=0.1, seed=8).graph
    images = {k: divmod(k, 2) for k in range(12)}
    rigs = rotavg.Priors(rigs=rotavg.Rigs(images))
    for priors, kinds in ((None, {"node": 12}), (rigs, {"node": 12, "frame": 6, "sensor": 2})):
        solution = rotavg.solve(graph, priors=priors, loss="auto")
        diagnosis = rotavg.diagnose(solution)
        for kind in ("node", "frame", "sensor"):
            table = tables.shares(diagnosis, kind)
            assert (table is not None) == (kind in kinds)
            if table is None:
                continue
            assert table.caption.startswith(f"All {kinds[kind]} {kind}s")
            shares = [float(row[3]) for row in table.rows]
            assert shares == sorted(shares, reverse=True)
            assert sum(shares) == pytest.approx(100)
            few = tables.shares(diagnosis, kind, limit=1)
            assert few is not None
            assert few.rows == table.rows[:1]
        page = rotavg.report.html(solution)
        assert "Who adds what" in page
        assert ("sensors: edges with an end there" in page) == (priors is not None)
