"""Whatever ends a run, or takes its words: one line, an exit status, and no file half written."""

from __future__ import annotations

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
INTERRUPTED = "tdfscal: interrupted; nothing was written\n"


def python(code: str, folder: Path, *rest: object) -> tuple[int, str, str]:
    """Exit status, output and errors of a process of its own."""
    words = [sys.executable, "-c", code, *map(str, rest)]
    done = subprocess.run(
        words, cwd=folder, capture_output=True, text=True, check=False, timeout=15
    )
    return done.returncode, done.stdout, done.stderr


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
needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")


@needs_full
@pytest.mark.parametrize("kind", STDOUTS)
def test_a_report_that_nobody_gets_changes_nothing(
    kind: str, home: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
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


def test_a_report_that_cannot_be_made_is_an_error(
    home: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(report: object, *, whole: bool) -> str:
        raise ValueError("no such row")

    monkeypatch.setattr("tdfscal.reporting.text.shown", broken)
    seen = cli("report", "own.yaml", ends=70)
    assert "no such row" in seen.err


@pytest.mark.parametrize(
    ("name", "said"),
    [("tdfscal.cli", ""), ("tdfscal.cli.process", INTERRUPTED), ("typer", INTERRUPTED)],
)
def test_an_interruption_among_the_imports_is_heard(name: str, said: str, home: Path) -> None:
    """Before the command's entry nothing is imported but the package's own few lines."""
    code = f"""
import builtins, sys
before = set(sys.modules)
from tdfscal import _main
assert set(sys.modules) - before == {{"tdfscal"}}
whole = builtins.__import__
def interrupted(name, *rest):
    if name == {name!r}:
        raise KeyboardInterrupt
    return whole(name, *rest)
builtins.__import__, sys.argv = interrupted, ["tdfscal", "--version"]
_main()
"""
    assert python(code, home) == (130, "", said)


@needs_full
@pytest.mark.parametrize("kind", ["closed", "full"])
@pytest.mark.parametrize(
    "line", ["apply own.yaml campaign -o OUT --json", "report own.yaml --json --html OUT"]
)
def test_a_result_that_does_not_arrive_is_an_error_and_no_other_output_appears(
    line: str, kind: str, home: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / ("w.csv" if "apply" in line else "page.html")
    words = [str(target) if word == "OUT" else word for word in line.split()]
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", STDOUTS[kind]())
        seen = cli(*words, "-q")
    assert seen.status == 2
    assert "standard output" in seen.err
    assert list(tmp_path.iterdir()) == []


def test_a_result_is_utf8_whatever_the_terminal_is(
    home: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw = io.BytesIO()
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="ascii"))
        cli("report", "own.yaml", "--json", ends=0)
        assert json.loads(raw.getvalue())["calibrations"][0]["convention"].count("·") == 4


def program(*words: object, cwd: Path) -> subprocess.Popen[str]:
    """The program in a process of its own, which heeds signals that the tests' own may ignore."""

    def heed() -> None:
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)

    line = [sys.executable, "-m", "tdfscal", *map(str, words)]
    return subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=cwd, preexec_fn=heed
    )


@pytest.mark.parametrize("name", ["SIGTERM", "SIGKILL"])
def test_a_run_that_is_ended_leaves_nothing(name: str, home: Path, tmp_path: Path) -> None:
    """An earlier output stays whole, after a kill too."""
    number = getattr(signal, name)
    target = tmp_path / "w.csv"
    target.write_text("before")
    with program(
        "calibrate", "campaign", "-o", tmp_path / "c.yaml", "--trials", 20000, cwd=home
    ) as done:
        assert done.stderr is not None
        for said in done.stderr:
            if "calibrating from" in said:
                break
        time.sleep(0.05)
        done.send_signal(number)
        said = done.stderr.read()
    if name == "SIGKILL":
        assert done.returncode == -number
    else:
        assert done.returncode == 128 + number, said
        assert "interrupted" in said
        assert {p.name for p in tmp_path.iterdir()} == {"w.csv"}
    assert target.read_text() == "before"


