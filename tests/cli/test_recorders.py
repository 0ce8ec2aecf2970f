"""Campaigns of two recorders, from their files to a result, held against the same in one file."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tdfscal import calibrate, info, init
from tdfscal.errors import DataError, UsageError
from tdfscal.files.writers.campaign import write_run
from tdfscal.reporting.figures import drawings
from tdfscal.simulation import MOVING, Options, Run, reference_rig, run
from tdfscal.simulation.recorded_apart import Apart, recorded_apart
from tests.cli.apart import write_apart


@cache
def played(scenario: str, seed: int) -> Run:
    options = MOVING.get(scenario) or Options(postures=12, squeeze=200.0)
    return run(reference_rig(), scenario, options, np.random.default_rng(seed))


def apart(folder: Path, of: Run, how: Apart) -> Path:
    recorded = of.campaign or of.moving
    assert recorded is not None
    write_apart(folder, of.rig, *recorded_apart(recorded.log, how, np.random.default_rng(1)))
    return folder


@pytest.mark.parametrize("scenario", ["self", "motion"])
def test_two_recorders_calibrate_as_one(scenario: str, tmp_path: Path) -> None:
    of = played(scenario, 7)
    write_run(of, tmp_path / "one", format="csv")
    one = calibrate([tmp_path / "one"], trials=0)
    folder = apart(tmp_path / "two", of, Apart(offset=-81234.5, rate=30e-6, late=0.5))
    two = calibrate([folder], trials=0)
    assert "clocks" in {drawing.name for drawing in drawings(two)}
    assert one.accepted
    assert two.accepted, two.findings
    turn = one.rpy - two.rpy
    std = one.rpy_std
    assert np.abs(turn / std).max() < 0.5


def test_files_of_no_recorder(tmp_path: Path) -> None:
    folder = apart(tmp_path / "two", played("self", 7), Apart())
    (folder / "notes.csv").write_text("a,b\n1,2\n")  # left alone in a folder
    (folder / "daq.csv").rename(folder / "forces.csv")
    with pytest.raises(UsageError, match=r"no file of the recorder `daq\*\.csv`"):
        calibrate([folder], trials=0)
    with pytest.raises(UsageError, match="file of no recorder"):
        calibrate([folder / "cnc.csv", folder / "forces.csv"], rig=folder / "rig.yaml", trials=0)


def test_recorders_of_different_campaigns(tmp_path: Path) -> None:
    folder = apart(tmp_path / "two", played("self", 7), Apart())
    other = apart(tmp_path / "other", played("self", 8), Apart())
    (other / "daq.csv").replace(folder / "daq.csv")
    with pytest.raises(DataError, match="different campaigns"):
        calibrate([folder], trials=0)


def test_a_file_with_its_newest_rows_first(tmp_path: Path) -> None:
    folder = apart(tmp_path / "two", played("self", 7), Apart())
    header, *rows = (folder / "daq.csv").read_text().splitlines()
    (folder / "daq.csv").write_text("\n".join([header, *reversed(rows)]))
    with pytest.raises(DataError, match="newest"):
        calibrate([folder], trials=0)


def test_from_two_files_to_angles_without_an_editor(tmp_path: Path) -> None:
    """`init` finds who holds what, the units, the sign; the drafted rig calibrates."""
    folder = apart(tmp_path / "two", played("self", 7), Apart(offset=1.7e9, late=1.0))
    (folder / "rig.yaml").unlink()
    files = [folder / "cnc.csv", folder / "daq.csv"]
    looked = info(files).to_dict()
    (clock,) = looked["clocks"]
    assert abs(clock["offset"] - 1.7e9) < 4.0 * clock["offset_std"] < 0.2
    blocks = looked["mapping"]["log"]
    assert [block["files"] for block in blocks] == ["cnc.csv", "daq.csv"]
    assert [block["time"]["unit"] for block in blocks] == ["ms", "s"]
    assert (blocks[0]["length_unit"], blocks[1]["force_unit"]) == ("mm", "kN")
    init(files, output=folder / "rig.yaml")
    found = calibrate([folder], trials=0)
    assert found.status == "provisional"
    assert abs(found.clocks[0].offset - 1.7e9) < 0.05


def test_a_recorder_that_ends_early_is_told(tmp_path: Path) -> None:
    folder = apart(tmp_path / "two", played("self", 7), Apart(offset=12.0))
    whole = calibrate([folder], trials=0)
    assert not [f for f in whole.findings if f.code == "recorders-overlap-in-part"]
    lines = (folder / "daq.csv").read_text().splitlines(keepends=True)
    (folder / "daq.csv").write_text("".join(lines[: 6 * len(lines) // 10]))
    (told,) = (
        f
        for f in calibrate([folder], trials=0, allow_rejected=True).findings
        if f.code == "recorders-overlap-in-part"
    )
    assert told.subject == ("daq*.csv",)
