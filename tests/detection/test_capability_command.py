"""`tdfscal capability` on simulated campaigns, by the command line."""

import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from scipy.special import ndtri

import tdfscal
from tdfscal.acceptance import coverage_radius
from tdfscal.catalogue import told
from tdfscal.commands.capability import CapabilityResult
from tdfscal.files.calibration.document import save_calibration
from tdfscal.files.writers.campaign import write_campaign, write_run
from tdfscal.frozen import replace
from tdfscal.records import Rig, Series
from tdfscal.simulation import (
    Campaign,
    Contact,
    Faults,
    Options,
    Recorder,
    make_rig,
    simulate_campaign,
)
from tdfscal.simulation.moving_campaign import simulate_moving
from tdfscal.simulation.options import MovingOptions
from tdfscal.simulation.scenarios import Run
from tests.cli.running import Cli

POSTURES, OFF = 12, 5
FORCE = (60.0, -40.0, 80.0)


@dataclass(frozen=True)
class Places:
    """Folders, free and with a contact; the calibration's file; what is asked of the free one."""

    free: Path
    touched: Path
    calibration: Path
    plain: CapabilityResult


def campaign(rig: Rig, faults: Faults | None = None, vibration: float = 0.0) -> Campaign:
    # Moves so slow that what moving adds stays below the noise.
    recorder = Recorder(
        dwell=(2.5, 3.0), move=(9.0, 10.0), force_rate=200.0, position_rate=200.0,
        vibration=vibration, settling_force=0.0,
    )  # fmt: skip
    options = Options(
        postures=POSTURES, squeeze=300.0, recorder=recorder, faults=faults or Faults()
    )
    return simulate_campaign(rig, options, np.random.default_rng(8))


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Places:
    home = tmp_path_factory.mktemp("capability")
    write_campaign(campaign(make_rig()), home / "free", format="parquet")
    write_campaign(
        campaign(make_rig(), Faults(contacts=(Contact(OFF, FORCE),))), home / "touched",
        format="parquet",
    )  # fmt: skip
    outcome = tdfscal.calibrate([home / "free"], trials=0)
    assert outcome.status == "accepted"
    save_calibration(outcome, home / "calibration.yaml")
    plain = tdfscal.capability(home / "calibration.yaml", home / "free")
    return Places(home / "free", home / "touched", home / "calibration.yaml", plain)


def asked(cli: Cli, *line: object) -> tuple[int, dict[str, Any]]:
    seen = cli("capability", *line, "--json")
    assert seen.out, seen.err
    return seen.status, json.loads(seen.out)


def codes(document: dict[str, Any]) -> set[str]:
    return {finding["code"] for finding in document["findings"]}


def test_a_free_log_gives_thresholds(places: Places) -> None:
    found = places.plain.to_dict()
    assert places.plain.exit_status == 0
    assert [a["axis"] for a in found["axes"]] == ["fx", "fy", "fz", "mx", "my", "mz"]
    for axis in found["axes"]:
        assert 0.0 < axis["threshold"] < axis["smallest_contact"]
        assert sum(axis["shares"].values()) == pytest.approx(1.0, abs=1e-9)
        assert min(axis["shares"].values()) > -1e-9
    # White noise of the readings, √3 of it on the force of three sensors; 136 s of 200 Hz without a
    # stop but in 0.38 % stay within 5.27 standard deviations.
    log = tdfscal.read_log(places.free / "log.parquet", places.free / "rig.yaml")
    steps = np.concatenate([np.diff(series.value, axis=0).ravel() for series in log.force])
    noise = np.median(np.abs(steps)) / ndtri(0.75) / np.sqrt(2)
    for axis in found["axes"][:3]:
        assert axis["noise"] == pytest.approx(np.sqrt(3) * noise, rel=0.05)
        assert axis["threshold"] == pytest.approx(5.27 * np.sqrt(3) * noise, rel=0.05)
    assert not codes(found) & {"path-in-contact", "threshold-unbounded"}


