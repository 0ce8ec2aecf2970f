"""`tdfscal calibrate` on the sample campaign: the same numbers whatever the format."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import tdfscal
from tdfscal.numerics import so3
from tests.cli.running import SAMPLES, Cli

FORMATS = ("csv", "parquet", "mcap")


@pytest.fixture(scope="module")
def documents(sample: tdfscal.Calibration) -> dict[str, Any]:
    """Calibrations of the three formats, as JSON documents."""
    others = {f: tdfscal.calibrate(SAMPLES / f, trials=0).to_dict() for f in ("csv", "mcap")}
    return others | {"parquet": sample.to_dict()}


def test_three_formats_give_the_same_angles(documents: dict[str, Any]) -> None:
    angles = {f: np.array([s["rpy"] for s in d["supports"]]) for f, d in documents.items()}
    for form in FORMATS[1:]:
        assert np.abs(angles[form] - angles["csv"]).max() < 1e-9


def test_the_truth_is_within_the_stated_uncertainty(documents: dict[str, Any]) -> None:
    from scipy import stats

    truth = yaml.safe_load((SAMPLES / "csv" / "truth.yaml").read_text())
    found = documents["csv"]
    true, rotation = (np.array([s["rotation"] for s in d["supports"]]) for d in (truth, found))
    d = so3.log(true @ np.swapaxes(rotation, 1, 2)).ravel()
    d2 = d @ np.linalg.solve(np.array(found["covariance"]["matrix"]), d)
    assert 1e-4 < stats.chi2.cdf(d2, len(d)) < 1 - 1e-4


def test_file_and_standard_output_agree(tmp_path: Path, cli: Cli) -> None:
    target = tmp_path / "c.yaml"
    seen = cli("calibrate", SAMPLES / "parquet", "-o", target, "--json", "--trials", 0, ends=0)
    printed, written = json.loads(seen.out), yaml.safe_load(target.read_text())
    assert printed == written
    assert "reading the log" in seen.err
    text = cli("report", target, ends=0)
    assert "ACCEPTED" in text.out
    moved = target.rename(tmp_path / "moved.yaml")
    text = cli("report", moved, ends=0)
    assert f"validate{moved}LOG" in "".join(text.out.split())
    moved.rename(target)
    lines = text.out.splitlines()
    assert max(len(line) for line in lines if str(tmp_path) not in line) <= 80  # paths stay whole
    said = cli.json("report", target)
    assert (said["calibrations"], said["comparisons"]) == ([printed], [])
    assert list(said)[:2] == ["command", "findings"]


@pytest.mark.parametrize("trials", [2, 999])
def test_too_few_trials_replace_no_interval(trials: int, sample: tdfscal.Calibration) -> None:
    """Both ends of a 95 % interval want trials beyond them: two trials put them at the two."""
    asked = tdfscal.calibrate(SAMPLES / "parquet", trials=trials)
    assert asked.monte_carlo is not None
    assert "intervals-by-trials" not in {finding.code for finding in asked.findings}
    for support, linear in zip(asked.supports, sample.supports, strict=True):
        assert support.rpy_interval == linear.rpy_interval
