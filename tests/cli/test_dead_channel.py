"""A channel that is dead on the day of the campaign, from the recording to the controller."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from tests.cli.running import Cli


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
