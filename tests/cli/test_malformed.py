"""Malformed files: exit 3 with one paragraph, no traceback, no warning of a library."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.running import Cli
from tests.files.logs.test_log_text_kinds import turns

HEAD = """format: tdfscal-rig/1
name: foreign
terminal: {mass: {value: 500, std: 1}, barycenter: {value: [0, 0, 0.2], std: 0.01}}
supports:
  - {name: ncp1, hinge: [0.6, 0, 0]}
  - {name: ncp2, hinge: [-0.3, 0.5, 0]}
  - {name: ncp3, hinge: [-0.3, -0.5, 0]}
"""


def cell(number: int, text: str) -> Callable[[str], str]:
    """Write a text in the place of a cell, from `number` on one that is filled, far down."""

    def change(table: str) -> str:
        lines = table.split("\n")
        cells = lines[-40].split(",")
        place = next(k for k, old in enumerate(cells) if k >= number and old)
        cells[place] = text
        return "\n".join([*lines[:-40], ",".join(cells), *lines[-39:]])

    return change


TEXT_FAULTS: dict[str, Callable[[str], str]] = {
    "a word": cell(3, "fault"),
    "not a number": cell(3, "nan"),
    "without bound": cell(3, "1e999"),
    "a hole": cell(3, ""),
    "no time": cell(0, ""),
    "a time far back": cell(0, "-1e6"),
    "a cell too many": lambda t: t.replace("\n", "\n0,0\t0", 40),
    "a line cut short": cell(3, "1\n"),
    "one line only": lambda t: t.splitlines()[0],
    "no rows": lambda t: "".join(re.findall(r"^[^0-9]*\n", t, re.MULTILINE)),
    "zeros": lambda t: t[: len(t) // 2] + "\0" * 4000 + t[len(t) // 2 + 4000 :],
    "other names": lambda t: t.replace("ncp2", "axis2"),
}


@pytest.mark.parametrize("fault", [None, *TEXT_FAULTS])
def test_a_spoilt_table_is_refused(fault: str | None, tmp_path: Path, cli: Cli) -> None:
    """The sound file is read, though its random numbers are no rig's; the spoilt one is not."""
    path, rig = tmp_path / "log.csv", tmp_path / "foreign.yaml"
    turns(path)
    rig.write_text(HEAD)
    if fault is not None:
        path.write_text(TEXT_FAULTS[fault](path.read_text()))
    done = cli("calibrate", path, "--rig", rig, "-o", tmp_path / "out.yaml", "-q")
    assert ("log positions" in done.err) is (fault is None)
    assert (done.status, done.out) == (3, ""), done.err
    assert len(done.err.splitlines()) == 1, done.err
    assert done.err.startswith("tdfscal: ")
    assert not re.search(r"Traceback|Warning|\.py\b|internal error", done.err)
