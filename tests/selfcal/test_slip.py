"""A sensor that turns within a campaign is named; what is no turn is not called one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.api import calibrate, simulate
from tdfscal.findings import Finding
from tdfscal.records import Rig
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import Contact, Faults, Options, Recorder, Slip

from .campaigns import calibrated

RIG = simulation.reference_rig()
POSTURES = 24
SLIP = 2e-3  # rad


def runs(faults: Faults, seed: int, trials: int, rig: Rig = RIG) -> list[SelfCalibration]:
    options = Options(squeeze=100.0, postures=POSTURES, faults=faults)
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(seed), trials)
    return [calibrated(batch, rig, i) for i in range(trials)]


def turned(result: SelfCalibration) -> list[Finding]:
    causes = [cause for suspected in result.suspicions for cause in suspected.causes]
    return [cause for cause in causes if cause.code == "sensor-slipped"]


@dataclass(frozen=True)
class Verdicts:
    named: int
    accepted: int


def slipped(turn: tuple[float, float, float], seed: int, trials: int, posture: int) -> Verdicts:
    results = runs(Faults(slips=(Slip(1, posture, turn),)), seed, trials)
    named = sum(any(each.subject == ("ncp2",) for each in turned(r)) for r in results)
    return Verdicts(named, sum(not r.reasons for r in results))


@pytest.mark.parametrize(("axis", "posture"), [(2, 12), (1, 4), (0, 21)])
def test_a_sensor_that_slips_is_named_and_the_result_rejected(axis: int, posture: int) -> None:
    """Also where so few postures lie on one side that they would be left out as outliers."""
    turn = [0.0, 0.0, 0.0]
    turn[axis] = -SLIP if posture == 12 else 5 * SLIP  # three postures see a turn less well
    verdicts = slipped((turn[0], turn[1], turn[2]), seed=axis, trials=1, posture=posture)
    assert verdicts == Verdicts(named=1, accepted=0)


@pytest.mark.slow
@pytest.mark.parametrize("axis", range(3))
def test_nearly_every_slip_is_named(axis: int) -> None:
    turn = [0.0, 0.0, 0.0]
    turn[axis] = SLIP
    verdicts = slipped((turn[0], turn[1], turn[2]), seed=20 + axis, trials=100, posture=12)
    assert verdicts.named >= 95
    assert verdicts.accepted <= 100 - verdicts.named


def test_the_posture_and_the_turn_are_stated() -> None:
    (result,) = runs(Faults(slips=(Slip(0, 10, (0.0, 3e-3, 0.0)),)), seed=5, trials=1)
    (found,) = turned(result)
    stated, half = (np.array(found.values[key]) for key in ("change", "change_95"))
    assert (np.abs(stated - [0.0, 3e-3, 0.0]) < 2 * half).all()
    assert half.max() < 1e-3
    # Postures are counted from 1 in what users read, and from 0 in the simulator.
    assert found.values["posture"] == 11
    before, after = np.array(found.values["between"])
    assert before < after
    # A walk of the zeros takes up some of it, and is no cure.
    assert {finding.code for finding in result.findings} == {
        "sensor-slipped",
        "residuals-large",
    }


def in_last_postures(share: float, seed: int) -> SelfCalibration:
    """14 postures, touched at the last two alike, with a share of 14 N."""
    force, moment = share * np.array([[5.0, -8.0, 10.0], [2.0, 1.0, -1.0]])
    contacts = tuple(Contact(k, tuple(force), tuple(moment)) for k in (12, 13))
    recorder = Recorder(force_rate=40.0, position_rate=40.0)
    options = Options(
        squeeze=200.0, postures=14, faults=Faults(contacts=contacts), recorder=recorder
    )
    batch = simulation.simulate_dwells(RIG, options, np.random.default_rng(seed), 1)
    return calibrated(batch, RIG, 0)


def test_a_step_gives_way_to_contact_that_is_likelier() -> None:
    result = in_last_postures(1.0, 12)
    assert sorted(result.rejected) == [12, 13]
    assert not result.suspicions


def test_a_step_about_as_likely_as_contact_is_named_beside_it() -> None:
    result = in_last_postures(0.3, 1)
    assert sorted(result.rejected) == [12, 13]
    assert [(doubt.kind, doubt.tied) for doubt in result.suspicions] == [("jump", True)]


def test_contact_at_a_third_and_two_thirds_is_no_slip(tmp_path: Path) -> None:
    """By its own misfit, which it widened the limits by, a slip once explained both."""
    folder = tmp_path / "c"
    simulate(folder, scenario="contact", seed=11, postures=14, rate=40)
    result = calibrate(folder, trials=0, allow_rejected=True)
    assert {finding.code for finding in result.findings if finding.severity == "rejects"} == {
        "postures-rejected"
    }


def test_postures_without_a_stated_noise_show_a_slip_too() -> None:
    options = Options(
        squeeze=100.0, postures=POSTURES, faults=Faults(slips=(Slip(0, 12, (0.0, 0.0, 4e-3)),))
    )
    rig = replace(RIG, declared=replace(RIG.declared, force_noise=0.0))
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(2), 1)
    dwells = batch.dwells(0)
    bare = replace(dwells, force_cov=np.zeros_like(dwells.force_cov))
    result = self_calibrate(rig, bare, rng=np.random.default_rng(0), max_trials=0)
    assert any(each.subject == ("ncp1",) for each in turned(result))
    assert result.reasons


def test_a_noisy_channel_is_no_slip_and_a_slip_no_noise() -> None:
    """Either explains some of the other; the likelier is named."""
    options = Options(squeeze=100.0, postures=POSTURES)
    batch = simulation.simulate_dwells(RIG, options, np.random.default_rng(77), 40)
    for k in (7,):  # by themselves its residuals ask for a slip with χ² above 600
        dwells = batch.dwells(k)
        force = dwells.force.copy()
        force[:, 0, 1] += 2.0 * np.random.default_rng(k).standard_normal(POSTURES)
        noisy = self_calibrate(
            RIG, replace(dwells, force=force), rng=np.random.default_rng(0), max_trials=0
        )
        assert not noisy.suspicions
        assert noisy.channels is not None
        assert np.argmax(noisy.channels) == 1
    faults = Faults(slips=(Slip(1, 12, (0.0, 0.0, SLIP)),))
    batch = simulation.simulate_dwells(
        RIG, replace(options, faults=faults), np.random.default_rng(22), 100
    )
    slipping = calibrated(batch, RIG, 66)  # its channels ask for noise too
    assert slipping.channels is None
    assert turned(slipping)


def test_what_is_as_likely_as_another_is_named_beside_it() -> None:
    """1 mrad under 1000 N is 1 N: in ten postures of five sensors a zero that jumps does alike."""
    rig = simulation.make_rig(5)
    options = Options(
        squeeze=100.0,
        postures=10,
        recorder=Recorder(mean_sd=0.1),
        faults=Faults(slips=(Slip(3, 6, (0.0, 1e-3, 0.0)),)),
    )
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(21), 8)
    found = [calibrated(batch, rig, i).suspicions for i in range(4)]
    steps = [each[0].causes for each in found if each and each[0].kind in ("slip", "jump")]
    assert len(steps) >= 2
    for causes in steps:
        assert ("sensor-slipped", ("ncp4",)) in [(cause.code, cause.subject) for cause in causes]
