"""What is told of long work where stderr is no terminal."""

from __future__ import annotations

import time

import pytest

import rotavg
from rotavg.cli import progress


def wait_for(text: str, capsys: pytest.CaptureFixture[str], already: str = "") -> str:
    """What stderr holds once it holds the text."""
    told = already
    for _ in range(500):
        told += capsys.readouterr().err
        if text in told:
            return told
        time.sleep(0.01)
    raise AssertionError(f"{text!r} is not in {told!r}")


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "FIRST_LINE_AFTER", 0.01)
    monkeypatch.setattr(progress, "LONGEST_SILENCE", 0.02)


def test_a_line_now_and_then_says_what_is_being_done(capsys: pytest.CaptureFixture[str]) -> None:
    with progress.working("reading graph.g2o"):
        told = wait_for("rotavg: reading graph.g2o, 0 s\n", capsys)
        told = wait_for("0 s\nrotavg: reading", capsys, told)
    capsys.readouterr()
    time.sleep(0.1)
    assert capsys.readouterr().err == ""  # the thread has ended


def test_a_line_also_while_certifying(capsys: pytest.CaptureFixture[str]) -> None:
    graph = rotavg.simulate("cycle", 6, noise=0.1, seed=1).graph
    seen = []
    with progress.progress() as show:
        assert show is not None
        solution = rotavg.solve(graph, callback=lambda p: (seen.append(p), show(p))[1])
        told = wait_for("rotavg: certifying, ", capsys)
        show(seen[0])
        wait_for(f"iteration 0, objective {seen[0].objective:.9g}, ", capsys, told)
    assert solution.solved


def test_the_quick_say_nothing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "FIRST_LINE_AFTER", 5.0)
    with progress.working("reading"):
        pass
    assert capsys.readouterr().err == ""
