"""What the help shows: commands by purpose, an example each, completion, narrow terminals."""

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
