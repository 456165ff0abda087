"""The command in a terminal: colours, the bar, completion, the layout of the help."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest

import rotavg
from rotavg.cli.main import commands
from rotavg.cli.progress import Fall

pty = pytest.importorskip("pty", reason="this system has no pseudo-terminals")

COLOUR = re.compile(r"\x1b\[(?:\d+;)*3\d")
ESCAPE = re.compile(r"\x1b")


def in_terminal(
    *arguments: str | Path,
    stdout_to: Path | None = None,
    interrupt: bool = False,
    **environment: str,
) -> tuple[int, str]:
    """Exit status, and all that a terminal of 100 columns got to see."""
    try:
        master, slave = pty.openpty()
    except OSError as error:
        pytest.skip(f"no pseudo-terminal can be opened here: {error}")
    settings = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", **environment}
    for name in ("NO_COLOR", "FORCE_COLOR"):
        if name not in environment:
            settings.pop(name, None)
    stdout = slave if stdout_to is None else stdout_to.open("wb")
    process = subprocess.Popen(
        [sys.executable, "-m", "rotavg", *map(str, arguments)],
        stdout=stdout,
        stderr=slave,
        stdin=slave,
        env=settings,
    )
    os.close(slave)
    if not isinstance(stdout, int):
        stdout.close()
    seen = b""
    while True:
        try:
            part = os.read(master, 1 << 16)
        except OSError:  # how Linux tells that the other side was closed
            break
        if not part:
            break
        seen += part
        if interrupt and b"iteration" in seen:
            process.send_signal(signal.SIGINT)
            interrupt = False
    os.close(master)
    return process.wait(), seen.decode()


@pytest.fixture
def graph_file(tmp_path: Path) -> Path:
    path = tmp_path / "graph.g2o"
    rotavg.write(path, rotavg.simulate("sphere", 100, noise=0.1, seed=1).graph)
    return path


def test_colours_are_for_terminals_that_want_them(graph_file: Path) -> None:
    status, seen = in_terminal("solve", graph_file)
    assert status == 0
    assert re.search(r"verdict\S* +\x1b\[32mproved globally optimal\x1b\[0m", seen)
    assert COLOUR.search(in_terminal("solve", graph_file, "--max-iterations", "1")[1])
    assert COLOUR.search(in_terminal("solve", "missing.g2o")[1])
    for arguments in (["solve", graph_file], ["solve", "missing.g2o"], ["info", graph_file]):
        assert not COLOUR.search(in_terminal(*arguments, NO_COLOR="1")[1])
        assert not ESCAPE.search(in_terminal(*arguments, TERM="dumb")[1])


def test_a_terminal_and_a_pipe_get_the_same_words(graph_file: Path) -> None:
    _, seen = in_terminal("solve", graph_file, "--threads", "1", TERM="dumb")
    words = seen.replace("\r", "").splitlines()
    words = words[next(k for k, line in enumerate(words) if line.startswith("Solved")) :]
    done = subprocess.run(
        [sys.executable, "-m", "rotavg", "solve", str(graph_file), "--threads", "1"],
        capture_output=True,
        text=True,
        check=True,
    )
    seconds = re.compile(r"[\d.e-]+ s$")
    assert [seconds.sub("", w) for w in words] == [
        seconds.sub("", w) for w in done.stdout.splitlines()
    ]
    assert done.stderr == ""


def test_the_bar_is_on_stderr_and_json_on_stdout(tmp_path: Path) -> None:
    graph = tmp_path / "graph.npz"
    rotavg.write(graph, rotavg.simulate("band", 2000, noise=0.05, seed=1).graph)
    arguments = ["solve", graph, "--json", "--method", "bcd", "--tolerance", "0"]
    status, seen = in_terminal(*arguments, "--time-limit", "1.5", stdout_to=tmp_path / "out.json")
    assert status == 1
    assert json.loads((tmp_path / "out.json").read_text())["status"] == "time_limit"
    assert re.search(r"━.* iteration \d+, objective [\d.]+, relative gradient", seen)
    assert seen.rstrip().endswith("\x1b[2K")  # nothing stays
    assert seen.count("\x1b[?25h") == seen.count("\x1b[?25l")  # the cursor comes back


def test_ctrl_c_leaves_a_clean_terminal(tmp_path: Path) -> None:
    graph = tmp_path / "graph.npz"
    rotavg.write(graph, rotavg.simulate("band", 5000, noise=0.05, seed=1).graph)
    arguments = ["solve", graph, "--method", "bcd", "--tolerance", "0", "--no-certify"]
    status, seen = in_terminal(
        *arguments, "--report", tmp_path / "out.html", "--time-limit", "60", interrupt=True
    )
    assert status == 130
    assert "interrupted" in seen
    assert "Traceback" not in seen
    assert seen.count("\x1b[?25h") == seen.count("\x1b[?25l")
    assert sorted(tmp_path.iterdir()) == [graph]


def test_the_bar_counts_orders_of_magnitude() -> None:
    def fraction(first: float, now: float, last: float) -> float:
        fall = Fall(last)
        assert fall.fraction(0, first) < 1.0
        return fall.fraction(3, now)

    assert fraction(1e-1, 1e-3, 1e-9) == pytest.approx(2 / 8)
    assert fraction(1e-1, 1e-9, 1e-9) == 1.0
    assert fraction(1e-1, 1e-12, 1e-9) == 1.0
    for nothing_to_tell in ((1.0, 1.0, 1e-9), (1.0, 0.1, 0.0), (1.0, 2.0, 1e-9)):
        assert fraction(*nothing_to_tell) == 0.0
    again = Fall(1e-9)
    assert again.fraction(3, 1e-9) == 1.0  # the first run has converged, another begins
    assert again.fraction(0, 1e-1) == 0.0
    assert again.fraction(1, 1e-3) == pytest.approx(2 / 8)


def test_every_option_is_in_the_help_once() -> None:
    for name, command in commands.commands.items():
        context = click.Context(command, info_name=name, max_content_width=200, terminal_width=200)
        lines = command.get_help(context).splitlines()
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                option = max(parameter.opts, key=len)
                stated = [x for x in lines if re.match(rf"  (-\w, )?{option}( |$)", x)]
                assert len(stated) == 1, (name, option)
        assert "Example" in "\n".join(lines)


def test_the_groups_of_the_help_name_options_that_exist() -> None:
    for command in commands.commands.values():
        known = {parameter.name for parameter in command.params}
        assert set(getattr(command, "title_of", ())) <= known


def test_bash_completes_commands_options_words_and_files(tmp_path: Path) -> None:
    bash, program = shutil.which("bash"), Path(sys.executable).with_name("rotavg")
    if bash is None or not program.exists():
        pytest.skip("no bash, or the command is not installed beside the interpreter")
    (tmp_path / "graph.g2o").touch()

    def complete(*words: str) -> set[str]:
        line = " ".join(f"'{w}'" for w in ("rotavg", *words))
        script = (
            'eval "$(rotavg completion bash)"\n'
            f"COMP_WORDS=({line}); COMP_CWORD={len(words)}\n"
            '_rotavg_completion rotavg; printf "%s\\n" "${COMPREPLY[@]}"'
        )
        done = subprocess.run(
            [bash, "-c", script],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}"},
            check=True,
        )
        return set(done.stdout.split())

    assert complete("s") == {"solve", "simulate"}
    assert {"--method", "--max-iterations", "--mu"} <= complete("solve", "--m")
    assert {"bcd", "sum", "newton", "auto"} <= complete("solve", "--method", "")
    assert "sphere" in complete("simulate", "sp")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_are_for_this_command(shell: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rotavg", "completion", shell],
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"_ROTAVG_COMPLETE={shell}_complete" in done.stdout
