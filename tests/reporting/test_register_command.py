"""`tdfscal register`: a transform made by hand comes back."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.cli.running import Cli
from tests.words import texts

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


def in_groups(path: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Give the upper half of a point file another group, and move it."""
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines]
    points = change(np.array([[float(v) for v in row[2:]] for row in rows[4:]]))
    for row, point in zip(rows[4:], points.tolist(), strict=True):
        row[0], row[2:] = "second", [repr(v) for v in point]
    path.write_text("\n".join([head, *(",".join(row) for row in rows)]) + "\n", encoding="utf-8")


@pytest.mark.parametrize(
    ("turn", "shift", "moved"),
    [
        ((0, 0, 0), (0, 0, 0), False),
        ((0, 0, 0), (0.0, 0.5, 0.0), True),
        ((0, 0, 0.01), (0, 0, 0), True),
    ],
)
def test_groups_that_moved_against_each_other_are_named(
    pair: tuple[Path, Path],
    turn: tuple[float, ...],
    shift: tuple[float, ...],
    moved: bool,
    cli: Cli,
) -> None:
    """The files hold 0.01 mm of noise; the second group is moved by more than ten times that."""
    R = Rotation.from_euler("xyz", turn).as_matrix()
    in_groups(pair[0], lambda points: points @ R.T + shift)
    in_groups(pair[1], lambda points: points)
    assert texts(cli.json("register", pair[0], pair[0], "--unit", "mm", ends=0)) == []
    done = cli.json("register", *pair, "--unit", "mm", ends=0)
    said = [w for w in texts(done) if "of its own" in w]
    assert len(said) == moved
    assert all("(jig, second) fits " in w for w in said)
    # Before the numbers that it concerns.
    text = cli("register", *pair, "--unit", "mm").out
    assert ("(jig, second)" in text.split("roll")[0]) == moved


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
