"""`init`, then `calibrate`: one campaign as three recorders write it."""

import csv
import re
from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

import tdfscal
from tdfscal.errors import DataError
from tdfscal.files.rig.recorders import LogBlock
from tests.cli.running import Cli
from tests.words import in_words

NCPS = (1, 2, 3)


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> tuple[pd.DataFrame, np.ndarray]:
    """One row per sample in mm and N, rounded as a recorder rounds; and the true angles, rad."""
    folder = tmp_path_factory.mktemp("simulated") / "c"
    tdfscal.simulate(folder, postures=14, squeeze=300.0, seed=3, rate=50.0)
    log = tdfscal.read_log(next(folder.glob("log.*")), tdfscal.load_rig(folder / "rig.yaml"))
    columns = {"time": log.force[0].time - log.force[0].time[0]}
    for i in range(3):
        for axis, letter in enumerate("XYZ"):
            value = np.interp(
                log.force[0].time, log.position[i].time, log.position[i].value[:, axis]
            )
            columns[f"NCP{i + 1}_Pos{letter}"] = np.round(value * 1e3, 6)
        for axis, letter in enumerate("xyz"):
            columns[f"TDFS{i + 1}_F{letter}"] = np.round(log.force[i].value[:, axis], 4)
    truth = yaml.safe_load((folder / "truth.yaml").read_text())
    return (
        pd.DataFrame(columns).assign(time=lambda f: np.round(f["time"], 6)),
        np.array([support["rpy"] for support in truth["supports"]]),
    )


def german_excel(frame: pd.DataFrame, folder: Path) -> Path:
    units = {"time": "time [s]"} | {
        name: f"{name.replace('TDFS', 'Prüf')} [{'mm' if 'Pos' in name else 'N'}]"
        for name in frame.columns[1:]
    }
    path = folder / "Messung.csv"
    frame.rename(columns=units).to_csv(
        path, sep=";", decimal=",", index=False, encoding="cp1252", lineterminator="\r\n"
    )
    return path


def rtde(frame: pd.DataFrame, folder: Path) -> Path:
    path = folder / "record.txt"
    with path.open("w", newline="") as file:
        writer = csv.writer(file, delimiter=" ", lineterminator="\n")
        writer.writerow(["timestamp", *frame.columns[1:]])
        writer.writerows(frame.to_numpy().tolist())
    return path


def commanded_too(frame: pd.DataFrame, folder: Path) -> Path:
    """A UR's names, positions in m; what was commanded stands before and behind the measured."""
    path = folder / "robots.csv"
    columns: dict[str, Any] = {"timestamp": frame["time"]}
    for k in NCPS:
        pose = [frame[f"NCP{k}_Pos{axis}"] * 1e-3 for axis in "XYZ"]
        force = [frame[f"TDFS{k}_F{axis}"] for axis in "xyz"]
        for name, three in (
            ("target_TCP_pose", [p + 0.05 for p in pose]),
            ("actual_current", [0.1 * f for f in force]),
            ("actual_TCP_pose", pose),
            ("actual_TCP_force", force),
            ("goal_pose", [p * 2 for p in pose]),
            ("desired_force", [f + 70.0 for f in force]),
        ):
            rest = [np.zeros(len(frame))] * 3
            columns |= {f"r{k}_{name}_{i}": value for i, value in enumerate([*three, *rest])}
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


RECORDERS: list[Callable[[pd.DataFrame, Path], Path]] = [
    german_excel, rtde, commanded_too,
]  # fmt: skip


def calibrated(log: Path, folder: Path) -> tdfscal.Calibration:
    draft = tdfscal.init(log, output=folder / "rig.yaml")
    assert draft.confirm
    return tdfscal.calibrate(log, rig=folder / "rig.yaml", trials=0)


@pytest.fixture(scope="module")
def reference(
    frame: tuple[pd.DataFrame, np.ndarray], tmp_path_factory: pytest.TempPathFactory
) -> tdfscal.Calibration:
    folder = tmp_path_factory.mktemp("reference")
    return calibrated(rtde(frame[0], folder), folder)


