"""Every command: its exit statuses, what goes to which stream, and `--json`."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tdfscal.cli import app
from tdfscal.cli.app import made
from tests.cli.running import Run, contents, run

ERRORS = (2, 3, 4)
#: A stage of the work with the seconds since its start.
PROGRESS = re.compile(r"\[ *\d+\.\d s\] .+")


@dataclass(frozen=True)
class Case:
    """A command line, how it ends, and what it then says: the result, or the message.

    line : the output of an error is the file `kept` of the folder `out`.
    """

    line: str
    status: int
    said: str

    @property
    def command(self) -> str:
        return self.line.split()[0]


FAST = "--postures 4"
CASES = [
    Case("apply own.yaml campaign -o out/w.csv", 0, "largest: force"),
    Case("apply own.yaml badrig -o out/kept.csv", 2, "mass"),
    Case("apply own.yaml damaged -o out/kept.csv", 3, "log.parquet"),
    Case("apply broken.yaml campaign -o out/kept.csv", 3, "broken.yaml"),
    Case("calibrate campaign -o out/c.yaml --trials 0", 0, "ACCEPTED"),
    Case("calibrate campaign -o out/kept.yaml --estimator linear --trials 50", 1, "linear method"),
    Case("calibrate strict -o out/kept.yaml --html out/page.html --trials 0", 1, "REJECTED"),
    Case("calibrate strict -o out/rejected.yaml --trials 0 --allow-rejected", 1, "REJECTED"),
    Case("calibrate campaign --html - -o out/kept.yaml", 2, "standard output"),
    Case("calibrate damaged -o out/kept.yaml", 3, "log.parquet"),
    Case("calibrate brief -o out/kept.yaml --trials 0", 4, "do not determine"),
    Case("calibrate brief -o out/kept.yaml --trials 0 --html out/page.html", 4, "page.html shows"),
    Case("capability own.yaml brief", 0, "smallest contact"),
    Case("capability own.yaml turned", 1, "NOT AS IT IS"),
    Case("capability own.yaml", 2, "PATH is missing"),
    Case("capability own.yaml damaged", 3, "log.parquet"),
    Case("compare own.yaml rejected.yaml", 1, "Not verified: rejected"),
    Case("compare own.yaml survey.json", 0, "E_n"),
    Case("compare own.yaml", 2, "two files"),
    Case("compare own.yaml nowhere.yaml", 2, "nowhere.yaml"),
    Case("compare own.yaml broken.yaml", 3, "broken.yaml"),
    Case("export own.yaml --to urdf", 0, "<robot"),
    Case("export own.yaml --to dcc", 0, "DRAFT"),
    Case("export rejected.yaml --to ros --allow-rejected", 0, "REJECTED"),
    Case("export rejected.yaml --to ros -o out/kept.yaml", 1, "--allow-rejected"),
    Case("export own.yaml", 2, "--to"),
    Case("export own.yaml --to csv --capability own.yaml", 2, "holds no thresholds"),
    Case("export own.yaml --to ros -o own.yaml", 2, "replace an input"),
    Case("export broken.yaml --to csv -o out/kept.csv", 3, "broken.yaml"),
    Case("info campaign", 0, "Mapping"),
    Case("init campaign", 0, "# confirm"),
    Case("init nowhere", 2, "nowhere"),
    Case("init empty.csv -o out/kept.yaml", 3, "empty.csv"),
    Case("info empty.csv", 3, "empty.csv"),
    Case("monitor own.yaml survey.json", 0, "NO ALARM"),
    Case("monitor own.yaml turned", 1, "ALARM"),
    Case("monitor own.yaml", 2, "no history"),
    Case("monitor own.yaml broken.yaml", 3, "broken.yaml"),
    Case(f"plan campaign -o out/plan.csv {FAST}", 0, "out/plan.csv"),
    Case("plan nowhere -o out/kept.csv", 2, "nowhere"),
    Case(f"plan campaign -o out/kept.csv --given damaged {FAST}", 3, "log.parquet"),
    Case(f"plan campaign -o out/kept.csv --squeeze 0 {FAST}", 4, "do not determine"),
    Case("register moved.csv points.csv", 0, "6 points fit"),
    Case("register moved.csv nowhere.csv", 2, "nowhere.csv"),
    Case("register moved.csv unitless.csv", 3, "unit"),
    Case("register line.csv line.csv", 4, "line"),
    Case("report own.yaml", 0, "ACCEPTED"),
    Case("report own.yaml survey.json", 0, "survey.json"),
    Case("report rejected.yaml", 0, "REJECTED"),
    Case("report nowhere.yaml --html out/kept.html", 2, "nowhere.yaml"),
    Case("report broken.yaml --html out/kept.html", 3, "broken.yaml"),
    Case("schema out/schemas", 0, "rig.schema.json"),
    Case("schema empty.csv", 2, "empty.csv"),
    Case("simulate out/new --postures 3 --rate 10 --force", 0, "out/new"),
    Case("simulate campaign", 2, "campaign"),
    Case("update own.yaml brief -o out/u.yaml --trials 0", 0, "ACCEPTED"),
    Case("update own.yaml turned -o out/kept.yaml --trials 0", 1, "REJECTED"),
    Case("update own.yaml campaign -o out/kept.yaml", 2, "the same recording"),
    Case("update own.yaml damaged -o out/kept.yaml", 3, "log.parquet"),
    Case("validate own.yaml campaign", 0, "NOT CONTRADICTED"),
    Case("validate own.yaml turned --html out/v.html", 1, "RECALIBRATE"),
    Case("validate own.yaml campaign --html -", 2, "standard output"),
    Case("validate campaign own.yaml", 2, "a calibration file is wanted here"),
    Case("validate own.yaml nowhere", 2, "nowhere"),
    Case("validate own.yaml damaged", 3, "log.parquet"),
]
#: Mistakes that a person makes: the status, and words of the cure.
MISTAKES = [
    ("calibrte campaign", 2, "did you mean calibrate?"),
    ("calibrate", 2, "Example: tdfscal calibrate campaign"),
    ("calibrate campain", 2, "campain: there is no such file or folder"),
    ("calibrate campaign --trails 100", 2, "did you mean --trials?"),
    ("calibrate campaign --trials many", 2, "'--trials': this is no whole number"),
    ("calibrate campaign --trials -5", 2, "give 0 or more"),
    ("calibrate campaign --trials", 2, "--trials"),
    ("calibrate campaign --method slef", 2, "'self', 'tracker', 'joint'"),
    ("calibrate campaign -o result.txt", 2, ".json"),
    ("calibrate campaign -o nowhere/deep/result.yaml", 2, "folder"),
    ("calibrate campaign --html page.pdf", 2, ".html"),
    ("calibrate campaign --from noon", 2, "12.5, 1.5min or 2h"),
    ("calibrate hollow", 2, "rig.yaml"),
    ("calibrate move.csv", 2, "--rig"),
    ("calibrate campaign/rig.yaml", 2, "log"),
    ("calibrate campaign --rig campaign/log.parquet", 2, "campaign/log.parquet"),
    ("calibrate empty.csv --rig campaign/rig.yaml", 3, "empty.csv"),
    ("calibrate campaign --method tracker --samples moving", 2, "leave one of the two out"),
    ("apply own.yaml campaign", 2, "--output"),
    ("apply own.yaml campaign -o wrench.xls", 2, ".csv, .parquet or .mcap"),
    ("apply own.yaml campaign -o wrench.csv --filter median", 2, "'kalman'"),
    ("apply own.yaml campaign -o wrench.csv --at 1,2", 2, "--at"),
    ("validate campaign/rig.yaml campaign", 3, "Name the file that `tdfscal calibrate` wrote"),
    ("report own.yaml own.yaml", 2, "name each file once"),
    ("report - -", 2, "once only"),
    ("report own.yaml --html no/such/folder.html", 2, "folder is not there"),
    ("report own.yaml --html -  --json", 2, "name a file"),
    ("export own.yaml --to xml", 2, "'urdf', 'ros'"),
    ("register points.csv", 2, "REFERENCE is missing"),
    ("plan campaign", 2, "--output"),
    ("plan campaign -o plan.csv --travel far", 2, "0.1,0.1,0.2"),
    ("plan campaign -o plan.csv --home 1,2", 2, "0,0,0"),
    ("simulate new --scenario zero-shft", 2, "the nearest one is 'zero-shift'"),
    ("simulate new --format xlsx", 2, "'csv', 'parquet', 'mcap'"),
    ("simulate new --postures 0", 2, "give 1 or more"),
    ("monitor", 2, "Example: tdfscal monitor"),
    ("info log.csv", 2, "log.csv"),
    ("calibrate campaign --trials", 2, "'tdfscal calibrate --help'"),
    ("calibrate campaign --trails 3", 2, "'tdfscal calibrate --help'"),
    ("--verison", 2, "did you mean --version?"),
    ("-x", 2, "--help"),
]
CASES += [Case(*mistake) for mistake in MISTAKES]
GOOD = [case for case in CASES if case.status == 0]
each = pytest.mark.parametrize


COMMANDS = {name: made(name) for name in app.COMMANDS}
#: One of each command, which leaves standard output empty with `--json` too.
FIRST_ERRORS = {
    case.command: case for case in CASES if case.status in (2, 3) and case.command in COMMANDS
}.values()


@pytest.fixture(autouse=True)
def here(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in the folder; leave out drawing figures, which takes seconds too."""
    monkeypatch.chdir(home)
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")


