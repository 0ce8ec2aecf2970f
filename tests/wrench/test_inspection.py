"""A log that contradicts its rig is refused by `apply`; what may be contact is only said."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import tdfscal
from tdfscal.errors import DataError
from tdfscal.files.writers.logs import write_wrenches
from tdfscal.wrench.contact_wrench import Wrenches
from tests.cli.running import SAMPLES


def test_a_log_that_contradicts_its_rig_is_refused(
    sample: tdfscal.Calibration, tmp_path: Path
) -> None:
    """Lengths in mm that are declared to be in m."""
    folder = Path(shutil.copytree(SAMPLES / "csv", tmp_path / "campaign"))
    document = yaml.safe_load((folder / "rig.yaml").read_text())
    document["log"]["length_unit"] = "m"
    (folder / "rig.yaml").write_text(yaml.safe_dump(document))
    older = tmp_path / "older.csv"
    older.write_text("older")
    with pytest.raises(DataError, match="in mm where m is declared"):
        tdfscal.apply(sample, folder, output=older)
    assert older.read_text() == "older"


def test_a_wrench_that_is_no_number_is_refused(tmp_path: Path) -> None:
    value = np.zeros((3, 6))
    time, unknown = np.array([0.5, 0.75, 1.0]), np.full((3, 6), np.inf)
    good = Wrenches(time=time, value=value, std=unknown, calibration_std=unknown, raw=value)
    bad = replace(good, value=np.where(np.arange(3)[:, None] == 1, np.nan, value))
    target = tmp_path / "w.csv"
    with pytest.raises(DataError, match=r"at 0\.75 s is no number"):
        write_wrenches(target, [good, bad], {})
    assert not list(tmp_path.iterdir())
    assert write_wrenches(target, [good], {}) == 3
