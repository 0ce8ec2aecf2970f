"""What the help shows: commands by purpose, an example each, completion, narrow terminals."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer.main

from tdfscal.cli import app
from tdfscal.commands.calibration import load_calibration
from tdfscal.simulation import MOVING, SCENARIOS
from tests.cli.running import SAMPLES, Cli

GROUP: Any = typer.main.get_command(app.app)
COMMANDS = {name: app.made(name) for name in app.COMMANDS}


def test_the_help_lists_every_command_under_a_purpose(cli: Cli) -> None:
    said = cli("--help").out
    order = [f"\n  {title}:" for title in ("Calibrate", "Check", "Put to work", "Plan and try")]
    places = [said.index(title) for title in order]
    assert places == sorted(places)
    for name in COMMANDS:
        assert f"\n    {name} " in said
    assert "..." not in said.split("Calibrate:")[1]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_example_is_a_command_line_that_parses(name: str) -> None:
    typed = shlex.split(COMMANDS[name].epilog.removeprefix("Example: "))
    words = name.split()
    assert typed[: 1 + len(words)] == ["tdfscal", *words]
    above = GROUP.make_context("tdfscal", words)  # whose settings a command takes
    COMMANDS[name].make_context(name, typed[1 + len(words) :], parent=above)


def test_the_help_names_every_scenario() -> None:
    scenario = next(p for p in COMMANDS["simulate"].params if p.name == "scenario")
    assert all(name in scenario.help for name in (*SCENARIOS, *MOVING, "months"))


#: In the shell itself: take the script as the docs say, and complete a line of two words.
SHELLS = {
    "bash": (
        'eval "$(_TDFSCAL_COMPLETE=source_bash tdfscal)"; COMP_WORDS=({typed}); COMP_CWORD=1; '
        '_tdfscal_completion tdfscal; echo "${{COMPREPLY[@]}}"'
    ),
    "fish": "_TDFSCAL_COMPLETE=source_fish tdfscal | source; complete -C '{typed}'",
}


@pytest.mark.parametrize("shell", SHELLS)
def test_a_shell_completes(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    program = tmp_path / "tdfscal"
    program.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m tdfscal "$@"\n')
    program.chmod(0o755)
    place = {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "HOME": str(tmp_path)}
    done = subprocess.run(
        [shell, "-c", SHELLS[shell].format(typed="tdfscal cal")],
        env=os.environ | place,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split()[:1] == ["calibrate"], done.stderr
    assert "validate" not in done.stdout


def test_text_folds_on_a_narrow_terminal(
    monkeypatch: pytest.MonkeyPatch, cli: Cli, home: Path
) -> None:
    """But for the mapping, which is to be pasted as it is."""
    monkeypatch.setenv("COLUMNS", "40")
    said = cli("info", SAMPLES / "parquet", "-q").out
    mapping = said.index("Mapping guessed")
    assert max(map(len, said[:mapping].splitlines())) <= 40
    whole = cli("report", home / "own.yaml", "-v").out
    assert max(map(len, whole.splitlines())) <= 40
    assert load_calibration(home / "own.yaml").inputs[0].sha256 in "".join(whole.split())
    assert max(map(len, cli("--help").out.splitlines())) <= 60
