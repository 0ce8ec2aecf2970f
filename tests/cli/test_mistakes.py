"""Mistakes that a person makes on the command line: one paragraph each, which names the cure."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.cli.running import run
from tests.cli.world import build

#: What is typed in a folder of campaigns and calibrations, the status, and words of the cure.
MISTAKES: tuple[tuple[str, int, str], ...] = (
    ("calibrte campaign", 2, "did you mean calibrate?"),
    ("Calibrate campaign", 2, "did you mean calibrate?"),
    ("calibrate", 2, "Example: tdfscal calibrate campaign"),
    ("calibrate campain", 2, "campain: there is no such file or folder"),
    ("calibrate campaign --trails 100", 2, "did you mean --trials?"),
    ("calibrate campaign --trials many", 2, "'--trials': this is no whole number"),
    ("calibrate campaign --trials -5", 2, "greater than or equal to 0"),
    ("calibrate campaign --trials", 2, "--trials"),
    ("calibrate campaign --method slef", 2, "'self', 'tracker', 'joint'"),
    ("calibrate campaign --estimator LS", 2, "'ml', 'linear'"),
    ("calibrate campaign --samples dynamic", 2, "'static', 'moving', 'all'"),
    ("calibrate campaign -o result.txt", 2, ".json"),
    ("calibrate campaign -o nowhere/deep/result.yaml", 2, "folder"),
    ("calibrate campaign -o campaign/rig.yaml", 2, "Choose another name"),
    ("calibrate campaign --html page.pdf", 2, ".html"),
    ("calibrate campaign --trials 1.5", 2, "'--trials': this is no whole number"),
    ("calibrate campaign --from noon", 2, "12.5, 1.5min or 2h"),
    ("calibrate out", 2, "rig.yaml"),
    ("calibrate move.csv", 2, "--rig"),
    ("calibrate campaign/rig.yaml", 2, "log"),
    ("calibrate campaign --rig missing.yaml", 2, "missing.yaml"),
    ("calibrate campaign --rig campaign/log.parquet", 2, "campaign/log.parquet"),
    ("calibrate badrig", 2, "mass"),
    ("calibrate empty.csv --rig campaign/rig.yaml", 3, "empty.csv"),
    ("calibrate campaign --method tracker --samples moving", 2, "leave one of the two out"),
    ("update own.yaml campaign", 2, "Example: tdfscal update"),
    ("apply own.yaml", 2, "Example: tdfscal apply"),
    ("apply own.yaml campaign", 2, "--output"),
    ("apply own.yaml campaign -o wrench.xls", 2, ".csv, .parquet or .mcap"),
    ("apply campaign own.yaml -o wrench.csv", 2, "a calibration file is wanted here"),
    ("apply own.yaml campaign -o wrench.csv --filter median", 2, "'kalman'"),
    ("apply own.yaml campaign -o wrench.csv --at 1,2", 2, "--at"),
    ("validate campaign campaign", 2, "a calibration file is wanted here"),
    ("validate campaign/rig.yaml campaign", 3, "Name the file that `tdfscal calibrate` wrote"),
    ("report broken.yaml", 3, "status"),
    ("report own.yaml own.yaml", 2, "name each file once"),
    ("report own.yaml --html -  --json", 2, "name a file"),
    ("export own.yaml", 2, "--to"),
    ("export own.yaml --to xml", 2, "'urdf', 'ros'"),
    ("export rejected.yaml --to urdf", 1, "--allow-rejected"),
    ("compare own.yaml", 2, "two"),
    ("register points.csv", 2, "REFERENCE is missing"),
    ("register unitless.csv unitless.csv", 3, "unit"),
    ("plan campaign", 2, "--output"),
    ("plan campaign -o plan.csv --travel far", 2, "0.1,0.1,0.2"),
    ("plan campaign -o plan.csv --home 1,2", 2, "0,0,0"),
    ("plan campaign -o plan.yaml", 2, ".csv"),
    ("simulate campaign", 2, "--force"),
    ("simulate new --scenario zero-shft", 2, "the nearest one is 'zero-shift'"),
    ("simulate new --scenario fire", 2, "self, tracker, contact"),
    ("simulate new --format xlsx", 2, "'csv', 'parquet', 'mcap'"),
    ("simulate new --postures 0", 2, "greater than or equal to 1"),
    ("monitor", 2, "Example: tdfscal monitor"),
    ("info log.csv", 2, "log.csv"),
    ("info campaign/rig.yaml", 2, "not a log"),
    ("--verison", 2, "did you mean --version?"),
    ("-x", 2, "--help"),
)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Campaigns and calibrations, sound and faulty."""
    home = tmp_path_factory.mktemp("world")
    build(home)
    return home


@pytest.mark.parametrize(("typed", "status", "cure"), MISTAKES)
def test_one_paragraph_names_the_cure(
    typed: str,
    status: int,
    cure: str,
    world: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(world)
    before = sorted(world.rglob("*"))
    seen = run(capsys, *typed.split())
    assert seen.status == status, seen.err
    assert cure.lower() in seen.err.lower(), seen.err
    *progress, last = seen.err.splitlines()
    assert last.startswith("tdfscal: ")
    assert all(line.startswith("[ ") for line in progress)
    assert "Value error" not in seen.err
    assert "Input should" not in seen.err
    assert seen.out == ""
    assert sorted(world.rglob("*")) == before


@pytest.mark.parametrize(
    "typed", ["calibrate {} --method SELF --trials 0 -o -", "export {} --to URDF"]
)
def test_a_choice_may_be_written_in_capitals(
    typed: str, world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = world / ("campaign" if typed.startswith("calibrate") else "own.yaml")
    assert run(capsys, *typed.format(place).split()).status == 0


def test_a_scenario_may_be_written_in_capitals(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new"
    assert run(capsys, "simulate", folder, "--scenario", "Tracker", "-q").status == 0
    shutil.rmtree(folder)


def test_nothing_typed_is_answered_by_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    seen = run(capsys)
    assert seen.status == 2
    assert "Usage: tdfscal" in seen.err
