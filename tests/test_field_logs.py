"""Recorded campaigns of rigs that are no part of this project, where they are present."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

FIELD = Path(__file__).parents[2] / "shared" / "field_logs"

pytestmark = [
    pytest.mark.field,
    pytest.mark.skipif(not FIELD.is_dir(), reason="no recorded campaigns beside the checkout"),
]


def calibrate(name: str, target: Path, *options: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "tdfscal", "calibrate", str(FIELD / name), "-o", str(target)]
    return subprocess.run([*line, *options], capture_output=True, text=True, check=False)


def test_hub_a_calibrates(tmp_path: Path) -> None:
    done = calibrate("hub_a", tmp_path / "c.json")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "c.json").read_text())
    std = np.array([s["rpy_std"] for s in document["supports"]])
    assert std.max() < 1e-3
    assert document["monte_carlo"]["linear_interval_validated"]


def test_hub_a_by_both_methods(tmp_path: Path) -> None:
    done = calibrate("hub_a", tmp_path / "c.json", "--method", "joint", "--trials", "0")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "c.json").read_text())
    assert document["tracker"]["largest_en"] <= 1


def test_frame_b_is_refused_naming_yaw(tmp_path: Path) -> None:
    done = calibrate("frame_b", tmp_path / "c.json")
    assert done.returncode == 4
    assert "yaw of every sensor" in done.stderr
    assert "Squeeze" in done.stderr
    assert not (tmp_path / "c.json").exists()


def test_hub_c_rejects_the_two_touched_postures_by_name(tmp_path: Path) -> None:
    done = calibrate("hub_c", tmp_path / "c.json", "--trials", "0")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "c.json").read_text())
    rejected = document["fit"]["rejected"]
    assert len(rejected) == 2
    assert all("contact" in posture["reason"] for posture in rejected)
    yaw = document["supports"][1]["rpy"][2]
    assert abs(yaw - np.pi / 2) < 0.1
