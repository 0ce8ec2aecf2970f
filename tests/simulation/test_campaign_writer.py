"""Folders written, and read back."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from tdfscal import read_log
from tdfscal.errors import UsageError
from tdfscal.files.rig.reading import load_rig
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.files.writers.logs import LogFormat
from tdfscal.records import Acceptance, CampaignInfo, Drift, SensorInfo, UncertainValue
from tdfscal.simulation import MOVING, Recorder, Truth
from tests.cli.running import contents

from .rigs import loose_rig

FORMATS: tuple[LogFormat, ...] = ("csv", "parquet", "mcap")


@pytest.mark.parametrize("format", FORMATS)
def test_a_folder_holds_what_was_simulated_and_the_same_again(
    format: LogFormat, tmp_path: Path
) -> None:
    """To the bit; streams of rates of their own where the format has room for them."""
    apart = Recorder(force_rate=200.0, position_rate=50.0)
    recorder = apart if format == "mcap" else Recorder()
    made = [
        simulate_to_folder(tmp_path / name, format=format, postures=2, seed=seed, recorder=recorder)
        for name, seed in (("a", 5), ("b", 5), ("c", 6))
    ]
    a, b, c = (contents(tmp_path / name) for name in "abc")
    assert a == b
    tracker = [f"tracker/{name}.csv" for name in ("nominal", "targets", "servo", "moves")]
    assert sorted(a) == sorted(["rig.yaml", "truth.yaml", f"log.{format}", *tracker])
    assert a[f"log.{format}"] != c[f"log.{format}"]
    rig = load_rig(tmp_path / "a" / "rig.yaml")
    log, campaign = read_log([tmp_path / "a" / f"log.{format}"], rig), made[0].campaign
    assert campaign is not None
    true = (*campaign.log.position, *campaign.log.force)
    for one, series in zip((*log.position, *log.force), true, strict=True):
        np.testing.assert_allclose(one.value, series.value, rtol=4e-16, atol=0)
        np.testing.assert_allclose(one.time - one.time[0], series.time, rtol=0, atol=2.4e-7)
    truth = yaml.safe_load(a["truth.yaml"])
    stated = [support["sensitivity"] for support in truth["supports"]]
    np.testing.assert_array_equal(stated, np.eye(3) + made[0].truth.sensitivity)
    if format != "mcap":
        with pytest.raises(UsageError, match="MCAP"):
            simulate_to_folder(tmp_path / "d", format=format, postures=2, recorder=apart)
        assert not (tmp_path / "d").exists()


def test_one_seed_is_one_rig_whatever_is_driven(tmp_path: Path) -> None:
    """Also in the first of its months."""
    still = simulate_to_folder(tmp_path / "still", postures=2, seed=3, format="mcap").truth
    for scenario in ("months", "tracker", "walk", *MOVING):
        folder = tmp_path / scenario
        truth = simulate_to_folder(folder, None, scenario, postures=2, months=1, seed=3).truth
        for part in fields(Truth):
            if part.name != "stiffness":
                np.testing.assert_array_equal(getattr(truth, part.name), getattr(still, part.name))


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
    assert loaded.surveys[3] == tmp_path / "c/tracker/moves.csv"
