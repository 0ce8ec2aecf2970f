"""Malformed files: exit 3 with one paragraph, no traceback, no warning of a library."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.cli.running import Run, run
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


def check(done: Run) -> None:
    assert (done.status, done.out) == (3, ""), done.err
    assert len(done.err.splitlines()) == 1, done.err
    assert done.err.startswith("tdfscal: ")
    assert not re.search(r"Traceback|Warning|\.py\b|internal error", done.err)


def check_log(
    log: Path, block: str, spoil: Callable[[], object], capsys: pytest.CaptureFixture[str]
) -> None:
    """The sound file is read, though its random numbers are no rig's; the spoilt one is not."""
    rig = log.parent / "foreign.yaml"
    rig.write_text(HEAD + block)
    asked = ("calibrate", log, "--rig", rig, "-o", rig.with_name("out.yaml"), "-q")
    assert "log positions" in run(capsys, *asked).err
    spoil()
    done = run(capsys, *asked)
    check(done)
    assert "log positions" not in done.err


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


@pytest.mark.parametrize("fault", TEXT_FAULTS)
def test_streams_that_take_turns(
    fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "log.csv"
    turns(path)
    spoilt = TEXT_FAULTS[fault](path.read_text())
    check_log(path, "", lambda: path.write_text(spoilt), capsys)


@pytest.mark.parametrize("fault", TEXT_FAULTS)
def test_scope_exports(fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "log.csv"
    scope(path)
    spoilt = TEXT_FAULTS[fault](path.read_text())
    check_log(path, IN_MS, lambda: path.write_text(spoilt), capsys)


@pytest.mark.parametrize("fault", TEXT_FAULTS)
def test_tables_apart_by_tabs(
    fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "log.dat"
    np.savetxt(path, FRAME.to_numpy(), header="\t".join(FRAME.columns), delimiter="\t")
    spoilt = TEXT_FAULTS[fault](path.read_text())
    check_log(path, "", lambda: path.write_text(spoilt), capsys)
