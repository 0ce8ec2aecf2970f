"""Recorded campaigns of rigs that are no part of this project, where they are present."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

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


def rpy_std_by_jacobian(document: dict[str, Any]) -> Any:
    """Standard uncertainties of roll, pitch, yaw from the file's covariance, by differences."""
    from scipy.spatial.transform import Rotation

    C = np.array(document["covariance"]["matrix"])
    assert np.allclose(C, C.T, rtol=1e-12, atol=0)
    assert np.linalg.matrix_rank(C) == len(C)
    assert np.linalg.eigvalsh(C).min() > 0
    found, h = [], 1e-6
    for i, support in enumerate(document["supports"]):
        R = Rotation.from_matrix(support["rotation"])
        columns = []
        for e in np.eye(3):
            ahead, behind = ((Rotation.from_rotvec(s * h * e) * R).as_euler("xyz") for s in (1, -1))
            columns.append((ahead - behind) / (2 * h))
        J = np.stack(columns, axis=1)
        found.append(np.sqrt(np.diagonal(J @ C[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] @ J.T)))
    return np.array(found)


def test_hub_a_calibrates(tmp_path: Path) -> None:
    done = calibrate("hub_a", tmp_path / "c.json")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "c.json").read_text())
    std = np.array([s["rpy_std"] for s in document["supports"]])
    assert std.max() < 1e-3
    assert np.allclose(std, rpy_std_by_jacobian(document), rtol=1e-6)
    assert document["monte_carlo"]["linear_interval_validated"]


def test_hub_a_by_both_methods(tmp_path: Path) -> None:
    done = calibrate("hub_a", tmp_path / "c.json", "--method", "joint", "--trials", "0")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "c.json").read_text())
    assert document["tracker"]["largest_en"] <= 1


def test_frame_b_is_refused_naming_yaw(tmp_path: Path) -> None:
    done = calibrate("frame_b", tmp_path / "c.json")
    assert done.returncode == 4
    assert all(f"yaw of ncp{i}" in done.stderr for i in (1, 2, 3, 4))
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
