"""Every command: its exit statuses, what goes to which stream, and `--json`."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer.main

from tdfscal.catalogue import CATALOGUE
from tdfscal.cli import app
from tdfscal.errors import DataError, NotIdentifiableError, RigError, TdfscalError, UsageError
from tests.cli.cases import CASES, MISTAKES, Case, called
from tests.cli.running import ERRORS, PROGRESS, Cli, Run, contents

#: What Python raises where a command ends with this status.
RAISED: dict[int, type[Exception] | tuple[type[Exception], ...]] = {
    2: (UsageError, RigError),
    3: DataError,
    4: NotIdentifiableError,
}
#: One of each command, which is told as an object with `--json`.
FIRST_ERRORS = {case.command: case for case in CASES if case.status in (2, 3)}.values()
each = pytest.mark.parametrize
pytestmark = pytest.mark.usefixtures("here")


ODD = RuntimeError("odd")


def caused(error: Exception, cause: Exception) -> Exception:
    error.__cause__ = cause
    return error


def messages(seen: Run) -> list[str]:
    """What was said on standard error to people, beside progress."""
    assert "Traceback" not in seen.err
    lines = seen.err.splitlines()
    return [x for x in lines if not PROGRESS.fullmatch(x)]


@each("name", app.COMMANDS)
def test_every_command_is_seen_to_succeed_and_to_be_misused(name: str) -> None:
    assert {0, 2} <= {case.status for case in [*CASES, *MISTAKES] if case.command == name}


@each("case", [*CASES, *MISTAKES], ids=lambda case: case.line)
def test_status_and_streams(case: Case, home: Path, cli: Cli) -> None:
    before = contents(home)
    seen = cli(*case.line.split())
    if case in FIRST_ERRORS:
        again = cli(*case.line.split(), "--json")
        assert again.status == case.status
        told = json.loads(again.out)
        assert list(told) == ["command", "status", "error"]
        assert told["command"].startswith(f"tdfscal {case.command}")
    assert seen.status == case.status, seen.err
    said = messages(seen)
    if case.status in ERRORS:
        after = contents(home)
        if case.status == 4 and "--html" in case.line:
            assert b"NOT IDENTIFIABLE" in after.pop("out/page.html")  # whatever the verdict
            before.pop("out/page.html", None)
        assert after == before
        (line,) = said
        assert line.endswith(".")
        assert case.said.lower() in line.lower()
        if case in CASES:
            with pytest.raises(RAISED[case.status]) as caught:
                called(case.line)
            assert isinstance(caught.value, TdfscalError)
            assert caught.value.finding.code in CATALOGUE
            # Of the shell's options Python has parameters.
            assert "--" not in re.sub("`.*?`", "", str(caught.value))
            if "--" not in line:
                assert line == f"tdfscal: {caught.value}"
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


@each("name", ["", *app.COMMANDS])
def test_help_is_a_result(name: str, cli: Cli) -> None:
    for flag in ("-h", "--help"):
        seen = cli(*name.split(), flag)
        assert (seen.status, seen.err) == (0, "")
        assert "Usage: tdfscal" in seen.out


def test_version(cli: Cli) -> None:
    seen = cli("--version")
    assert (seen.status, seen.err) == (0, "")
    assert re.fullmatch(r"tdfscal \d+\.\d+\.\d+\n", seen.out)


@each(
    ("fault", "status", "said"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 2, "memory does not suffice"),
        (caused(ValueError("no buffer"), OSError(12, "ENOMEM")), 2, "memory does not suffice"),
        (RuntimeError("odd"), 70, "internal error, RuntimeError: odd"),
        (caused(ODD, ODD), 70, "internal error, RuntimeError: odd"),  # who looks for causes ends
        (OSError(28, "No space left on device", "c.yaml"), 2, "c.yaml: cannot be read or written"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_no_command_foresees(
    fault: BaseException, status: int, said: str, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    def fail(*arguments: object) -> None:
        raise fault

    monkeypatch.setattr("tdfscal.commands.report.read_sources", fail)
    seen = cli("report", "own.yaml", ends=status)
    assert seen.err.startswith("tdfscal: ")
    assert said in seen.err
    assert seen.err.count("\n") == 1


#: What is named in place of a file, and how that ends where each kind of file is expected: 3 is for
#: what stands in a file that may be of the kind, 2 for all that may not, and for a rig file.
ENDS = {
    "nowhere.yaml": {"rig": 2, "calibration": 2, "log": 2},
    "hollow": {"rig": 2, "calibration": 2, "log": 2},
    "empty.csv": {"rig": 2, "calibration": 2, "log": 3},
    "binary.csv": {"rig": 2, "calibration": 2, "log": 3},
    "campaign/log.parquet": {"rig": 2, "calibration": 2, "log": 0},
    "campaign/rig.yaml": {"rig": 0, "calibration": 2, "log": 2},
    "own.yaml": {"rig": 2, "calibration": 0, "log": 2},
    "page.html": {"rig": 2, "calibration": 2, "log": 2},
    "image.png": {"rig": 2, "calibration": 2, "log": 2},
    "other.yaml": {"rig": 2, "calibration": 2, "log": 2},
    "checked.json": {"rig": 2, "calibration": 2, "log": 2},
}


@each(
    ("line", "kind"),
    [
        ("calibrate THIS --rig campaign/rig.yaml", "log"),
        ("calibrate campaign/log.parquet --rig THIS", "rig"),
        ("validate THIS campaign", "calibration"),
        ("validate own.yaml THIS", "log"),
        ("validate own.yaml campaign/log.parquet --rig THIS", "rig"),
        ("apply THIS campaign -o w.csv", "calibration"),
        ("apply own.yaml THIS -o w.csv", "log"),
        ("report THIS", "calibration"),
        ("compare own.yaml THIS", "calibration"),
        ("update own.yaml THIS --rig brief/rig.yaml -o u.yaml", "log"),
        ("update THIS campaign -o u.yaml", "calibration"),
        ("plan THIS -o p.csv", "rig"),
        ("export THIS --to urdf", "calibration"),
    ],
)
def test_files_of_another_kind_end_alike(line: str, kind: str, home: Path, cli: Cli) -> None:
    (home / "binary.csv").write_bytes(bytes(range(128, 256)) * 20)
    (home / "image.png").write_bytes(b"\x89PNG\r\n" + bytes(range(256)))
    (home / "other.yaml").write_text("name: something else\n")
    (home / "page.html").write_text("<!doctype html>\n<p>nothing of ours")
    # As `validate --json` prints it, with a rig inside.
    rig = {"format": "tdfscal-rig/1"}
    result = {"command": "tdfscal validate", "findings": [], "rig": rig}
    (home / "checked.json").write_text(json.dumps(result, indent=1))
    for name, ends in ENDS.items():
        if ends[kind]:
            seen = cli(*line.replace("THIS", name).split(), "-q", ends=ends[kind])
            assert seen.err.count(name) == 1


def program(*words: str, **options: Any) -> subprocess.CompletedProcess[bytes]:
    line = [sys.executable, "-m", "tdfscal", *words]
    return subprocess.run(line, capture_output=True, check=False, **options)


def test_a_pipe_in_and_out(home: Path) -> None:
    """As a process of its own: `-` is standard input, and bytes go to the right descriptor."""
    done = program("report", "-", "--json", input=(home / "own.yaml").read_bytes(), cwd=home)
    assert (done.returncode, done.stderr) == (0, b"")
    (found,) = json.loads(done.stdout)["calibrations"]
    assert found["format"] == "tdfscal-calibration/1"
    # What is no calibration is one mistake by its path and by standard input; a pipe may never end.
    for other in (b"", b"a: 1\n", b"\x89PNG", b"format: tdfscal-rig/1\n"):
        assert program("report", "-", input=other, cwd=home).returncode == UsageError.exit_status
    os.mkfifo(home / "pipe")
    assert program("report", "pipe", cwd=home, timeout=20).returncode == UsageError.exit_status


GROUP: Any = typer.main.get_command(app.app)
COMMANDS = {name: app.made(name) for name in app.COMMANDS}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_example_is_a_command_line_that_parses(name: str) -> None:
    typed = shlex.split(COMMANDS[name].epilog.removeprefix("Example: "))
    words = name.split()
    assert typed[: 1 + len(words)] == ["tdfscal", *words]
    above = GROUP.make_context("tdfscal", words)  # whose settings a command takes
    COMMANDS[name].make_context(name, typed[1 + len(words) :], parent=above)


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_a_shell_completes(tmp_path: Path) -> None:
    """In the shell itself: take the script as the docs say, and complete a line of two words."""
    program = tmp_path / "tdfscal"
    program.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m tdfscal "$@"\n')
    program.chmod(0o755)
    place = {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "HOME": str(tmp_path)}
    script = (
        'eval "$(_TDFSCAL_COMPLETE=source_bash tdfscal)"; COMP_WORDS=(tdfscal cal); '
        'COMP_CWORD=1; _tdfscal_completion tdfscal; echo "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", script], env=os.environ | place, capture_output=True, text=True, check=False
    )
    assert done.stdout.split()[:1] == ["calibrate"], done.stderr
    assert "validate" not in done.stdout
