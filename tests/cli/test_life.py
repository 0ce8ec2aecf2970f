"""Several campaigns, `update` and `monitor` as users run them, on simulated months."""

import hashlib
import json
import re
import shutil
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

import tdfscal
from tdfscal.files.writers.campaign import simulate_to_folder, write_run
from tdfscal.numerics import so3
from tdfscal.simulation import MOVING, Recorder, reference_rig, scenarios
from tests.cli.running import Cli
from tests.reporting.samples import sketch
from tests.words import texts


@pytest.fixture(scope="module")
def months(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight months of the reference rig; its second sensor turns in the sixth."""
    folder = tmp_path_factory.mktemp("rig")
    simulate_to_folder(
        folder / "months",
        scenario="months",
        postures=6,
        months=8,
        seed=4,
        rows="postures",
        # The rows carry the noise that the rig file states, and no more.
        recorder=Recorder(mean_sd=0.0),
    )
    return folder / "months"


@pytest.fixture(scope="module")
def files(months: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The calibration of each month."""
    home = tmp_path_factory.mktemp("calibrated")
    made = [home / f"{folder.name}.yaml" for folder in folders(months, 0, 8)]
    for folder, path in zip(folders(months, 0, 8), made, strict=True):
        tdfscal.calibrate(folder, trials=0, output=path)
    return made


def angles(path: Path) -> np.ndarray:
    content = yaml.safe_load(path.read_text())
    return np.array([support["rpy"] for support in content["supports"]])


def folders(months: Path, first: int, last: int) -> list[Path]:
    return sorted(p for p in months.iterdir() if p.is_dir())[first:last]


def test_a_draft_s_lines_are_named_by_all_that_stands_on_them(months: Path, tmp_path: Path) -> None:
    """By a pool, and by an earlier calibration brought up to date."""
    first, last = folders(months, 0, 2)
    marked = Path(shutil.copytree(last, tmp_path / last.name))
    text = (marked / "rig.yaml").read_text()
    (marked / "rig.yaml").write_text(re.sub(r"(hinge: .*)", r"\1  # confirm", text, count=1))
    earlier = tdfscal.calibrate(first, trials=0)
    assert earlier.status == "accepted"
    for found in (tdfscal.calibrate([first, marked], trials=0), tdfscal.update(earlier, marked)):
        assert found.status == "provisional"
        own = [one.rig_sha256 for one in found.campaigns]
        assert own[-1] == hashlib.sha256((marked / "rig.yaml").read_bytes()).hexdigest()
        assert len(set(own)) == len(own)
        (draft,) = found.found("draft-unconfirmed")
        assert [line.split(":")[0] for line in draft.subject] == ["supports.ncp1.hinge"]


def test_a_pattern_names_what_is_no_check_too(
    months: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """FOLDER/* holds the truth of all months, and what was written beside them."""
    sketch(monkeypatch)
    known = folders(months, 0, 2)
    checks = [tmp_path / folder.name for folder in known]
    for folder, check in zip(known, checks, strict=True):
        shutil.copytree(folder, check)
    shutil.copy(months / "truth.yaml", tmp_path)
    page = tmp_path / "history.html"
    alone = cli("monitor", *checks, "--html", page, "--json", "-q", ends=0)
    said = page.read_text()
    for check in checks:
        for name in ("rig.yaml", "log.csv"):
            assert sha256((check / name).read_bytes()).hexdigest() in said
    others = {p.name for p in tmp_path.iterdir()} - {p.name for p in checks}
    assert others == {"truth.yaml", "history.html"}
    whole = cli("monitor", *sorted(tmp_path.iterdir()), "--json", "-q")
    first, again = (json.loads(done.out) for done in (alone, whole))
    assert first.pop("command") != again.pop("command")
    assert first.pop("created") <= again.pop("created")
    assert first == again


def test_pools_are_as_updates(months: Path, files: list[Path], tmp_path: Path, cli: Cli) -> None:
    """The truth lies within the stated uncertainty."""
    known = folders(months, 0, 3)
    pooled = tmp_path / "pooled.yaml"
    cli("calibrate", *known, "--trials", 0, "-o", pooled, "-q", ends=0)
    content = yaml.safe_load(pooled.read_text())
    assert [c["name"] for c in content["campaigns"]] == [str(p) for p in known]
    assert content["measured"]["source"] == "rig"
    zeros = [np.array(c["zero"]) for c in content["campaigns"]]
    assert np.abs(zeros[0] - zeros[1]).max() > 0.1
    truth = yaml.safe_load((known[-1] / "truth.yaml").read_text())
    for ours, theirs in zip(content["supports"], truth["supports"], strict=True):
        away = np.array(ours["rpy"]) - theirs["rpy"]
        assert np.all(np.abs(away) < 4 * np.array(ours["rpy_std"]))
    last = files[0]
    for k, folder in enumerate(known[1:], 1):
        new = tmp_path / f"{k}.yaml"
        cli("update", last, folder, "--trials", 0, "-o", new, "-q", ends=0)
        last = new
    assert np.abs(angles(last) - angles(pooled)).max() < 1e-6
    updated = yaml.safe_load(last.read_text())
    assert len(updated["campaigns"]) == 3
    assert len(updated["history"]) == 2
    assert updated["fit"]["chi2"] == pytest.approx(content["fit"]["chi2"], rel=1e-4)


def monitored(cli: Cli, status: int, *arguments: object) -> Any:
    return cli.json("monitor", *arguments, "-q", ends=status)


def test_a_turned_sensor_alarms_in_its_month(months: Path, files: list[Path], cli: Cli) -> None:
    result = monitored(cli, 1, *files)
    (alarm,) = result["alarms"]
    assert (alarm["kind"], alarm["support"]) == ("step", "ncp2")
    assert alarm["onset_check"] == str(files[5])
    truth = yaml.safe_load((months / "truth.yaml").read_text())["steps"][0]["turn"]
    assert np.abs(np.array(alarm["turn"]) - truth).max() < 4 * max(alarm["turn_std"])
    assert monitored(cli, 0, *files[:5])["alarms"] == []
    # Of when it turned the checks around it tell; of the next calibration, that it is due.
    dates = [check["date"] for check in result["checks"]]
    assert f"between {dates[4]} and {dates[5]}" in alarm["text"]
    assert result["next_calibration"]["date"] == dates[-1]
    size, half = map(float, re.findall(r"by ([0-9.]+) mrad ± ([0-9.]+) mrad", alarm["text"])[0])
    assert abs(size - 1e3 * np.linalg.norm(truth)) < 2 * half
    said = cli("monitor", *files, "-q").out
    assert re.search(r"next calibration +now", said)
    assert monitored(cli, 0, *files[5:])["alarms"] == []  # from then on


@pytest.mark.slow
def test_chains_of_updates_are_taken_apart(
    months: Path, files: list[Path], tmp_path: Path, cli: Cli
) -> None:
    """Campaigns, their calibrations one by one, and a chain of updates tell one story.

    Of months that scatter as stated: by how much more is counted of campaigns without what the rig
    file alone knows, which a calibration does not tell.
    """
    known, chain = folders(months, 0, 3), files[:1]
    for k, folder in enumerate(known[1:], 1):
        chain.append(tmp_path / f"u{k}.yaml")
        cli("update", chain[-2], folder, "--trials", 0, "-o", chain[-1], "-q")
    paths = [
        np.array(monitored(cli, 0, *what)["checks"][-1]["path_rpy"])
        for what in (known, files[:3], chain)
    ]
    assert np.abs(paths[1] - paths[0]).max() < 2e-6
    assert np.abs(paths[2] - paths[0]).max() < 2e-6
    lost = cli("monitor", chain[0], chain[2], ends=2)
    assert "not named" in lost.err


def test_a_noisy_month_is_named(months: Path, files: list[Path], tmp_path: Path, cli: Cli) -> None:
    base, *known = files[:4]
    (last,) = folders(months, 4, 5)
    sound = monitored(cli, 0, base, *known)
    loud = noisy(last, tmp_path / "loud")
    result = monitored(cli, 1, base, *known, loud)
    assert result["alarms"] == []
    assert [text for text in texts(result) if str(loud) in text]
    now, before = (np.array(r["checks"][-1]["path_rpy_std"]) for r in (result, sound))
    assert np.all(now < 1.05 * before)
    done = cli("update", base, loud, "--trials", 0, "-o", tmp_path / "no.yaml", "-q", ends=1)
    assert "turned" not in done.out.split("Installation")[0]


def noisy(folder: Path, target: Path) -> Path:
    """Copy a campaign, each of its readings off by 3 N at random."""
    shutil.copytree(folder, target)
    log = pd.read_csv(target / "log.csv")
    forces = log.columns[log.columns.str.startswith("TDFS")]
    log[forces] += 3.0 * np.random.default_rng(2).standard_normal(log[forces].shape)
    log.to_csv(target / "log.csv", index=False)
    return target


def edited(folder: Path, target: Path, **changes: Any) -> Path:
    """Copy a campaign with changes of its rig file's first level."""
    shutil.copytree(folder, target)
    rig = yaml.safe_load((target / "rig.yaml").read_text())
    rig.update(changes)
    (target / "rig.yaml").write_text(yaml.safe_dump(rig, sort_keys=False))
    return target


def test_campaigns_that_are_apart(
    months: Path, files: list[Path], tmp_path: Path, cli: Cli
) -> None:
    (first, second, *_), base = folders(months, 0, 3), files[0]
    rig = yaml.safe_load((second / "rig.yaml").read_text())
    moved = [dict(s) for s in rig["supports"]]
    moved[1]["hinge"] = [c + 0.01 for c in moved[1]["hinge"]]
    other = edited(second, tmp_path / "other", supports=moved)
    future = edited(second, tmp_path / "future", campaign={"date": "2999-01-01"})
    undated = edited(second, tmp_path / "undated", drift={"angle": 1e-4}, campaign={})
    older = edited(first, tmp_path / "older", campaign={"date": "2001-01-01"})
    shutil.copy(second / "log.csv", older)
    target = tmp_path / "none.yaml"
    for status, arguments, names in (
        (2, ["calibrate", first, other], "hinge of ncp2"),
        (2, ["update", base, other], "hinge of ncp2"),
        (1, ["calibrate", first, future], "future"),
        (2, ["calibrate", future], "future"),
        (3, ["calibrate", first, undated], "campaign.date"),
        (2, ["calibrate", first, first], "is named twice"),
        (2, ["update", base, first], "same recording"),
        (2, ["update", base, older], "before the calibration"),
        (2, ["calibrate", ""], "empty"),
        (1, ["calibrate", *folders(months, 0, 6)], "itself: 2024-05 to 2024-09, 2024-10."),
    ):
        done = cli(*arguments, "--trials", 0, "-o", target, "-q", ends=status)
        said = done.err + done.out
        assert names in " ".join(said.split())
        assert "Traceback" not in said
        assert not target.exists()
    cli("monitor", base, ends=2)


def test_a_pool_of_two_states_is_told_by_the_chart_s_alarm(months: Path) -> None:
    """And not by a slip in the course of one log."""
    known = folders(months, 0, 7)
    pooled = tdfscal.calibrate(known, trials=0, allow_rejected=True)
    told = tdfscal.monitor(known).to_dict()
    (alarm,) = told["alarms"]
    assert alarm["code"] in {found["code"] for found in told["findings"]}
    assert [reason.text for reason in pooled.reasons] == [alarm["text"]]


def test_a_slip_in_the_last_month_of_a_pool_names_that_month(tmp_path: Path) -> None:
    simulate_to_folder(tmp_path, scenario="months", postures=12, months=2, seed=4, rows="postures")
    whole, last = folders(tmp_path, 0, 2)
    log = pd.read_csv(last / "log.csv")
    forces = [f"TDFS2_F{axis}" for axis in "xyz"]
    turn = so3.exp(np.array([6e-3, 0.0, 0.0]))
    log.loc[6:, forces] = log.loc[6:, forces].to_numpy() @ turn
    log.to_csv(last / "log.csv", index=False)
    pooled = tdfscal.calibrate([whole, last], trials=0)
    told = [reason for reason in pooled.reasons if "turned by" in reason.text]
    assert [(reason.code, reason.subject) for reason in told] == [("sensor-slipped", ("ncp2",))]
    assert f"of {last} say" in " ".join(told[0].text.split())
    assert f"record {last} again" in str(told[0].cure)


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