def test_a_path_in_contact_is_said(places: Places, cli: Cli) -> None:
    status, found = asked(cli, places.calibration, places.touched, "--filter", "10")
    assert status == 1
    said = next(f for f in found["findings"] if f["code"] == "path-in-contact")
    assert {"fx", "fy", "fz"} <= set(said["subject"])
    axis = re.search(r"reaches \S+ (\S+) in ([fm])[xyz] at ", said["text"])
    assert axis is not None
    assert axis.groups() == (said["unit"], "f" if said["unit"] == "N" else "m")
    assert "tdfscal update" in said["cure"]  # where it is the zeros
    assert all(axis["threshold"] for axis in found["axes"])


def test_a_tare_is_told_from_a_touch(places: Places, cli: Cli, tmp_path: Path) -> None:
    """Zeros that have moved explain a tared path, at all places; they explain no passing touch."""
    log = shutil.copytree(places.free, tmp_path / "tared") / "log.parquet"
    table = pq.read_table(log)
    forces = [name for name in table.column_names if re.search(r"(?i)f_?[xyz]$", name)]
    assert len(forces) == 9
    for k, name in enumerate(forces):
        shifted = pc.add(table[name], 30.0 * (-1) ** k)
        table = table.set_column(table.column_names.index(name), name, shifted)
    pq.write_table(table, log)
    for folder, tared in ((log.parent, True), (places.touched, False)):
        _, found = asked(cli, places.calibration, folder, "--filter", "10")
        said = next(f for f in found["findings"] if f["code"] == "path-in-contact")
        assert ("tdfscal validate" not in said["cure"]) == tared


SLOW = MovingOptions(frequency=0.03, travel=0.005)


@pytest.mark.parametrize(
    ("drive", "cutoff"),
    [(SLOW, None), (MovingOptions.approach(), None), (MovingOptions.approach(), 5.0)],
)
def test_zeros_that_moved_show_in_motion(
    places: Places, tmp_path: Path, drive: MovingOptions, cutoff: float | None
) -> None:
    """3 N on one channel, below the thresholds: false stops grow, and `update` mends it.

    The one stop of an approach is too short for the noise behind a filter; the way shows it, and
    must not take 6 s of contact for noise.
    """
    truth = campaign(make_rig()).truth
    moving = simulate_moving(make_rig(), drive, np.random.default_rng(3), truth)
    time = moving.log.force[0].time
    during = (np.abs(time - 23.0) < 3.0)[:, None]
    for size in (0.0, 3.0, *([] if drive == SLOW else [40.0])):
        push = [[size, 0.0, 0.0], [0.0] * 3, [0.0] * 3] if size < 40.0 else [[0, 0, size / 3]] * 3
        shifted = tuple(
            Series(s.time, s.value + (during if size == 40.0 else 1.0) * np.array(by))
            for s, by in zip(moving.log.force, push, strict=True)
        )
        folder = tmp_path / f"{size}"
        shifted_log = replace(moving.log, force=shifted)
        played = Run("motion", moving.rig, truth, None, None, replace(moving, log=shifted_log))
        write_run(played, folder, format="parquet")
        found = tdfscal.capability(places.calibration, folder, filter=cutoff)
        if size == 40.0:
            (touched,) = (told(f) for f in found.findings if f.code == "path-touched")
            assert "from 20.00 to 26.00 s" in touched
            assert found.exit_status == 1
            assert "moves-beyond" not in {f.code for f in found.findings}
            wrench = tdfscal.apply(places.calibration, folder)
            assert [f.code for f in wrench.findings] == ["path-touched"]
            continue
        said = [told(f) for f in found.findings if f.code == "path-zeros-moved"]
        assert found.exit_status == len(said) == bool(size)
        assert all("tdfscal update" in each for each in said)
        assert found.to_dict()["for_machine"] != bool(size)
        assert ("--filter" in found.text) != bool(size)  # it moves no zero


