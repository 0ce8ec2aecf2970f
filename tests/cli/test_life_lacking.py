"""A rig whose channels die: calibrated, updated and monitored as users run it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.records import Rig
from tdfscal.simulation import Recorder, reference_rig
from tests.cli.running import Cli
from tests.cli.test_life import monitored
from tests.words import texts


def lacking() -> Rig:
    """The reference rig whose third sensor measures only along its axis."""
    axes = np.ones((3, 3), dtype=np.bool_)
    axes[2, :2] = False
    return replace(reference_rig(), axes=axes)


@pytest.fixture(scope="module")
def months(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("rig") / "lacking"
    simulate_to_folder(
        folder, lacking(), "months", postures=8, months=8, seed=4, rows="postures",
        recorder=Recorder(mean_sd=0.0),
    )  # fmt: skip
    return sorted(p for p in folder.iterdir() if p.is_dir())[:2]  # later a sensor turns


def calibrated(cli: Cli, path: Path, *folders: Path) -> dict[str, Any]:
    cli("calibrate", *folders, "--trials", 0, "-o", path, "-q", ends=0)
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def truth(folder: Path) -> list[Any]:
    return [s["rpy"] for s in yaml.safe_load((folder / "truth.yaml").read_text())["supports"]]


def test_an_undetermined_sensor(months: list[Path], tmp_path: Path, cli: Cli) -> None:
    pooled = calibrated(cli, tmp_path / "pooled.json", *months)
    first, last = tmp_path / "0.json", tmp_path / "1.json"
    calibrated(cli, first, months[0])
    cli("update", first, months[1], "--trials", 0, "-o", last, "-q", ends=0)
    updated = json.loads(last.read_text())
    true = truth(months[-1])
    for ours, theirs, real in zip(updated["supports"], pooled["supports"], true, strict=True):
        if ours["name"] == "ncp3":
            assert ours["rotation"] is None is theirs["rotation"]
            continue
        assert np.abs(np.array(ours["rpy"]) - theirs["rpy"]).max() < 1e-6
        assert np.all(np.abs(np.array(ours["rpy"]) - real) < 4 * np.array(ours["rpy_std"]))
    for campaign in (*pooled["campaigns"], *updated["campaigns"]):
        for key in ("zero", "zero_std"):
            assert [value is None for value in campaign[key][2]] == [True, True, False]
    assert any("ncp3" in warning for warning in texts(updated))
    result = monitored(cli, 0, first, last)
    assert all(check["path_rpy"][2] is None for check in result["checks"])
    assert any(warning.startswith("ncp3: no check") for warning in texts(result))
