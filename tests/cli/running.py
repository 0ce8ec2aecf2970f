"""Runs the command line in this process and keeps what it says."""

import csv
import json
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from tdfscal.catalogue import CATALOGUE
from tdfscal.cli import main
from tdfscal.errors import visible

ERRORS = (2, 3, 4)
#: A stage of the work with the seconds since its start.
PROGRESS = re.compile(r"\[ *\d+\.\d s\] .+")
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
        """Run it; an exit status other than `ends` fails the test with what was said.

        An error says one line beside progress, and prints nothing but, with `--json`, its object.
        """
        seen = run(self.capsys, *arguments)
        assert ends in (None, seen.status), f"{arguments}: {seen.status}\n{seen.err}{seen.out}"
        if arguments and seen.status in ERRORS:  # without a command stands the help
            (message,) = (x for x in seen.err.splitlines() if not PROGRESS.fullmatch(x))
            assert message.startswith("tdfscal: ")
            assert not seen.out or "--json" in arguments
            if seen.out:
                told = json.loads(seen.out)
                error = told["error"]
                assert (told["status"], error["code"] in CATALOGUE) == (seen.status, True)
                assert message == f"tdfscal: {error['message']}"
                assert error["where"] is None or visible(error["where"]) in message
        return seen

    def json(self, *arguments: object, ends: int | None = None) -> Any:
        """What it prints with `--json`."""
        return json.loads(self(*arguments, "--json", ends=ends).out)


def recorded(table: pa.Table, values: Mapping[str, np.ndarray]) -> pa.Table:
    """A log with other numbers in some of its columns."""
    for name, column in values.items():
        table = table.set_column(table.column_names.index(name), name, pa.array(column))
    return table


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file by its header."""
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))
