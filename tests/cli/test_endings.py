"""Whatever ends a run, or takes its words: one line, an exit status, and no file half written."""

import io
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.running import Cli

pytestmark = pytest.mark.usefixtures("here")
needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")


class Torn(io.TextIOWrapper):
    """Standard output whose reader has left."""

    def write(self, text: str) -> int:
        raise BrokenPipeError(32, "Broken pipe")


def full() -> io.TextIOWrapper:
    return open("/dev/full", "w", encoding="utf-8")  # noqa: PTH123


STDOUTS: dict[str, Callable[[], io.TextIOWrapper | None]] = {
    "closed": lambda: None,
    "full": full,
    "torn": lambda: Torn(io.BytesIO(), encoding="utf-8"),
    "ascii": lambda: io.TextIOWrapper(io.BytesIO(), encoding="ascii"),
    "cp1252": lambda: io.TextIOWrapper(io.BytesIO(), encoding="cp1252"),
}


@needs_full
@pytest.mark.parametrize("kind", STDOUTS)
def test_a_report_that_nobody_gets_changes_nothing(
    kind: str, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "w.csv"
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", STDOUTS[kind]())
        seen = cli("apply", "own.yaml", "campaign", "-o", target, "-q")
    assert seen.status == 0
    # Nobody listens to a pipe that ends, or to what is closed; a full one is the user's to know.
    assert ("No space left" in seen.err) == (kind == "full")
    assert seen.err.count("\n") == (kind == "full")
    assert len(target.read_text().splitlines()) > 4


@needs_full
@pytest.mark.parametrize("kind", ["closed", "full"])
@pytest.mark.parametrize(
    "line",
    [
        "apply own.yaml campaign -o OUT --json",
        "report own.yaml --json --html OUT",
        *("report own.yaml", "info campaign", "validate own.yaml campaign"),
    ],
)
def test_a_result_that_does_not_arrive_is_an_error_and_no_other_output_appears(
    line: str, kind: str, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / ("w.csv" if "apply" in line else "page.html")
    words = [str(target) if word == "OUT" else word for word in line.split()]
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", STDOUTS[kind]())
        seen = cli(*words, "-q")
    assert seen.status == 2
    assert "standard output" in seen.err
    assert list(tmp_path.iterdir()) == []


@needs_full
@pytest.mark.parametrize("line", ["--help", "--version", "calibrate --help"])
def test_help_that_does_not_arrive(line: str, cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", full())
        seen = cli(*line.split(), ends=2)
    assert seen.err.startswith("tdfscal: standard output: the help cannot be written: No space")
    assert seen.err.count("\n") == 1


def test_a_result_is_utf8_on_any_terminal(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    raw = io.BytesIO()
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="ascii"))
        cli("report", "own.yaml", "--json", ends=0)
        assert json.loads(raw.getvalue())["calibrations"][0]["convention"].count("·") == 4
        raw.seek(raw.truncate(0))
        cli("report", "own.yaml", ends=0)
        assert (raw.getvalue().count(b" +- ") > 8, b"?" in raw.getvalue()) == (True, False)


def program(*words: object, cwd: Path) -> subprocess.Popen[str]:
    """The program in a process of its own, which heeds signals that the tests' own may ignore."""
    line = [sys.executable, "-m", "tdfscal", *map(str, words)]
    return subprocess.Popen(
        line,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_a_run_that_is_ended_leaves_nothing(name: str, home: Path, tmp_path: Path) -> None:
    """An earlier output stays whole, after a kill too."""
    number = getattr(signal, name)
    target = tmp_path / "w.yaml"
    target.write_text("before")
    with program("calibrate", "campaign", "-o", target, "--trials", 20000, cwd=home) as done:
        assert done.stderr is not None
        for said in done.stderr:
            if "calibrating from" in said:
                break
        time.sleep(0.05)
        done.send_signal(number)
        said = done.stderr.read()
    assert target.read_text() == "before"
    if name == "SIGKILL":
        assert done.returncode == -number
    else:
        assert done.returncode == 128 + number, said
        assert said.endswith("tdfscal: interrupted; nothing was written\n")
        assert {p.name for p in tmp_path.iterdir()} == {"w.yaml"}
