"""Campaigns that cannot be judged take no part, and nobody is told that all is well."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

import tdfscal
from tdfscal.files.writers.campaign import write_run
from tdfscal.records import CampaignInfo, Rig
from tdfscal.simulation import Faults, Options, Slip, reference_rig, scenarios
from tdfscal.simulation.options import MovingOptions, Touch
from tests.cli.running import Cli
from tests.cli.test_life import monitored, noisy

RPY = np.array([[0.01, -0.02, 0.03], [-0.015, 0.005, -0.04], [0.02, 0.012, 0.025]])
SLIPPED = Faults(slips=(Slip(1, 8, (0.0, 8e-3, 0.0)),))


def of(month: int) -> Rig:
    """One rig whose load and hinges are exact: every campaign is of the same machine."""
    rig = reference_rig()
    return replace(
        rig,
        declared=replace(rig.declared, hinge=0.0),
        mass=replace(rig.mass, std=np.array(0.0)),
        barycentre=replace(rig.barycentre, std=np.zeros(3)),
        campaign=CampaignInfo(date=f"2026-{month:02d}-01"),
    )


#: At rest, a row a posture; and what never stops.
REST = Options(postures=15, squeeze=200.0, rpy=RPY, rows="postures")
MOTION = MovingOptions(duration=30.0, rate=100.0, rpy=RPY)


def write(
    home: Path,
    name: str,
    month: int,
    *,
    scenario: str = "self",
    options: Options | MovingOptions = REST,
) -> Path:
    played = scenarios.run(of(month), scenario, options, np.random.default_rng(month), None)
    write_run(played, home / name, format="csv")
    return home / name


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sound months, one whose second sensor slipped, and one that was saturated."""
    home = tmp_path_factory.mktemp("rig")
    for month in (1, 2, 3, 6):
        write(home, f"sound{month}", month)
    write(home, "slipped", 4, options=replace(REST, faults=SLIPPED))
    write(home, "saturated", 5, scenario="saturation")
    return home


@pytest.fixture(scope="module")
def base(home: Path) -> Path:
    """The calibration of the first month."""
    tdfscal.calibrate(home / "sound1", trials=0, output=home / "base.yaml")
    return home / "base.yaml"


@pytest.fixture(scope="module")
def checks(home: Path) -> Any:
    """What a history of two sound months shows."""
    seen = tdfscal.monitor([home / "sound1", home / "sound2"])
    return json.loads(json.dumps(seen.to_dict()))["checks"]


@pytest.fixture(scope="module")
def pooled(home: Path) -> Any:
    """The calibration of two sound months."""
    seen = tdfscal.calibrate([home / "sound1", home / "sound2"], trials=0)
    return json.loads(json.dumps(seen.to_dict()))


def unjudged(result: Any) -> list[tuple[str, str]]:
    """Name and reason of campaigns for whose sake the result is not all well."""
    return [(f["subject"][0], f["text"]) for f in result["findings"] if f["severity"] == "rejects"]


@pytest.mark.parametrize(("name", "why"), [("slipped", "ncp2"), ("saturated", "capacity")])
def test_the_latest_is_not_unseen(home: Path, checks: Any, cli: Cli, name: str, why: str) -> None:
    """Beside two campaigns, whose numbers stay what they are."""
    result = monitored(cli, 1, home / "sound1", home / "sound2", home / name)
    ((subject, text),) = unjudged(result)
    assert subject == str(home / name)
    assert why in text
    assert result["alarms"] == []
    assert result["checks"] == checks


def test_a_month_that_is_cut_short(home: Path, base: Path, tmp_path: Path, cli: Cli) -> None:
    """In a history, a pool and an update, each once, with the second at which the log ends."""
    cut = write(tmp_path, "cut", 4, options=replace(REST, rows="timeseries"))
    log = cut / "log.csv"
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    *_, last, _ = log.read_text().splitlines()  # the last line is half of one
    sound = [home / "sound1", home / "sound6"]
    fit = ["--trials", 0, "-o", tmp_path / "c.yaml"]
    for command in (["monitor"], ["update", base, *fit]):
        months = [home / "sound2", cut] if base in command else [*sound, cut]
        found = cli.json(*command, *months, "-q", ends=0)["findings"]
        (said,) = (f["text"] for f in found if "log.csv" in f["text"])
        assert f"to {float(last.split(',')[0]):.4g} s" in said
    assert len(monitored(cli, 0, *sound, cut)["checks"]) == 3


def test_a_rejected_month_in_motion(home: Path, checks: Any, tmp_path: Path, cli: Cli) -> None:
    """Touched for a third of its time; the same month untouched is counted."""
    touched = replace(MOTION, touches=(Touch(8.0, 18.0, (20.0, -30.0, 40.0)),))
    free, held = (
        write(tmp_path, name, 5, scenario="motion", options=options)
        for name, options in (("free", MOTION), ("held", touched))
    )
    sound = [home / "sound1", home / "sound2"]
    assert len(monitored(cli, 0, *sound, free)["checks"]) == 3
    result = monitored(cli, 1, *sound, held)
    assert [name for name, _ in unjudged(result)] == [str(held)]
    assert result["checks"] == checks


