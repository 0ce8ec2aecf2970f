"""A channel that is dead on the day of the campaign, from the recording to the controller."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.cli.running import Cli


def near_truth(content: dict[str, Any], campaign: Path) -> None:
    """Every angle that there is lies within four standard uncertainties of the simulated one."""
    truth = yaml.safe_load((campaign / "truth.yaml").read_text())
    for ours, theirs in zip(content["supports"], truth["supports"], strict=True):
        rpy, std = (np.array(ours[name], dtype=np.float64) for name in ("rpy", "rpy_std"))
        assert not np.any(np.abs(rpy - theirs["rpy"]) > 4 * std), ours["name"]


def test_a_dead_channel_is_named_declared_and_used(tmp_path: Path, cli: Cli) -> None:
    campaign, found = tmp_path / "campaign", tmp_path / "found.json"
    done = cli("simulate", campaign, "--scenario", "dead-channel", "--postures", 16,
        "--rate", 20, "-q",
    )  # fmt: skip
    assert done.status == 0, done.err
    # Nobody declared it: refused by name, with the line to write.
    done = cli("calibrate", campaign, "--trials", 0, "-o", found, "-q", ends=3)
    assert not found.exists()
    said = " ".join(done.err.split())
    line = re.search(r"write `axes: (\[[xyz, ]*\])` for (\w+) in rig.yaml", said)
    assert line is not None, said
    assert "the y axis of the sensor of ncp3" in said
    rig = yaml.safe_load((campaign / "rig.yaml").read_text())
    (support,) = [s for s in rig["supports"] if s["name"] == line[2]]
    support["axes"] = yaml.safe_load(line[1])
    assert (support["name"], support["axes"]) == ("ncp3", ["x", "z"])
    (campaign / "rig.yaml").write_text(yaml.safe_dump(rig, sort_keys=False))
    # Declared: the others and this one calibrate.
    done = cli("calibrate", campaign, "--trials", 0, "-o", found, "-q", ends=0)
    content = json.loads(found.read_text())
    near_truth(content, campaign)
    assert content["supports"][2]["zero"][1] is None
    # Held out, applied, reported and exported.
    held_out = tmp_path / "held-out"
    cli("simulate", held_out, "--scenario", "dead-channel", "--postures", 16,
        "--rate", 20, "-q",
    )  # fmt: skip
    (held_out / "rig.yaml").write_text((campaign / "rig.yaml").read_text())
    done = cli("validate", found, held_out, "--json", "-q", ends=0)
    wrench, page = tmp_path / "wrench.csv", tmp_path / "page.html"
    cli("apply", found, held_out, "-o", wrench, "-q", ends=0)
    assert wrench.stat().st_size > 1000
    cli("report", found, "--html", page, "-q", ends=0)
    assert "ncp3" in page.read_text()
    done = cli("export", found, "--to", "urdf", ends=0)
    assert "ncp3" in done.out


def test_the_parts_before_and_behind_a_jump_are_joined(tmp_path: Path, cli: Cli) -> None:
    campaign, before, found = (tmp_path / name for name in ("campaign", "before.yaml", "f.json"))
    cli("simulate", campaign, "--scenario", "zero-shift", "--seed", 5, "-q")
    calibrate = ("calibrate", campaign, "--trials", 0, "-q")
    said = " ".join(cli(*calibrate, "-o", found, ends=3).err.split())
    cure = re.search(r"unknown` for (\w+) in .* --to ([\d.]+) -o .* with --from ([\d.]+)\.", said)
    assert cure is not None, said
    rig = yaml.safe_load((campaign / "rig.yaml").read_text())
    (support,) = [s for s in rig["supports"] if s["name"] == cure[1]]
    support["zero"]["std"] = "unknown"
    (campaign / "rig.yaml").write_text(yaml.safe_dump(rig, sort_keys=False))
    cli(*calibrate, "--to", cure[2], "-o", before, ends=0)
    near_truth(yaml.safe_load(before.read_text()), campaign)
    update = ("update", before, campaign, "--trials", 0, "-o", found, "-q")
    cli(*update, "--from", cure[3], ends=0)
    near_truth(json.loads(found.read_text()), campaign)
    # What went in already is not taken twice.
    assert "holds the same recording" in cli(*update, "--from", float(cure[3]) / 2, ends=2).err
