"""A log that contradicts its rig is refused by `apply`; what may be contact is only said."""

import json
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
from tests.cli.running import SAMPLES, Cli, Run, rows


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


def circled(folder: Path) -> None:
    """The recorder's supports 2, 3 and 1 named 1, 2 and 3, with positions and forces."""
    document = yaml.safe_load((folder / "rig.yaml").read_text())
    fields = document["log"]["supports"]
    names = list(fields)
    document["log"]["supports"] = dict(
        zip(names, [fields[name] for name in (*names[1:], names[0])], strict=True)
    )
    (folder / "rig.yaml").write_text(yaml.safe_dump(document))


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


def test_supports_in_a_circle(calibration: Path, campaign: Path, tmp_path: Path, cli: Cli) -> None:
    circled(campaign)
    told = "ncp1 taken from ncp3 and ncp2 taken from ncp1 and ncp3 taken from ncp2"
    target = tmp_path / "c.yaml"

    def heard(seen: Run) -> None:
        assert seen.status in (0, 1), seen.err
        (warning,) = (f for f in json.loads(seen.out)["findings"] if "turned by" in f["text"])
        assert warning["code"] == "terminal-turned"
        assert "about Z of the BCS in every posture" in warning["text"]
        assert told in warning["cure"]

    heard(cli("calibrate", campaign, "-o", target, "--trials", 0, "-q", "--json"))
    heard(cli("apply", calibration, campaign, "-o", tmp_path / "w.csv", "--json"))
    heard(cli("validate", calibration, campaign, "-q", "--json"))
    assert len(rows(tmp_path / "w.csv")) > 5000
    assert "turned by" not in calibration.read_text()
