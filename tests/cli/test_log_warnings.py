"""What a log's warnings say reaches the user once; faults of its numbers are refused by name."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from pyarrow import csv

import tdfscal
from tests.cli.running import SAMPLES, Cli, recorded
from tests.words import refusal, texts

FORCES = [f"ncp{i}.f{axis}" for i in (1, 2, 3) for axis in "xyz"]
REPEATED = "1 repeat the time of the sample before"
Change = Callable[[pa.Table], pa.Table]


def edit(folder: Path, *changes: Change) -> None:
    table = pq.read_table(folder / "log.parquet")
    for change in changes:
        table = change(table)
    pq.write_table(table, folder / "log.parquet")


def repeated(table: pa.Table) -> pa.Table:
    return pa.concat_tables([table.slice(0, 101), table.slice(100)])


def set_to(name: str, function: Callable[[np.ndarray], np.ndarray]) -> Change:
    return lambda table: recorded(table, {name: function(table[name].to_numpy())})


def test_a_warning_is_stored_and_shown_once(campaign: Path, tmp_path: Path, cli: Cli) -> None:
    edit(campaign, repeated)
    target = tmp_path / "c.json"
    seen = cli("calibrate", campaign, "-o", target, "--trials", 0, "-qv", ends=0)
    assert (" ".join(seen.out.split()).count(REPEATED), seen.err.count(REPEATED)) == (1, 1)
    assert sum(REPEATED in w for w in texts(json.loads(target.read_text()))) == 1
    brief = cli("calibrate", campaign, "--trials", 0, "-q")
    assert (REPEATED in " ".join(brief.out.split()), brief.err.count(REPEATED)) == (False, 1)
    validated = cli.json("validate", target, campaign, "-q")
    assert sum(REPEATED in w for w in texts(validated)) == 1


@pytest.mark.parametrize(
    ("names", "change", "word"),
    [
        (
            ["ncp2.fx"],
            lambda value: np.where(np.arange(len(value)) == 1234, np.nan, value),
            "ncp2.fx",
        ),
        (FORCES, lambda value: 1e-3 * value, "force_unit"),  # kN read as N
    ],
    ids=["NaN", "kN"],
)
def test_a_fault_is_refused_without_a_file(
    names: list[str], change: Callable[[np.ndarray], np.ndarray], word: str,
    campaign: Path, tmp_path: Path, cli: Cli,
) -> None:  # fmt: skip
    edit(campaign, *(set_to(name, change) for name in names))
    target = tmp_path / "result.yaml"
    target.write_text("untouched")
    assert word in cli("calibrate", campaign, "-o", target, "--trials", 0, "-q", ends=3).err
    assert target.read_text() == "untouched"
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["result.yaml"]


def test_a_copy_in_another_format_is_refused(campaign: Path, tmp_path: Path, cli: Cli) -> None:
    table = pq.read_table(campaign / "log.parquet")
    later = set_to("time", lambda time: time + 12345.678)(table)
    csv.write_csv(later, campaign / "log2.csv")
    done = cli("calibrate", campaign, "-o", tmp_path / "b.json", "--trials", 0, "-q", ends=3)
    assert "holds the recording of" in done.err
    assert not (tmp_path / "b.json").exists()


def test_forces_far_behind(campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By every command that takes dwells or motion, and before anything is fitted."""
    seconds = -9.0
    sound = shutil.copytree(campaign, tmp_path / "sound")
    known = tdfscal.calibrate(sound, trials=0)
    period = np.diff(pq.read_table(campaign / "log.parquet")["time"].to_numpy()[:2])[0]
    edit(
        campaign,
        *(set_to(name, lambda force: np.roll(force, round(seconds / period))) for name in FORCES),
    )
    pooled = tdfscal.calibrate([sound, campaign], trials=0)
    assert "balance far better" in next(
        str(found.text) for found in pooled.findings if found.code == "campaign-unusable"
    )
    monkeypatch.delattr("tdfscal.commands.calibrate.self_calibrate")
    for asked in (
        lambda: tdfscal.calibrate(campaign, trials=0),
        lambda: tdfscal.calibrate(campaign, samples="moving", trials=0),
        lambda: tdfscal.update(known, campaign, trials=0),
        lambda: tdfscal.validate(known, campaign),
    ):
        found = refusal(asked)
        assert found.code == "forces-behind"
        assert found.size == pytest.approx(abs(seconds), abs=0.1)
        assert found.values["late"] == (seconds > 0)


@pytest.mark.parametrize(("date", "told"), [("2018-06-15", True), ("2025-06-15", False)])
def test_a_date_that_the_clock_contradicts(date: str, told: bool, tmp_path: Path) -> None:
    campaign = shutil.copytree(SAMPLES / "mcap", tmp_path / "campaign")
    rig = yaml.safe_load((campaign / "rig.yaml").read_text())
    (campaign / "rig.yaml").write_text(yaml.safe_dump(rig | {"campaign": {"date": date}}))
    made = tdfscal.calibrate(campaign, trials=0)
    assert made.measured is not None
    assert (made.measured.source, made.measured.begin[:10]) == ("log", "2025-06-15")
    assert ("campaign-misdated" in {finding.code for finding in made.findings}) == told


@pytest.mark.parametrize(
    ("name", "told"),
    [("r_2026-03-02.csv", True), ("r20260302.csv", True), ("r_1-2026-03.csv", False)],
)
def test_a_date_in_a_name_that_the_file_contradicts(name: str, told: bool, tmp_path: Path) -> None:
    """A file's date is that of its end; its name's is told, and counts once the rig file has it."""
    campaign = shutil.copytree(SAMPLES / "csv", tmp_path / "campaign")
    (log,) = campaign.glob("*.csv")
    os.utime(log.rename(campaign / name), (1.76e9, 1.76e9))
    made = tdfscal.calibrate(campaign, trials=0)
    assert made.measured is not None
    when = made.measured.record()
    assert (when.source, when.end) == ("file", 1.76e9)
    assert when.begin == pytest.approx(1.76e9 - 108.76, abs=1.0)
    assert ("file-misdated" in {finding.code for finding in made.findings}) == told