def test_an_update_blames_the_month_at_fault(home: Path, base: Path, tmp_path: Path) -> None:
    """Not the last: one that slipped is left out, one that fits in itself alone ends it."""
    later = write(tmp_path, "later", 7)
    turned = replace(REST, rpy=RPY + np.outer([0, 1, 0], [0, 4e-3, 0]))
    moved = write(tmp_path, "moved", 5, options=turned)
    without = tdfscal.update(base, [home / "sound2", later], trials=0)
    beside = tdfscal.update(base, [home / "sound2", home / "slipped", later], trials=0)
    assert beside.accepted
    assert [one.rpy for one in beside.supports] == [one.rpy for one in without.supports]
    (named,) = (f for f in beside.findings if f.code == "campaign-left-out")
    assert named.subject == (str(home / "slipped"),)
    ended = tdfscal.update(base, [home / "sound2", moved, later], trials=0)
    there, back = (f for f in ended.reasons if f.code == "campaigns-changed")
    assert there.subject == back.subject == ("ncp2",)
    assert moved.name in there.text
    assert later.name in back.text


def at_capacity(folder: Path) -> int:
    """Postures, a row each, of which a reading stands at its capacity."""
    rig = yaml.safe_load((folder / "rig.yaml").read_text())
    log = pd.read_csv(folder / "log.csv")
    full = [
        (log[rig["log"]["supports"][support["name"]]["force"]].abs() >= support["capacity"])
        for support in rig["supports"]
    ]
    return int(np.any(np.concatenate(full, axis=1), axis=1).sum())


def test_a_validation_names_what_it_leaves_out(home: Path, base: Path, cli: Cli) -> None:
    result = cli.json("validate", base, home / "saturated", "-q")
    assert result["holds"]
    (found,) = (f for f in result["findings"] if f["code"] == "postures-left-out")
    assert found["size"] == len(result["left_out"]) == 15 - result["postures"]
    assert found["size"] == at_capacity(home / "saturated") > 0
    done = cli("validate", base, home / "sound2", "--json", "-q")
    assert "postures-left-out" not in done.out


def test_a_noisy_month_takes_no_part_in_a_pool(
    home: Path, pooled: Any, tmp_path: Path, cli: Cli
) -> None:
    loud = noisy(home / "sound3", tmp_path / "loud")
    words = ("calibrate", home / "sound1", home / "sound2", loud, "--trials", 0, "-q")
    beside = cli.json(*words, "-o", tmp_path / "c.yaml", ends=0)
    assert beside["supports"] == pooled["supports"]
    left = [f["subject"] for f in beside["findings"] if f["code"] == "campaign-left-out"]
    assert left == [[str(loud)]]


def spoilt(source: Path, target: Path, fault: str) -> Path:
    """A copy of a campaign that nobody can read as one."""
    shutil.copytree(source, target)
    log = target / "log.csv"
    if fault == "empty":
        log.write_bytes(b"")
    elif fault == "torn":
        log.write_bytes(log.read_bytes()[:40])
    else:
        (target / {"no log": "log.csv", "no rig": "rig.yaml"}[fault]).unlink()
        shutil.rmtree(target / "tracker")
    return target


def test_months_that_cannot_be_read_stop_neither_history_nor_pool_nor_update(
    home: Path, base: Path, checks: Any, pooled: Any, tmp_path: Path, cli: Cli
) -> None:
    """They are named, and the numbers are those of the others alone; by themselves: an error."""
    one, two = home / "sound1", home / "sound2"
    bad = [spoilt(home / "sound3", tmp_path / f, f) for f in ("empty", "no log", "no rig", "torn")]
    names = [*map(str, bad)]
    result = monitored(cli, 1, one, two, tmp_path)  # whose folders are meant
    assert sorted(name for name, _ in unjudged(result)) == names
    assert result["checks"] == checks
    assert len(monitored(cli, 1, base, bad[0])["checks"]) == 1
    assert cli("monitor", *bad, "-q").status in (2, 3)
    target = tmp_path / "none.yaml"
    alone = tdfscal.update(base, two, trials=0).to_dict()
    for command, expected in ((["calibrate", one], pooled), (["update", base], alone)):
        beside = cli.json(*command, two, *bad, "--trials", 0, "-q", "-o", target, ends=1)
        assert not target.exists()
        assert sorted(name for name, _ in unjudged(beside)) == names
        assert beside["supports"] == json.loads(json.dumps(expected["supports"]))


def test_a_survey_whose_log_is_missing_says_so(home: Path, tmp_path: Path, cli: Cli) -> None:
    """Unless the survey is asked for; both as a calibration and as a check of a history."""
    bare = Path(shutil.copytree(home / "sound3", tmp_path / "bare"))
    (bare / "log.csv").unlink()
    for more, said in (([], True), (["--method", "tracker"], False)):
        done = cli("calibrate", bare, "--trials", 0, "-q", "-o", tmp_path / "c.yaml", *more, ends=0)
        assert ("describes a log" in done.err) is said
        head = done.out.partition("Installation angles")[0]
        assert ("the tracker alone" in head) is said
    result = monitored(cli, 0, home / "sound1", bare)
    (found,) = result["findings"]
    assert found["subject"] == [str(bare)]
    assert "describes a log" in found["text"]


def test_where_none_can_be_judged_there_is_no_history(home: Path, cli: Cli) -> None:
    done = cli("monitor", home / "slipped", home / "saturated", "-q", ends=1)
    assert str(home / "slipped") in done.err
