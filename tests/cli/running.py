"""Runs the command line in this process and keeps what it says."""

from __future__ import annotations

import csv
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tdfscal.cli import main

SAMPLES = Path(__file__).parents[2] / "sample_data"


@dataclass(frozen=True)
class Run:
    """Exit status, standard output, standard error."""

    status: int
    out: str
    err: str


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> Run:
    """Run `tdfscal` with these arguments."""
    capsys.readouterr()
    old, sys.argv = sys.argv, ["tdfscal", *map(str, arguments)]
    try:
        main()
        status = 0
    except SystemExit as end:
        status = int(end.code or 0)
    finally:
        sys.argv = old
    captured = capsys.readouterr()
    return Run(status, captured.out, captured.err)


@dataclass(frozen=True)
class Cli:
    """The fixture `cli`: runs `tdfscal`, and may say how it has to end."""

    capsys: pytest.CaptureFixture[str]

    def __call__(self, *arguments: object, ends: int | None = None) -> Run:
        """ends : the exit status, of which anything else fails the test with what was said."""
        seen = run(self.capsys, *arguments)
        assert ends in (None, seen.status), f"{arguments}: {seen.status}\n{seen.err}{seen.out}"
        return seen


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file by its header."""
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))
