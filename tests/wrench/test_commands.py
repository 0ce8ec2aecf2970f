"""`tdfscal apply` and `tdfscal validate` on folders, by the command line."""

import shutil
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import tdfscal
from tdfscal.commands.calibrate import calibrate
from tdfscal.errors import DataError
from tdfscal.files.calibration.document import save_calibration
from tdfscal.files.writers.campaign import write_campaign
from tdfscal.files.writers.logs import write_wrenches
from tdfscal.records import Log, Series
from tdfscal.simulation import (
    Campaign,
    Contact,
    Faults,
    Options,
    Recorder,
    make_rig,
    simulate_campaign,
)
from tdfscal.validation.residual_wrench import Validation
from tdfscal.wrench.contact_wrench import Wrenches
from tests.cli.running import SAMPLES, Cli
from tests.words import found

USED, HELD = 16, 4
FORCE = (60.0, -40.0, 80.0)
OFF = USED + 1


@dataclass(frozen=True)
class Places:
    """Folders: held out, and with a contact; the calibration file; what is in the latter."""

    held: Path
    touched: Path
    calibration: Path
    campaign: Campaign


def between(log: Log, start: float, end: float) -> Log:
    def cut(s: Series) -> Series:
        keep = (s.time >= start) & (s.time < end)
        return Series(s.time[keep], s.value[keep])

    return replace(log, position=tuple(map(cut, log.position)), force=tuple(map(cut, log.force)))


def campaign(faults: Faults | None = None) -> Campaign:
    recorder = Recorder(dwell=(2.5, 3.0), move=(1.5, 2.0), force_rate=200.0, position_rate=50.0)
    options = Options(
        postures=USED + HELD, squeeze=300.0, recorder=recorder, faults=faults or Faults()
    )
    return simulate_campaign(make_rig(), options, np.random.default_rng(8))


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Places:
    home = tmp_path_factory.mktemp("apply")
    plain, touched = campaign(), campaign(Faults(contacts=(Contact(OFF, FORCE),)))
    middle = 0.5 * (plain.end[USED - 1] + plain.start[USED])
    parts = {
        "used": replace(plain, log=between(plain.log, 0.0, middle)),
        "held": replace(plain, log=between(plain.log, middle, np.inf)),
        "touched": replace(touched, log=between(touched.log, middle, np.inf)),
    }
    for name, content in parts.items():
        write_campaign(content, home / name, format="mcap")
    found = home / "calibration.yaml"
    outcome = calibrate([home / "used"], trials=0)
    assert outcome.status == "accepted"
    save_calibration(outcome, found)
    return Places(home / "held", home / "touched", found, parts["touched"])


def test_contact_force_appears_where_it_acts(places: Places, cli: Cli, tmp_path: Path) -> None:
    target = tmp_path / "wrench.parquet"
    seen = cli.json("apply", places.calibration, places.touched, "-o", target, ends=0)
    table = pq.read_table(target)
    assert table.num_rows == seen["rows"]
    assert table.schema.metadata[b"frame"] == b"LCS"
    column = {name: table[name].to_numpy() for name in table.column_names}
    c, settled = places.campaign, 0.6
    # The MCAP writer counts from a date of its own.
    time = column["time"] - column["time"][0] + c.log.force[0].time[0]
    for k in range(USED, USED + HELD):
        dwell = (time > c.start[k] + settled) & (time < c.end[k] - 0.1)
        found = np.array([column[f"f{a}"][dwell].mean() for a in "xyz"])
        std = np.array([column[f"u_f{a}"][dwell].mean() for a in "xyz"])
        raw = np.array([column[f"raw_f{a}"][dwell].mean() for a in "xyz"])
        truth = np.array(FORCE) if k == OFF else np.zeros(3)
        # 2 N per sample on three sensors over 360 samples, and 0.1 N per posture on each.
        noise = np.sqrt(3 * (2.0**2 / dwell.sum() + 0.1**2))
        assert np.all(np.abs(found - truth) < 4 * np.hypot(std, noise))
        assert np.linalg.norm(raw - truth) > 20.0


def test_few_samples_show_no_noise(places: Places) -> None:
    """The uncertainty of a sample is unknown then, not that of the calibration alone."""
    found = tdfscal.apply(places.calibration, places.held, to="+0.03")
    frame = found.to_frame()
    assert 0 < len(frame) < 10
    assert frame.filter(regex="^u_[fm]").isna().all(axis=None)
    assert frame.filter(regex="^u_cal_").notna().all(axis=None)
    assert set(found.to_dict()["noise"]["std"].values()) == {None}


def test_what_the_calibration_stands_on_is_left_out(places: Places, tmp_path: Path) -> None:
    """Cut out of its own log by hand it proves nothing, and beside another log it is named."""
    used = campaign()
    cut = replace(used, log=between(used.log, used.start[3] + 1.0, used.end[9] - 0.5))
    write_campaign(cut, tmp_path / "cut", format="mcap")
    part = tdfscal.validate(places.calibration, tmp_path / "cut")
    assert part.validation.outcome == "unproven"
    assert part.to_dict()["verdict"] == "not contradicted"
    write_campaign(used, tmp_path / "all", format="mcap")
    both = tdfscal.validate(places.calibration, tmp_path / "all").validation
    assert isinstance(both, Validation)
    assert (both.outcome, list(both.used)) == ("holds", list(range(USED, USED + HELD)))
    log = (str(tmp_path / "all" / "log.mcap"),)
    assert {why.subject for why in both.left_out.values()} == {log}


def edited(path: Path, change: Any) -> Path:
    document = yaml.safe_load(path.read_text())
    change(document)
    path.write_text(yaml.safe_dump(document))
    return path


