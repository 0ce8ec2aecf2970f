"""`tdfscal register`: a transform made by hand comes back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.reporting.samples import run

RPY = (0.1, -0.2, 0.3)
SHIFT = np.array([1.0, -2.0, 0.5])


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    rng = np.random.default_rng(1)
    reference = rng.uniform(-1, 1, (8, 3))
    measured = reference @ Rotation.from_euler("xyz", RPY).as_matrix().T + SHIFT
    measured += 1e-5 * rng.standard_normal(measured.shape)
    for name, points in (("measured", measured), ("reference", reference)):
        rows = [
            f"jig,P{i},{x!r},{y!r},{z!r}" for i, (x, y, z) in enumerate((1e3 * points).tolist())
        ]
        text = "\n".join(["group,point,x,y,z", *rows]) + "\n"
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    return tmp_path / "measured.csv", tmp_path / "reference.csv"


def test_transform(pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    done = run(capsys, "register", *pair, "--unit", "mm", "--json")
    assert done.status == 0
    found = json.loads(done.out)
    off = (np.array(found["rpy"]) - RPY) / found["rpy_std"]
    shift = (np.array(found["translation"]) - SHIFT) / found["translation_std"]
    assert np.all(np.abs([*off, *shift]) < 5)
    np.testing.assert_allclose(
        Rotation.from_matrix(found["rotation"]).as_euler("xyz"), found["rpy"], rtol=0, atol=1e-12
    )
    assert len(found["points"]) == 8
    text = run(capsys, "register", *pair, "--unit", "mm").out
    assert max(map(len, text.splitlines())) <= 80
    assert "8 points fit within" in text
    assert f"{1e3 * found['rpy'][2]:.6f}" in text


def test_a_missing_unit_is_refused(
    pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    done = run(capsys, "register", *pair)
    assert done.status == 3
    assert done.out == ""
    assert "unit" in done.err
