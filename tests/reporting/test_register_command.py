"""`tdfscal register`: a transform made by hand comes back."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.cli.running import SAMPLES, Cli

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


def test_options_of_instrument_and_groups(pair: tuple[Path, Path], cli: Cli) -> None:
    measured, reference = pair
    measured.write_text(measured.read_text(encoding="utf-8").replace("jig", "A"), encoding="utf-8")
    asked = ("register", measured, reference, "--unit", "mm", "--groups", "A=jig")
    stated = ("--range", "1e-5", "--range-ppm", "0", "--angle-arcsec", "1")
    found = cli.json(*asked, *stated, ends=0)
    assert found["sigma"] is None
    assert found["dof"] == 3 * 8 - 6
    assert abs(found["scale"] - 1) < 5 * found["scale_std"]
    for wrong in (["--range", "1e-5"], ["--range", "-1"], ["--groups", "A"], ["--match", "best"]):
        cli(*asked, *wrong, ends=2)


def test_groups_in_frames_of_their_own(cli: Cli) -> None:
    """Targets on several sensors share no frame: the advice is to take them one by one."""
    survey = SAMPLES / "csv" / "tracker"
    done = cli("register", survey / "targets.csv", survey / "nominal.csv", "--unit", "mm", ends=4)
    assert "The groups ncp1, ncp2, ncp3 may have a frame each" in " ".join(done.err.split())
