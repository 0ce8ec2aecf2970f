"""The plan's CSV as a machine reads it, and the command."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from tdfscal import read_log
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.simulation import Recorder
from tests.cli.running import Cli


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plan") / "rig"
    recorder = Recorder(mean_sd=0.5)
    simulate_to_folder(folder, postures=6, rows="postures", recorder=recorder)
    return folder


def table(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


@pytest.mark.parametrize(
    ("options", "status", "said"),
    [
        (["--travel", "ncp7=0.1"], 2, "no support 'ncp7'"),
        (["--travel", "wide"], 2, "no list of numbers"),
        (["--force-limit", "100"], 2, "the weight alone puts"),
        (["--tilt", "70"], 2, "--tilt: 70.0 is too large"),
        (["--force-limit", "nan"], 2, "--force-limit: expected a number"),
        (["--motion", "--duration", "5"], 2, "--duration: 5.0 is too small"),
        (["--postures", "5", "--target", "1"], 2, "two different things"),
        (["--target", "0.001"], 4, "is asked for"),
    ],
)
def test_faults_are_named_and_leave_no_file(
    options: list[str], status: int, said: str, campaign: Path, tmp_path: Path, cli: Cli
) -> None:
    out = tmp_path / "plan.csv"
    seen = cli("plan", campaign, "-o", out, *options, ends=status)
    assert said in seen.err
    assert seen.out == ""
    assert not out.exists()


def places(file: Path) -> np.ndarray:
    """Hinge centres that a plan commands, (K, n, 3)."""
    rows = table(file.read_text(encoding="utf-8"))
    names = [f"ncp{i}.{axis}" for i in (1, 2, 3) for axis in "xyz"]
    return np.array([[float(row[name]) for name in names] for row in rows]).reshape(-1, 3, 3)


@pytest.mark.parametrize("turned", [False, True])
def test_home_is_of_the_recording(turned: bool, campaign: Path, tmp_path: Path, cli: Cli) -> None:
    folder = shutil.copytree(campaign, tmp_path / "rig")
    document = yaml.safe_load((folder / "rig.yaml").read_text())
    if turned:  # a drawing's frame: its x lies along the BCS's y
        about = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
        for support in document["supports"]:
            support["hinge"] = (np.array(about) @ support["hinge"]).tolist()
        centre = document["terminal"]["barycenter"]
        centre["value"] = (np.array(about) @ centre["value"]).tolist()
        document["terminal"].pop("inertia", None)
        (folder / "rig.yaml").write_text(yaml.safe_dump(document))
    log = read_log([folder / "log.csv"], folder / "rig.yaml")
    recorded = np.array([series.value.mean(axis=0) for series in log.position])
    out = tmp_path / "plan.csv"
    for options in (["--postures", "4"], ["--motion"]):
        seen = cli("plan", folder, "-o", out, *options, ends=0)
        assert "mean of what was recorded" in out.read_text(encoding="utf-8")
        assert "is unknown" not in seen.err
        # A tilt of 5 degrees moves a hinge by less than a tenth of its distance from the middle.
        assert np.abs(places(out) - recorded).max() < 0.1
    cli("plan", folder, "-o", out, "--home", "1,2,3", "--postures", "8", ends=0)
    origin = np.mean([support["hinge"] for support in document["supports"]], axis=0)
    assert places(out).mean(axis=(0, 1)) == pytest.approx(np.array([1, 2, 3]) + origin, abs=1e-6)