def test_zeros_that_moved_are_named_beside_moves_without_inertia(tmp_path: Path) -> None:
    tdfscal.simulate(tmp_path / "c", postures=16)
    tdfscal.calibrate(tmp_path / "c", trials=0, output=tmp_path / "c.yaml")
    log = pd.read_csv(tmp_path / "c" / "log.csv")
    for size in (0.0, 3.0):
        log["TDFS2_Fx"] += size
        log.to_csv(tmp_path / "c" / "log.csv", index=False)
        found = tdfscal.capability(tmp_path / "c.yaml", tmp_path / "c")
        said = {f.code for f in found.findings if f.rejects}
        assert said == {"moves-beyond"} | ({"path-zeros-moved"} if size else set())


def test_a_stated_contact_must_be_seen(places: Places, cli: Cli, tmp_path: Path) -> None:
    size = places.plain.capability.smallest_contact[:3].max()
    text = (places.free / "rig.yaml").read_text()
    text = text.replace("acceptance:", "acceptance:\n  contact: {force: SIZE}")
    for share, status in ((1.02, 0), (0.98, 1)):
        rig = tmp_path / "rig.yaml"
        rig.write_text(text.replace("SIZE", str(share * size)))
        seen, document = asked(cli, places.calibration, places.free, "--rig", rig)
        assert (seen, "contact-unseen" in codes(document)) == (status, bool(status))


def test_unbounded_zeros_have_no_threshold(places: Places, cli: Cli, tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text((places.free / "rig.yaml").read_text() + "drift: {time: .inf}\n")
    status, found = asked(cli, places.calibration, places.free, "--rig", rig)
    assert status == 1
    assert "threshold-unbounded" in codes(found)
    assert [axis["threshold"] for axis in found["axes"]] == [None] * 6


def test_a_plan_is_a_path(places: Places, tmp_path: Path) -> None:
    tdfscal.plan(places.free, output=tmp_path / "plan.csv", postures=10)
    found = tdfscal.capability(places.calibration, tmp_path / "plan.csv", false_stops=0.1)
    assert found.exit_status == 0
    # One posture's worth: not less than the calibration alone at any of them, k = 1.645 and 1.645.
    assert found.capability.duration == 3600.0
    least = np.sqrt(np.mean(found.capability.calibration_std**2, axis=0))
    assert np.all(found.capability.threshold > 1.6 * least)
    # It has no samples, and without their noise nothing is a threshold of a machine.
    assert "NO THRESHOLDS FOR A MACHINE" in found.text
    assert found.to_dict()["for_machine"] is False


def test_moves_that_shake_reject_the_path(places: Places, cli: Cli, tmp_path: Path) -> None:
    write_campaign(campaign(make_rig(), vibration=40.0), tmp_path / "shaken", format="parquet")
    status, document = asked(cli, places.calibration, tmp_path / "shaken")
    said = next(f for f in document["findings"] if f["code"] == "moves-beyond")
    assert (status, said["severity"]) == (1, "rejects")
    threshold = {axis["axis"]: axis["threshold"] for axis in document["axes"]}
    assert said["size"] > min(threshold[axis] for axis in said["subject"])


def test_a_plan_drives_for_the_contact_that_is_stated(places: Places, tmp_path: Path) -> None:
    text = (places.free / "rig.yaml").read_text()
    counts = []
    for force in (2.0, 0.9):
        folder = tmp_path / f"{force}"
        folder.mkdir()
        stated = text.replace("acceptance:", f"acceptance:\n  contact: {{force: {force}}}")
        (folder / "rig.yaml").write_text(stated)
        found = tdfscal.plan(folder, noise=1.0)
        counts.append(len(found.to_frame()))
        expected = found.plan.expected.contact_force
        assert expected is not None
        assert coverage_radius(np.diag(expected**2)) <= force
        assert "enough" in found.text
    assert counts[0] == 24 < counts[1]
