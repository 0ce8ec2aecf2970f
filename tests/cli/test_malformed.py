"""Malformed files: exit 3 with one paragraph, no traceback, no warning of a library."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.cli.running import run
from tests.files.logs.test_log_text_kinds import FRAME, scope, turns

HEAD = """format: tdfscal-rig/1
name: foreign
terminal: {mass: {value: 500, std: 1}, barycenter: {value: [0, 0, 0.2], std: 0.01}}
supports:
  - {name: ncp1, hinge: [0.6, 0, 0]}
  - {name: ncp2, hinge: [-0.3, 0.5, 0]}
  - {name: ncp3, hinge: [-0.3, -0.5, 0]}
"""
IN_MS = "log: {time: {field: time, unit: ms}}\n"


def cell(number: int, text: str) -> Callable[[str], str]:
    """Write a text in the place of a cell, from `number` on one that is filled, far down."""

    def change(table: str) -> str:
        lines = table.split("\n")
        mark = "\t" if "\t" in lines[-40] else ","
        cells = lines[-40].split(mark)
        place = next(k for k, old in enumerate(cells) if k >= number and old)
        cells[place] = text
        return "\n".join([*lines[:-40], mark.join(cells), *lines[-39:]])

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


def tabs(path: Path) -> None:
    np.savetxt(path, FRAME.to_numpy(), header="\t".join(FRAME.columns), delimiter="\t")


@pytest.mark.parametrize(
    ("write", "name", "block"),
    [(turns, "log.csv", ""), (scope, "log.csv", IN_MS), (tabs, "log.dat", "")],
    ids=["streams in turns", "scope", "tabs"],
)
@pytest.mark.parametrize("fault", TEXT_FAULTS)
def test_a_spoilt_table_is_refused(
    write: Callable[[Path], None],
    name: str,
    block: str,
    fault: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The sound file is read, though its random numbers are no rig's; the spoilt one is not."""
    path, rig = tmp_path / name, tmp_path / "foreign.yaml"
    write(path)
    rig.write_text(HEAD + block)
    asked = ("calibrate", path, "--rig", rig, "-o", tmp_path / "out.yaml", "-q")
    assert "log positions" in run(capsys, *asked).err
    path.write_text(TEXT_FAULTS[fault](path.read_text()))
    done = run(capsys, *asked)
    assert (done.status, done.out) == (3, ""), done.err
    assert len(done.err.splitlines()) == 1, done.err
    assert done.err.startswith("tdfscal: ")
    assert not re.search(r"Traceback|Warning|\.py\b|internal error|log positions", done.err)
