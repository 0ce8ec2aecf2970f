"""Campaigns of two recorders, from their files to a result, held against the same in one file."""

from dataclasses import replace
from datetime import datetime
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tdfscal import calibrate, info, init
from tdfscal.errors import UsageError
from tdfscal.files.writers.campaign import write_run
from tdfscal.reporting.calibration import calibration_report
from tdfscal.simulation import MOVING, Options, Run, reference_rig, run
from tests.cli.apart import Apart, recorded_apart, write_apart


@cache
def played(scenario: str, seed: int) -> Run:
    moving = replace(MOVING["motion"], rate=100.0)
    options = moving if scenario == "motion" else Options(postures=12, squeeze=200.0)
    return run(reference_rig(), scenario, options, np.random.default_rng(seed))


def apart(folder: Path, of: Run, how: Apart) -> Path:
    recorded = of.campaign or of.moving
    assert recorded is not None
    write_apart(folder, of.rig, *recorded_apart(recorded.log, how, np.random.default_rng(1)))
    return folder


def test_two_recorders_of_a_motion_calibrate_as_one(tmp_path: Path) -> None:
    of = played("motion", 7)
    write_run(of, tmp_path / "one", format="csv")
    one = calibrate([tmp_path / "one"], trials=0)
    folder = apart(tmp_path / "two", of, Apart(offset=-81234.5, rate=30e-6, late=0.5))
    two = calibrate([folder], trials=0)
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


def test_from_two_files_to_angles_without_an_editor(tmp_path: Path) -> None:
    """`init` finds who holds what, the units, the sign; the drafted rig calibrates."""
    folder = apart(tmp_path / "two", played("self", 7), Apart(offset=1.7e9, late=1.0))
    (folder / "rig.yaml").unlink()
    files = [folder / "cnc.csv", folder / "daq.csv"]
    looked = info(files).to_dict()
    assert "Recorded 2023-11-14" in info(files).text  # 1.7e9 s, by the recorder that has dates
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
    """What both saw is used: by its length, by when it was measured, and where a reader looks."""
    name = "daq.csv"
    of, day = played("self", 7), 1.7e9
    folder = apart(tmp_path / "two", of, Apart(offset=day))
    whole = calibrate([folder], trials=0)
    assert not whole.found("recorders-overlap-in-part", "log-truncated")
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(content[: 7 * len(content) // 10])
    found = calibrate([folder], trials=0)
    assert found.accepted
    (cut,), (both,) = found.found("log-truncated"), found.found("recorders-overlap-in-part")
    assert cut.subject == (str(folder / name),)
    assert both.subject == ("daq*.csv",)
    assert of.campaign is not None
    span = 0.7 * float(np.ptp(of.campaign.log.force[0].time))
    assert (cut.size, both.size) == pytest.approx((span, span), abs=0.02 * span)
    assert found.measured is not None
    ends = [
        datetime.fromisoformat(t).timestamp() for t in (found.measured.begin, found.measured.end)
    ]
    assert ends == pytest.approx([day, day + span], abs=0.02 * span + 1.0)
    report = calibration_report(found)
    assert f"{cut.size:.1f} s of {name}" in report.claim
    assert cut.cure is not None
    assert any(cut.cure[1:] in advice for advice in report.advice)
