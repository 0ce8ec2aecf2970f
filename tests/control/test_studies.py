"""Free space and docking as studies, and their commands."""

from __future__ import annotations

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tdfscal.calibrated import independent
from tdfscal.cli import main
from tdfscal.errors import UsageError
from tdfscal.files.campaign_writer import simulate_to_folder
from tdfscal.files.logs import read_log
from tdfscal.files.rig import load_rig
from tdfscal.numerics import so3
from tdfscal.simulation import Recorder, make_rig, reference_rig
from tdfscal.studies import docking, freespace
from tdfscal.studies.controllers import given, simulated
from tdfscal.studies.ratios import ratio


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("control") / "rig"
    simulate_to_folder(folder, postures=2, rows="postures", recorder=Recorder(mean_sd=0.5))
    return folder


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["tdfscal", *map(str, arguments)])
    try:
        main()
    except SystemExit as leaving:
        return int(leaving.code or 0)
    return 0


def test_ratio_and_its_standard_error() -> None:
    """Against the scatter of many repetitions."""
    rng = np.random.default_rng(0)
    common = rng.normal(10.0, 2.0, (4000, 12))
    a, b = 0.5 * common + rng.normal(0, 0.5, common.shape), common
    found = [ratio(x, y) for x, y in zip(a, b, strict=True)]
    values = np.array([r.value for r in found])
    assert values.mean() == pytest.approx(0.5, abs=0.001)
    assert np.sqrt(np.mean([r.std**2 for r in found])) == pytest.approx(values.std(), rel=0.05)
    assert np.isnan(ratio(np.array([]), np.array([])).value)


def test_free_space_ranks_the_calibrations() -> None:
    rig = reference_rig()
    arms = simulated(rig, 3, np.random.default_rng(0))
    assert [arm.name for arm in arms.arms] == ["none", "tracker", "self"]
    setup = freespace.Setup(rig, moves=freespace.MOVES[[0, 3]], duration=2.0, rest=4.0)
    study = freespace.free_space(setup, arms, np.random.SeedSequence(1), 1)
    none, tracker, own = study.length.mean(axis=(1, 2))
    assert np.all(none > tracker)
    assert np.all(tracker > own)


def test_truth_of_given_calibrations_is_drawn_from_their_uncertainty() -> None:
    rig = reference_rig()
    X = so3.from_rpy(np.array([[0.01, 0.02, 0.3], [0.0, 0.0, 0.1], [-0.02, 0.01, 0.0]]))
    std = np.linspace(1e-3, 2e-3, 9)
    arms = given(
        rig,
        [("vague", independent(rig, X, np.eye(9))), ("good", independent(rig, X, np.diag(std**2)))],
        4000,
        np.random.default_rng(0),
    )
    d = so3.log(arms.truth.rotation @ np.swapaxes(X, -1, -2)).reshape(-1, 9)
    np.testing.assert_allclose(d.std(axis=0), std, rtol=0.05)
    assert [arm.name for arm in arms.arms] == ["none", "vague", "good"]


def test_bad_input_is_refused(rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                              capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    good = reference_rig()
    other = make_rig(mass=400.0)
    calibration = independent(other, so3.from_rpy(other.nominal_rpy), 1e-6 * np.eye(9))
    with pytest.raises(UsageError, match="of another rig: the mass is 500 kg"):
        given(good, [("c.yaml", calibration)], 2, np.random.default_rng(0))
    out = tmp_path / "out"
    far = tmp_path / "moves.csv"
    far.write_text("a,b,c,d,e,f,g,h,i,j,k,l\n0,0,0,0.4,0,0,0,0,0,0,0,0\n", encoding="utf-8")
    assert run(monkeypatch, "study", "free-space", rig, "-o", out, "--runs", "1", "-q",
               "--moves", far) == 2  # fmt: skip
    said = capsys.readouterr().err
    assert "initial posture of move 1" in said
    assert "400 mm" in said
    far.write_text("a,b\n1,2\n", encoding="utf-8")
    assert run(monkeypatch, "study", "free-space", rig, "-o", out, "-q", "--moves", far) == 2
    assert run(monkeypatch, "study", "docking", rig, "-o", out, "-q", "--logs", "xml") == 2
    assert not out.exists()
    arms = given(good, [("c", independent(good, so3.from_rpy(good.nominal_rpy), 1e-6 * np.eye(9)))],
                 1, np.random.default_rng(0))  # fmt: skip
    setup = replace(docking.Setup(good), travel=(0.25, 0.25, 0.3))
    with pytest.raises(UsageError, match="end posture of run 1"):
        docking.docking(setup, arms, np.random.SeedSequence(0), 0)


def test_docking_command(rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                         capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    out = tmp_path / "out"
    monkeypatch.setattr(docking.Setup, "__init__", _short(docking.Setup.__init__))
    options = [
        "--runs",
        "2",
        "--engagement",
        "4",
        "--logs",
        "parquet",
        "--seed",
        "2",
        "-q",
        "--json",
    ]
    assert run(monkeypatch, "study", "docking", rig, "-o", out, *options, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert [c["name"] for c in document["calibrations"]] == ["none", "tracker", "self"]
    with (out / "maxima.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 6
    outcomes = [row["outcome"] for row in rows if row["calibration"] == "self"]
    assert outcomes.count("seated") == document["calibrations"][2]["seated"]
    for name in ("docking", "maxima"):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    # The logs read as any recorder's do, at rest with the weight on the sensors.
    loaded = load_rig(out / "logs" / "rig.yaml")
    log = read_log([out / "logs" / "self-01.parquet"], loaded.log, loaded.rig.supports)
    weight = sum(float(series.value[:20, 2].mean()) for series in log.force)
    # Sensors that lean by 20 mrad see a hundredth of the internal forces, too.
    assert weight == pytest.approx(500 * 9.80665, rel=1e-2)


def _short(original: Any) -> Any:
    """A docking that starts 1 mm before contact."""

    def init(self: Any, *args: Any, **kwargs: Any) -> None:
        original(self, *args, **{"gap": 1e-3, "ramp": 0.5, **kwargs})

    return init