def test_no_common_instant_is_refused(places: Places, cli: Cli, tmp_path: Path) -> None:
    log = places.campaign.log
    middle = (log.force[0].time[0] + log.force[0].time[-1]) / 2
    apart = replace(between(log, -np.inf, middle), force=between(log, middle, np.inf).force)
    write_campaign(replace(places.campaign, log=apart), tmp_path / "apart", format="mcap")
    target = tmp_path / "w.mcap"
    seen = cli("apply", places.calibration, tmp_path / "apart", "-o", target, "-q", ends=3)
    assert "no instant" in seen.err
    assert [path.name for path in tmp_path.iterdir()] == ["apart"]


def test_a_rejected_calibration_passes_no_check(places: Places, cli: Cli, tmp_path: Path) -> None:
    """That its residuals are explained makes it no calibration to keep in use."""
    target = tmp_path / "rejected.yaml"
    shutil.copy(places.calibration, target)
    rejected = {"status": "rejected", "findings": [found("a test", "rejects")]}
    edited(target, lambda d: d.update(rejected, content_sha256=None))
    assert "STILL VALID" in cli("validate", places.calibration, places.held, ends=0).out
    said = cli("validate", target, places.held, "-q", ends=1).out.splitlines()
    assert said[0].endswith("NOT FIT FOR USE")
    assert "IS A REJECTED CALIBRATION" in " ".join(said[1:6])
    assert cli.json("validate", target, places.held, ends=1)["holds"]
    used = cli("apply", target, places.held, "-o", tmp_path / "w.csv", ends=0)
    assert "IS A REJECTED CALIBRATION, not fit for use: a test" in used.err
    assert set(pd.read_csv(tmp_path / "w.csv")["calibration_status"]) == {"rejected"}
    doubts = cli.json("apply", target, places.held, "-o", tmp_path / "w.parquet")["findings"]
    assert {each["code"] for each in doubts} >= {"rejected-in-use", "calibration-unsealed"}
    about = pq.read_schema(tmp_path / "w.parquet").metadata
    assert about[b"calibration_status"] == b"rejected"


def test_a_drift_that_few_postures_tell_in_part(tmp_path: Path) -> None:
    """The same seed repeats most postures, which are left out; five see less than each zero's."""
    tdfscal.simulate(tmp_path / "sound")
    tdfscal.simulate(tmp_path / "drift", scenario="drift")
    found = tdfscal.calibrate(tmp_path / "sound", trials=0, output=tmp_path / "c.yaml")
    seen = tdfscal.validate(found, tmp_path / "drift")
    assert not seen.holds
    assert "change-zeros-drift" in [finding.code for finding in seen.findings]


def test_a_log_that_contradicts_its_rig_is_refused(
    sample: tdfscal.Calibration, tmp_path: Path
) -> None:
    """Lengths in mm that are declared to be in m."""
    folder = Path(shutil.copytree(SAMPLES / "csv", tmp_path / "campaign"))
    document = yaml.safe_load((folder / "rig.yaml").read_text())
    document["log"]["length_unit"] = "m"
    (folder / "rig.yaml").write_text(yaml.safe_dump(document))
    older = tmp_path / "older.csv"
    older.write_text("older")
    with pytest.raises(DataError, match="in mm where m is declared"):
        tdfscal.apply(sample, folder, output=older)
    assert older.read_text() == "older"


def test_a_wrench_that_is_no_number_is_refused(tmp_path: Path) -> None:
    value = np.zeros((3, 6))
    time, unknown = np.array([0.5, 0.75, 1.0]), np.full((3, 6), np.inf)
    good = Wrenches(time=time, value=value, std=unknown, calibration_std=unknown, raw=value)
    bad = replace(good, value=np.where(np.arange(3)[:, None] == 1, np.nan, value))
    target = tmp_path / "w.csv"
    with pytest.raises(DataError, match=r"at 0\.75 s is no number"):
        write_wrenches(target, [good, bad], {})
    assert not list(tmp_path.iterdir())
    assert write_wrenches(target, [good], {}) == 3


@pytest.fixture(scope="module")
def applied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the same wrenches as table and as recording, of 10 s of a log."""
    home = tmp_path_factory.mktemp("applied")
    shutil.copytree(SAMPLES / "parquet", home / "campaign")
    tdfscal.calibrate(home / "campaign", trials=0, output=home / "c.yaml")
    for name in ("w.parquet", "w.mcap"):
        tdfscal.apply(home / "c.yaml", home / "campaign", output=home / name, to="+10")
    return home


def frames(path: Path) -> set[str]:
    """Names in the headers of a recording."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return {decoded.header.frame_id for *_, decoded in reader.iter_decoded_messages()}


def test_wrenches_are_in_the_frames_of_the_exports(applied: Path, tmp_path: Path) -> None:
    tdfscal.simulate(tmp_path / "campaign", format="mcap", postures=3, rate=20.0)
    text = tdfscal.export(applied / "c.yaml", to="ros").text
    nodes = (node["ros__parameters"] for node in yaml.safe_load(text).values())
    sensors = {node["frame_id"] for node in nodes if "frame_id" in node}
    assert len(sensors) == 3
    assert frames(tmp_path / "campaign" / "log.mcap") == {"bcs", *sensors}
    urdf = ET.fromstring(tdfscal.export(applied / "c.yaml", to="urdf").text)
    assert {link.get("name") for link in urdf.iter("link")} == {"bcs", *sensors}
    (terminal,) = frames(applied / "w.mcap")
    assert f"# Frame {terminal}," in text