def test_a_working_folder_that_is_gone(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    code = (
        "import os, sys; from tdfscal.cli import main; os.rmdir(os.getcwd()); "
        "sys.argv = ['tdfscal', 'calibrate', 'C']; main()"
    )
    status, out, said = python(code, gone)
    assert (status, out, said.count("\n")) == (2, "", 1)


WRAPPED = """
import os, signal
class Descriptor:
    def __set_name__(self, owner, name):
        os.kill(os.getpid(), signal.SIGTERM)
def work(*args):
    type("Owner", (), {"field": Descriptor()})  # makes a RuntimeError of what is raised
"""


def test_a_signal_ends_the_run_though_another_exception_is_made_of_it(home: Path) -> None:
    code = WRAPPED + (
        "import sys; from tdfscal.cli import main; import tdfscal.commands.report as r;"
        "r.read_sources = work; sys.argv = ['tdfscal', 'report', 'own.yaml']; main()"
    )
    assert python(code, home) == (143, "", INTERRUPTED)


CALLED_BACK = """
import contextlib, os, signal, sys, time, weakref
class Dying:
    def __del__(self):
        {deleted}
def meet(*args):
    dying = Dying()
    reference = weakref.ref(dying, lambda _: {released})
    del dying
    with contextlib.suppress(BaseException):
        {dropped}
    for _ in range(200):
        time.sleep(0.01)
    print("it went on")
from tdfscal import cli
sys.argv = ["tdfscal", "report", "own.yaml"]
{line}
cli.main()
"""
LATE = "import tdfscal.commands.report as r; r.read_sources = meet"
EARLY = "sys.meta_path.insert(0, type('', (), {'find_spec': meet}))"


@pytest.mark.parametrize(
    ("line", "status", "where"),
    [(LATE, 143, "deleted"), (EARLY, 130, "released"), (LATE, 143, "dropped")],
)
def test_a_signal_that_meets_a_callback_ends_the_run(
    home: Path, line: str, status: int, where: str
) -> None:
    """What is raised there Python prints and drops: as an object goes, or a weak reference.

    Other code drops it without a word: pydantic as it hashes or writes, numpy as it looks at types.

    Before the program listens, the signal is the interruption, that Python itself answers.
    """
    call = f"os.kill(os.getpid(), {status - 128}) or len('x')"
    code = CALLED_BACK.format(
        **{"deleted": "pass", "released": "None", "dropped": "pass", where: call}, line=line
    )
    assert python(code, home) == (status, "", INTERRUPTED)


MOVED = """
import atexit, contextlib, os, signal, sys
from pathlib import Path
from tdfscal import _main
from tdfscal.files import outputs
def drop(*args):
    with contextlib.suppress(BaseException):
        os.kill(os.getpid(), signal.SIGTERM)
def after(move, *args):
    move(*args)
    os.kill(os.getpid(), signal.SIGTERM)
appear, replace = outputs.Outputs.appear, Path.replace
{line}
sys.argv = ["tdfscal", "export", "own.yaml", "-q", "--to", "csv", "-o", sys.argv[1]]
_main()
"""
BEFORE = "outputs.Outputs.appear = lambda self: drop() or appear(self)"
AMONG = "Path.replace = lambda *paths: after(replace, *paths)"
LAST = "atexit.register(os.kill, os.getpid(), signal.SIGTERM)"


@pytest.mark.parametrize(("line", "status"), [(BEFORE, 143), (AMONG, 0), (LAST, 0)])
def test_outputs_appear_wholly_or_after_no_signal(
    home: Path, tmp_path: Path, line: str, status: int
) -> None:
    """One that was heard, though dropped, keeps them away; one among or after them is late."""
    target = tmp_path / "supports.csv"
    target.write_text("before")
    ended, _, said = python(MOVED.format(line=line), home, target)
    assert (ended, said) == (status, INTERRUPTED if status else "")
    assert (target.read_text() == "before") == bool(status)
    assert list(tmp_path.iterdir()) == [target]
