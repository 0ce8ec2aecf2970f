"""A moving log beside a still one, and recordings that are there twice."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

import tdfscal
from tdfscal.files.writers.campaign import simulate_to_folder, write_run
from tdfscal.simulation import MOVING, reference_rig, scenarios
from tests.cli.running import Cli
from tests.cli.test_life import angles


def test_a_moving_log_updates_and_is_pooled(tmp_path: Path, cli: Cli) -> None:
    """The same numbers from an update with 20 s of motion as from both together; they hold."""
    rig = reference_rig()
    rig = replace(
        rig,
        declared=replace(rig.declared, hinge=0.0),
        mass=replace(rig.mass, std=np.array(0.0)),  # one load in both
        barycentre=replace(rig.barycentre, std=np.zeros(3)),
    )
    still, moving = tmp_path / "still", tmp_path / "moving"
    first = simulate_to_folder(still, rig, postures=8, seed=7, rows="postures")
    assert first.truth is not None
    rpy = first.truth.rpy
    options = replace(MOVING["motion"], rpy=rpy, duration=20.0)
    write_run(
        scenarios.run(rig, "motion", options, np.random.default_rng(8), None),
        moving,
        format="parquet",
    )
    base, new, pooled = (tmp_path / f"{name}.yaml" for name in ("base", "new", "pooled"))
    plain = ("--trials", 0, "-q", "-o")
    cli("calibrate", still, *plain, base, ends=0)
    for words in (
        ["update", base, moving, *plain, new],
        ["calibrate", still, moving, *plain, pooled],
    ):
        cli(*words, ends=0)
    assert np.abs(angles(new) - angles(pooled)).max() < 1e-6
    content, before = (yaml.safe_load(path.read_text()) for path in (new, base))
    assert content["motion"]["seconds"] > 10.0
    assert len(content["campaigns"]) == 2
    for ours, alone, theirs in zip(content["supports"], before["supports"], rpy, strict=True):
        std = np.array(ours["rpy_std"])
        assert np.all(std < alone["rpy_std"])
        assert np.all(np.abs(np.array(ours["rpy"]) - theirs) < 4 * std)
    own = yaml.safe_load((moving / "truth.yaml").read_text())["supports"]
    for ours, theirs in zip(content["supports"], own, strict=True):
        assert np.all(
            np.abs(np.array(ours["zero"]) - theirs["zero"]) < 4 * np.array(ours["zero_std"])
        )


def test_surveys_by_one_drawing_are_two(tmp_path: Path) -> None:
    """They share nominal points, and are checks by themselves: each with its own angles."""
    folders = [tmp_path / name for name in ("a", "b")]
    for seed, folder in enumerate(folders):
        tdfscal.simulate(folder, scenario="tracker", seed=seed)
    life = tdfscal.monitor(*folders).life
    assert {alarm.kind for alarm in life.alarms} == {"step"}  # seeds mount the sensors anew
    for name, rpy in zip(life.names, life.rpy, strict=True):
        alone = tdfscal.calibrate(name, trials=0)
        assert np.abs(rpy - [support.rpy for support in alone.supports]).max() < 1e-6
