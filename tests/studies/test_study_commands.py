"""`tdfscal study …`: tables, figures, text."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.simulation import Recorder, make_rig
from tdfscal.workflows.study.accuracy import AccuracyResult
from tests.cli.running import rows, run


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study") / "rig"
    simulate_to_folder(folder, postures=2, rows="postures", recorder=Recorder(mean_sd=0.5))
    return folder


def test_sensitivity(
    rig: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    options = ["--rpy", "0.1,0,0", "--squeeze", "0"]
    seen = run(capsys, "study", "sensitivity", rig, "-o", out, *options)
    assert seen.status == 0
    text = seen.out
    assert "81.71" in text
    assert max(map(len, text.replace(str(out), "").splitlines())) <= 80
    table = rows(out / "sensitivity.csv")
    assert len(table) == 2 * 9 * 101
    worst = max(float(row["force_error_N"]) for row in table if row["posture_roll"] == "0.0")
    assert worst == pytest.approx(81.7, abs=0.05)
    for name in ("aligned", "tilted"):
        assert (out / f"sensitivity-{name}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (out / f"sensitivity-{name}.svg").read_text(encoding="utf-8")
    seen = run(capsys, "study", "sensitivity", rig, "-o", out, "--rpy", "a,b")
    assert seen.status == 2
    assert "--rpy" in seen.err


def test_accuracy(
    rig: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn = AccuracyResult.drawings
    monkeypatch.setattr(AccuracyResult, "drawings", lambda self: drawn(self)[-1:])
    out = tmp_path / "out"
    options = ["--runs", "4", "--postures", "10", "--seed", "1", "-q", "--json"]
    seen = run(capsys, "study", "accuracy", rig, "-o", out, *options)
    assert seen.status == 0
    document = json.loads(seen.out)
    assert document["best"] == "ml"
    assert [method["method"] for method in document["methods"]] == ["ml", "linear", "tracker"]
    assert len(rows(out / "accuracy.csv")) == 3 * 9
    errors = [row for row in rows(out / "errors.csv") if row["method"] == "ml"]
    assert len(errors) == 4
    mean = sum(float(row["ncp2.pitch"]) for row in errors) / 4
    said = next(
        row
        for row in rows(out / "accuracy.csv")
        if (row["method"], row["support"], row["angle"]) == ("ml", "ncp2", "pitch")
    )
    assert float(said["mean_rad"]) == pytest.approx(mean, rel=1e-12)
    counts: dict[tuple[str, ...], int] = {}
    for row in rows(out / "histograms.csv"):
        key = (row["method"], row["support"], row["angle"])
        counts[key] = counts.get(key, 0) + int(row["count"])
    assert set(counts.values()) == {4}
    assert (out / "accuracy.png").read_bytes().startswith(b"\x89PNG")


def test_calibrations_beside_the_studies(
    rig: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tdfscal.reporting.figures.style.save", lambda *a, **k: [])
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")
    campaign, given = tmp_path / "campaign", tmp_path / "given.yaml"
    simulate_to_folder(campaign, rows="postures", recorder=Recorder(mean_sd=0.1))
    assert run(capsys, "calibrate", campaign, "--trials", "0", "-o", given).status == 0
    out, option = tmp_path / "out", ("--calibration", given, "--json")
    seen = run(capsys, "study", "sensitivity", rig, "-o", out, *option)
    assert seen.status == 0
    (found,) = json.loads(seen.out)["calibrations"]
    assert found["name"] == "given"
    for posture in found["postures"]:
        assert posture["uncalibrated"]["force"] > 10 * posture["calibrated_std"]["force"] > 0
    assert len(rows(out / "calibrations.csv")) == 2 * 9
    options = ("--runs", "2", "--workers", "1", "-q", *option)
    seen = run(capsys, "study", "accuracy", rig, "-o", out, *options)
    assert seen.status == 0
    (found,) = json.loads(seen.out)["calibrations"]
    assert np.shape(found["rpy_std"]) == (3, 3)
    assert found["factor"] > 0.5
    heavier, other = tmp_path / "heavier", tmp_path / "other.yaml"
    simulate_to_folder(
        heavier, make_rig(mass=600.0), rows="postures", recorder=Recorder(mean_sd=0.1)
    )
    assert run(capsys, "calibrate", heavier, "--trials", "0", "-o", other).status == 0
    seen = run(capsys, "study", "sensitivity", rig, "-o", out, "--calibration", other)
    assert seen.status == 2
    assert "of another rig" in seen.err