def messages(seen: Run) -> list[str]:
    """What was said on standard error beside progress."""
    assert "Traceback" not in seen.err
    return [line for line in seen.err.splitlines() if not PROGRESS.fullmatch(line)]


def test_the_table_knows_every_command() -> None:
    assert {case.command for case in CASES} >= set(COMMANDS)
    assert {case.command for case in GOOD} == set(COMMANDS)


def test_every_command_is_seen_to_succeed_and_to_be_misused() -> None:
    for name in COMMANDS:
        assert {0, 2} <= {case.status for case in CASES if case.command == name}, name


@each("case", CASES, ids=lambda case: case.line)
def test_status_and_streams(case: Case, home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = contents(home)
    seen = run(capsys, *case.line.split())
    if case in FIRST_ERRORS:
        again = run(capsys, *case.line.split(), "--json")
        assert (again.status, again.out) == (case.status, "")
    assert seen.status == case.status, seen.err
    said = messages(seen)
    if case.status in ERRORS:
        assert seen.out == ""
        after = contents(home)
        if case.status == 4 and "--html" in case.line:
            assert b"NOT IDENTIFIABLE" in after.pop("out/page.html")  # whatever the verdict
            before.pop("out/page.html", None)
        assert after == before
        (line,) = said
        assert line.startswith("tdfscal: ")
        assert line.endswith(".")
        assert case.said.lower() in line.lower()
        assert not re.search(r"Value error|Input should", line)
        return
    assert all(line.startswith("tdfscal: ") for line in said)
    if case.command == "export" and case.status == 1:
        assert (seen.out, case.said in seen.err) == ("", True)
    else:
        assert case.said in seen.out
        assert "\x1b" not in seen.out
        assert max(map(len, seen.out.splitlines())) <= 100 or case.command == "export"
    if case.status == 1 and "--allow-rejected" not in case.line and case.command != "validate":
        after = contents(home)
        if case.command == "calibrate" and "--html" in case.line:
            assert b"REJECTED" in after.pop("out/page.html")  # whatever the verdict
            before.pop("out/page.html", None)
        assert after == before


def test_the_bare_program_shows_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    seen = run(capsys)
    assert (seen.status, seen.out) == (2, "")
    assert "Commands:" in seen.err


@each("name", ["", *COMMANDS])
def test_help_is_a_result(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    for flag in ("-h", "--help"):
        seen = run(capsys, *name.split(), flag)
        assert (seen.status, seen.err) == (0, "")
        assert "Usage: tdfscal" in seen.out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    seen = run(capsys, "--version")
    assert (seen.status, seen.err) == (0, "")
    assert re.fullmatch(r"tdfscal \d+\.\d+\.\d+\n", seen.out)


@each(
    ("fault", "status", "said"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (RuntimeError("odd"), 70, "internal error, RuntimeError: odd"),
        (OSError(28, "No space left on device", "c.yaml"), 2, "c.yaml: cannot be read or written"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_no_command_foresees(
    fault: BaseException,
    status: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(*arguments: object) -> None:
        raise fault

    monkeypatch.setattr("tdfscal.commands.report.read_sources", fail)
    seen = run(capsys, "report", "own.yaml")
    assert (seen.status, seen.out) == (status, "")
    assert seen.err.startswith("tdfscal: ")
    assert said in seen.err
    assert seen.err.count("\n") == 1


def program(*words: str, **options: Any) -> subprocess.CompletedProcess[bytes]:
    line = [sys.executable, "-m", "tdfscal", *words]
    return subprocess.run(line, capture_output=True, check=False, **options)


def test_a_pipe_in_and_out(home: Path) -> None:
    """As a process of its own: `-` is standard input, and bytes go to the right descriptor."""
    done = program("report", "-", "--json", input=(home / "own.yaml").read_bytes(), cwd=home)
    assert (done.returncode, done.stderr) == (0, b"")
    assert json.loads(done.stdout)["format"] == "tdfscal-calibration/1"


def test_a_reader_that_leaves(home: Path) -> None:
    line = f"{sys.executable} -m tdfscal schema out/left --json | true"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line], capture_output=True, check=False, cwd=home
    )
    # Here standard output is the result: what cannot be handed over leaves no other file either.
    assert done.returncode == 2
    assert not (home / "out/left").exists()