@pytest.mark.parametrize("record", RECORDERS, ids=lambda record: record.__name__)
def test_the_draft_of_every_recorder_reads_the_same_samples(
    frame: tuple[pd.DataFrame, np.ndarray],
    record: Callable[[pd.DataFrame, Path], Path],
    tmp_path: Path,
) -> None:
    part = frame[0].iloc[:800]
    path = record(part, tmp_path)
    tdfscal.init(path, output=tmp_path / "rig.yaml")
    log = tdfscal.read_log(path, tdfscal.load_rig(tmp_path / "rig.yaml"))
    for k in NCPS:
        moves = part[[f"NCP{k}_Pos{axis}" for axis in "XYZ"]].to_numpy() * 1e-3
        loads = part[[f"TDFS{k}_F{axis}" for axis in "xyz"]].to_numpy()
        np.testing.assert_allclose(log.position[k - 1].value, moves, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(log.force[k - 1].value, loads, rtol=1e-12)
    np.testing.assert_allclose(np.diff(log.force[0].time), np.diff(part["time"]), atol=1e-6)


def test_a_log_that_cannot_be_guessed_ends_with_what_to_write(
    frame: tuple[pd.DataFrame, np.ndarray], tmp_path: Path
) -> None:
    """Nameless columns: a log block that reads them; date and time apart: one column that does."""
    part, log = frame[0], tmp_path / "log.csv"
    names = ["Zeit", *(f"Kanal{k}" for k in range(1, 19))]
    part.set_axis(names, axis=1).to_csv(log, index=False)
    with pytest.raises(DataError) as refused:
        tdfscal.init(log)
    (block,) = re.findall(r"`log: (.*)`", refused.value.hint or "")
    fields = LogBlock(**yaml.safe_load(block)).fields
    assert [*chain(*fields.values())] == names[1:]
    when = pd.Timestamp("2026-11-03") + pd.to_timedelta(part["time"], unit="s")
    rest = part.drop(columns="time")
    apart = {"Datum": when.dt.strftime("%d.%m.%Y"), "Uhrzeit": when.dt.strftime("%H:%M:%S.%f")}
    rest.assign(**apart).to_csv(log, index=False)
    with pytest.raises(DataError, match=r"such as 2026-11-03 08:15:00\.5 of Datum and Uhrzeit"):
        tdfscal.init(log)
    rest.assign(Zeit=when.dt.strftime("%Y-%m-%d %H:%M:%S.%f")).to_csv(log, index=False)
    assert tdfscal.init(log).confirm


def test_what_is_to_be_confirmed_is_said(
    frame: tuple[pd.DataFrame, np.ndarray], reference: tdfscal.Calibration, tmp_path: Path
) -> None:
    log = rtde(frame[0], tmp_path)
    rig = tmp_path / "rig.yaml"
    draft = tdfscal.init(log, output=rig)
    text = rig.read_text()
    marked = [x for x in text.splitlines() if "# confirm" in x and not x.lstrip().startswith("#")]
    assert len(draft.confirm) == len(marked)
    assert any(key.startswith("supports.ncp2.hinge: [") for key in draft.confirm)
    said = f"{len(draft.confirm)} lines"
    assert any(said in warning for warning in in_words(reference.findings))
    rig.write_text(text.replace("# confirm", "# confirmed"))
    result = tdfscal.calibrate(log, rig=rig, trials=0)
    assert not any("to be confirmed" in warning for warning in in_words(result.findings))


def test_a_newcomer_needs_two_commands(
    frame: tuple[pd.DataFrame, np.ndarray],
    reference: tdfscal.Calibration,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    cli: Cli,
) -> None:
    """From a foreign table to accepted angles; a third, `info`, shows what the table holds."""
    monkeypatch.chdir(tmp_path)
    german_excel(frame[0], tmp_path)
    cli("init", "Messung.csv", "-o", "rig.yaml", "-q", ends=0)
    done = cli("calibrate", ".", "--trials", "0", "-q", ends=0)
    assert "PROVISIONAL" in done.out
    assert "force: [Prüf1_Fx, " in Path("rig.yaml").read_text("utf-8")
    angles = [s["rpy"] for s in yaml.safe_load(Path("calibration.yaml").read_text())["supports"]]
    np.testing.assert_allclose(angles, reference.rpy, rtol=0, atol=1e-9)
