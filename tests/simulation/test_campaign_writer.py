"""Folders written, read back by libraries that share no code with the writers."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from tdfscal.errors import UsageError
from tdfscal.files.rig.reading import load_rig
from tdfscal.files.writers.campaign import LogFormat, simulate_to_folder, write_campaign
from tdfscal.records import Acceptance, CampaignInfo, Drift, FloatArray, SensorInfo, UncertainValue
from tdfscal.simulation import Campaign, Options, Recorder, reference_rig, simulate_campaign

from .rigs import loose_rig

FORMATS: tuple[LogFormat, ...] = ("csv", "parquet", "mcap")


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return simulate_campaign(reference_rig(), Options(postures=3), np.random.default_rng(0))


def table(campaign: Campaign) -> FloatArray:
    """time, then per support position (m) and force (N)."""
    log = campaign.log
    columns = [log.force[0].time[:, None]]
    for position, force in zip(log.position, log.force, strict=True):
        columns += [position.value, force.value]
    return np.hstack(columns)


def digests(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


def read_mcap(path: Path) -> dict[str, list[tuple[int, int, int, tuple[float, float, float]]]]:
    """Per topic: log time, publish time, header stamp (ns) and vector of every message."""
    out: dict[str, list[tuple[int, int, int, tuple[float, float, float]]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, ros in reader.iter_decoded_messages():
            assert channel.message_encoding == "cdr"
            assert schema is not None
            assert schema.encoding == "ros2msg"
            stamp = ros.header.stamp.sec * 1_000_000_000 + ros.header.stamp.nanosec
            v = ros.wrench.force if channel.topic.endswith("wrench") else ros.point
            if channel.topic.endswith("wrench"):
                assert (ros.wrench.torque.x, ros.wrench.torque.y, ros.wrench.torque.z) == (0, 0, 0)
            out.setdefault(channel.topic, []).append(
                (message.log_time, message.publish_time, stamp, (v.x, v.y, v.z))
            )
    return out


def test_csv_read_by_pandas(campaign: Campaign, tmp_path: Path) -> None:
    write_campaign(campaign, tmp_path / "c", format="csv")
    block = yaml.safe_load((tmp_path / "c/rig.yaml").read_text())["log"]
    frame = pd.read_csv(tmp_path / "c/log.csv", dtype=str).map(float)
    columns = [block["time"]["field"]]
    for fields in block["supports"].values():
        columns += [*fields["position"], *fields["force"]]
    assert list(frame.columns) == columns
    scale = np.array([1.0, *([1000.0] * 3 + [1.0] * 3) * 3])
    np.testing.assert_allclose(frame.to_numpy() / scale, table(campaign), rtol=4e-16, atol=0.0)


def test_mcap_read_by_ros(campaign: Campaign, tmp_path: Path) -> None:
    write_campaign(campaign, tmp_path / "c", format="mcap")
    topics = read_mcap(tmp_path / "c/log.mcap")
    expected = [f"/ncp{i}/position" for i in (1, 2, 3)] + [f"/tdfs{i}/wrench" for i in (1, 2, 3)]
    assert sorted(topics) == expected
    for i in range(3):
        for topic, series in (
            (f"/tdfs{i + 1}/wrench", campaign.log.force[i]),
            (f"/ncp{i + 1}/position", campaign.log.position[i]),
        ):
            received, published, stamps, vectors = zip(*topics[topic], strict=True)
            np.testing.assert_array_equal(np.array(vectors), series.value)
            since = np.array(stamps) - stamps[0]
            np.testing.assert_array_equal(since, np.rint(series.time * 1e9).astype(int))
            assert published == stamps
            assert all(r > s for r, s in zip(received, stamps, strict=True))
    block = yaml.safe_load((tmp_path / "c/rig.yaml").read_text())["log"]
    assert block["supports"]["ncp2"]["force"] == "/tdfs2/wrench.wrench.force"
    with (tmp_path / "c/log.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 6 * len(campaign.log.force[0].time)
    assert {c.compression for c in summary.chunk_indexes} == {"zstd"}


@pytest.mark.parametrize("format", FORMATS)
def test_same_seed_same_bytes(format: LogFormat, tmp_path: Path) -> None:
    made = [
        simulate_to_folder(tmp_path / name, format=format, postures=2, seed=seed)
        for name, seed in (("a", 5), ("b", 5), ("c", 6))
    ]
    assert made[0].campaign is not None
    a, b, c = (digests(tmp_path / name) for name in "abc")
    assert a == b
    assert sorted(a) == sorted(
        ["rig.yaml", "truth.yaml", f"log.{format}"]
        + [f"tracker/{name}.csv" for name in ("nominal", "targets", "servo", "moves")]
    )
    assert a[f"log.{format}"] != c[f"log.{format}"]
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


@pytest.mark.parametrize("format", FORMATS[:2])
def test_rig_file_says_what_the_rig_is(format: LogFormat, tmp_path: Path) -> None:
    rig = loose_rig()
    rig = replace(
        rig,
        capacity=np.array([[3e3, 3e3, 5e3]] * 3),
        rpy_std=np.array([[np.inf] * 3, [0.01, 0.02, np.inf], [0.05] * 3]),
        inertia=UncertainValue(np.diag([50.0, 60.0, 80.0]), np.full((3, 3), 6.0)),
        axes=np.array([[True] * 3, [True, False, True], [False, False, True]]),
        drift=Drift(time=0.5 / 3600, temperature=0.0, walk=0.25 / 60, angle=1e-4),
        serial="RH-02",
        campaign=CampaignInfo(date="2026-11-21", operator="A. Smith"),
        sensors=(SensorInfo(serial="17"), SensorInfo(), SensorInfo(due="2027-03-01")),
        zero=replace(rig.zero, std=np.full((3, 3), np.inf)),
        mass=replace(rig.mass, std=np.array(np.inf)),
        acceptance=Acceptance(angle_std=1e-3, contact_force=5.0, contact_rpy=(0.1, 0.0, 0.0)),
    )
    simulate_to_folder(tmp_path / "c", rig, format=format, postures=2)
    loaded = load_rig(tmp_path / "c/rig.yaml")
    read = loaded.rig
    for name in ("name", "supports", "gravity", "gravity_tilt_std", "declared", "acceptance"):
        assert getattr(read, name) == getattr(rig, name), name
    for name in ("serial", "campaign", "sensors", "drift"):
        assert getattr(read, name) == getattr(rig, name), name
    for name in ("hinge", "nominal_rpy", "rpy_std", "capacity", "axes"):
        np.testing.assert_array_equal(getattr(read, name), getattr(rig, name), name)
    for name in ("mass", "barycentre", "zero", "inertia"):
        np.testing.assert_array_equal(getattr(read, name).value, getattr(rig, name).value)
        np.testing.assert_array_equal(getattr(read, name).std, getattr(rig, name).std)
    assert (not loaded.log) == (format == "parquet")
    assert loaded.tracker is not None
    assert loaded.tracker.paths[3] == tmp_path / "c/tracker/moves.csv"


def test_tracker_files(tmp_path: Path) -> None:
    played = simulate_to_folder(tmp_path / "c", scenario="tracker")
    assert sorted(digests(tmp_path / "c")) == [
        "rig.yaml",
        "tracker/moves.csv",
        "tracker/nominal.csv",
        "tracker/servo.csv",
        "tracker/targets.csv",
        "truth.yaml",
    ]
    assert played.survey is not None
    session = played.survey.session
    for name, points, atol in (
        ("nominal", session.nominal, 1e-16),
        ("servo", session.servo, 1e-15),
        ("targets", session.targets, 0.5e-9),
        ("moves", session.moves, 0.5e-9),
    ):
        lines = (tmp_path / f"c/tracker/{name}.csv").read_text().splitlines()
        rows = [line.split(",") for line in lines if line and not line.startswith(("//", "group"))]
        assert tuple(row[0].strip() for row in rows) == points.group
        assert tuple(row[1].strip() for row in rows) == points.point
        xyz = np.array([[float(v) for v in row[2:]] for row in rows]) / 1000.0
        np.testing.assert_allclose(xyz, points.xyz, rtol=0.0, atol=atol * 1.001)
    measured = (tmp_path / "c/tracker/moves.csv").read_text()
    assert "AXES = CARTESIAN" in measured
    assert "(mm)" in measured


def test_streams_of_their_own_rates_fit_mcap_only(tmp_path: Path) -> None:
    recorder = Recorder(force_rate=200.0, position_rate=50.0)
    simulate_to_folder(tmp_path / "m", format="mcap", postures=2, recorder=recorder)
    counts = {topic: len(m) for topic, m in read_mcap(tmp_path / "m/log.mcap").items()}
    assert 3.9 < counts["/tdfs1/wrench"] / counts["/ncp1/position"] < 4.1
    with pytest.raises(UsageError, match="MCAP"):
        simulate_to_folder(tmp_path / "c", format="csv", postures=2, recorder=recorder)
    assert not (tmp_path / "c").exists()
