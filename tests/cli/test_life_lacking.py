"""Rigs whose channels are dead or die: calibrated, updated and monitored as users run it."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
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


def near_truth(content: dict[str, Any], campaign: Path) -> None:
    """Every angle that there is lies within four standard uncertainties of the simulated one."""
    truth = yaml.safe_load((campaign / "truth.yaml").read_text())
    for ours, theirs in zip(content["supports"], truth["supports"], strict=True):
        rpy, std = (np.array(ours[name], dtype=np.float64) for name in ("rpy", "rpy_std"))
        assert not np.any(np.abs(rpy - theirs["rpy"]) > 4 * std), ours["name"]


@pytest.mark.parametrize("moving", [False, True])
def test_the_parts_before_and_behind_a_jump_are_joined(
    moving: bool, tmp_path: Path, cli: Cli
) -> None:
    campaign, before, found = (tmp_path / name for name in ("campaign", "before.yaml", "f.json"))
    cli("simulate", campaign, "--scenario", "motion" if moving else "zero-shift", "--seed", 5, "-q")
    if moving:
        log = pd.read_csv(campaign / "log.csv")
        log.loc[log["t_s"] > 20, "TDFS3_Fy"] -= 8
        log.to_csv(campaign / "log.csv", index=False)
    calibrate = ("calibrate", campaign, "--trials", 0, "-q")
    seen = cli(*calibrate, "-o", found, ends=1 if moving else 3)
    said = " ".join((seen.err + seen.out).split())
    cure = re.search(
        r"unknown` for (\w+) in .*? --to (\S+) -o .*? with --from (\S+) -o after", said
    )
    assert cure is not None, said
    rig = yaml.safe_load((campaign / "rig.yaml").read_text())
    (support,) = [s for s in rig["supports"] if s["name"] == cure[1]]
    support["zero"]["std"] = "unknown"
    (campaign / "rig.yaml").write_text(yaml.safe_dump(rig, sort_keys=False))
    cli(*calibrate, "--to", cure[2], "-o", before, ends=0)
    near_truth(yaml.safe_load(before.read_text()), campaign)
    update = ("update", before, campaign, "--trials", 0, "-o", found, "-q")
    middle = float(cure[3]) + 20
    cli(*update, "--from", cure[3], *(["--to", middle] if moving else []), ends=0)
    both = json.loads(found.read_text())
    near_truth(both, campaign)
    assert both["fit"]["p_value"] > 1e-3  # what neither part tells is held against neither
    # What went in already is not taken twice; what did not is.
    assert "holds the same recording" in cli(*update, "--from", float(cure[3]) / 2, ends=2).err
    if moving:
        last = ("update", found, campaign, "--trials", 0, "-o", tmp_path / "last.json", "-q")
        assert "holds the same recording" in cli(*last, "--from", cure[3], ends=2).err
        cli(*last, "--from", middle, ends=0)
        near_truth(json.loads((tmp_path / "last.json").read_text()), campaign)
