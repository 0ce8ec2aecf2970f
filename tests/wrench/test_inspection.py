"""A log that contradicts its rig is refused by `apply`; what may be contact is only said."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from tdfscal.commands.calibrate import calibrate
from tdfscal.errors import DataError
from tdfscal.files.calibration.document import save_calibration
from tdfscal.files.writers.logs import write_wrenches
from tdfscal.wrench.contact_wrench import Wrenches
from tests.cli.running import SAMPLES, Cli


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("inspection") / "cal.yaml"
    save_calibration(calibrate([SAMPLES / "csv"], trials=0), target)
    return target


def declared(**values: str) -> Callable[[Path], object]:
    """A rig file whose log block declares something else."""

    def edit(folder: Path) -> None:
        document = yaml.safe_load((folder / "rig.yaml").read_text())
        document["log"].update(values)
        (folder / "rig.yaml").write_text(yaml.safe_dump(document))

    return edit


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    folder = tmp_path / "campaign"
    shutil.copytree(SAMPLES / "csv", folder)
    return folder


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (declared(length_unit="m"), "in mm where m is declared"),
        (declared(force_on="sensor"), "set log.force_on"),
    ],
)
def test_apply_refuses_what_calibrate_refuses(
    calibration: Path,
    campaign: Path,
    tmp_path: Path,
    cli: Cli,
    recwarn: pytest.WarningsRecorder,
    fault: Callable[[Path], object],
    said: str,
) -> None:
    fault(campaign)
    older = tmp_path / "older.csv"
    older.write_text("older")
    for line in (
        ("apply", calibration, campaign, "-o", older, "-q"),
        ("calibrate", campaign, "-o", tmp_path / "c.yaml", "--trials", 0, "-q"),
    ):
        seen = cli(*line, ends=3)
        assert said.lower() in seen.err.lower()
        assert seen.err.count("\n") == 1
    assert not recwarn.list
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["older.csv"]
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
