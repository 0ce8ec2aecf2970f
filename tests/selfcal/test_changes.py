"""What changes within a campaign is named: a turned sensor, a contact that stays."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.estimation.uncertainty import estimate
from tdfscal.findings import Finding
from tdfscal.model.statics import postures
from tdfscal.records import Rig
from tdfscal.selfcal.changes import find_change
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.selfcal.pipeline import SelfCalibration
from tdfscal.simulation import Contact, Faults, Options, Recorder, Slip
from tdfscal.simulation.faults import Drift, Walk, ZeroShift
from tests.selfcal.campaigns import fitted

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
    assert {finding.code for finding in result.findings} == {"sensor-slipped", "residuals-large"}


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


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_a_jump_gives_way_to_contact_that_is_likelier(share: float) -> None:
    result = in_last_postures(share, 12)
    assert sorted(result.rejected) == [12, 13]
    assert [doubt.kind for doubt in result.suspicions] == ["contact"]


def test_postures_without_a_stated_noise_show_a_slip_too() -> None:
    options = Options(
        squeeze=100.0, postures=POSTURES, faults=Faults(slips=(Slip(0, 12, (0.0, 0.0, 4e-3)),))
    )
    rig = replace(RIG, declared=replace(RIG.declared, force_noise=0.0))
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(2), 1)
    dwells = batch.dwells(0)
    bare = replace(dwells, force_cov=np.zeros_like(dwells.force_cov))
    result = fitted(rig, bare)
    assert any(each.subject == ("ncp1",) for each in turned(result))
    assert result.reasons


FORCE = (25.0, -15.0, 40.0)


def _held(run: range) -> Faults:
    """50 N on the terminal at each posture of a run."""
    return Faults(contacts=tuple(Contact(k, FORCE, (4.0, -3.0, 2.0)) for k in run))


@pytest.mark.parametrize(
    ("sensors", "run", "seed"),
    [(3, range(12, 24), 1), (5, range(12, 24), 2), (3, range(6, 16), 1), (3, range(8), 2)],
)
def test_a_contact_that_stays_is_named_with_its_run(sensors: int, run: range, seed: int) -> None:
    rig = RIG if sensors == 3 else simulation.make_rig(sensors)
    (result,) = runs(_held(run), seed, 1, rig)
    (found,) = [each for each in result.findings if each.code == "contact-stays"]
    assert (found.values["posture"], found.values["last"]) == (run.start + 1, run.stop)
    assert sorted(result.rejected) == list(run)
    stated, half = (np.array(found.values[key]) for key in ("change", "change_95"))
    assert (np.abs(stated - FORCE) < 2 * half).all()
    assert half.max() < 2.0
    others = {each.code for each in result.findings} - {"contact-stays", "postures-rejected"}
    assert not [code for code in others if code.startswith(("zero", "channel", "sensor"))]
    assert result.reasons
    assert result.quality.birge < 1.5


def test_the_run_is_found_among_many_postures() -> None:
    options = Options(squeeze=100.0, postures=400, faults=_held(range(137, 303)))
    batch = simulation.simulate_dwells(RIG, options, np.random.default_rng(4), 1)
    fit = estimate(fit_robust(RIG, postures(RIG, batch.dwells(0))).fit)
    found = find_change(fit, batch.dwells(0).start, np.arange(1, 401))
    assert found is not None
    assert [found.causes[0].values[end] for end in ("posture", "last")] == [138, 303]


@pytest.mark.parametrize(
    "faults",
    [
        Faults(),
        Faults(zero_shifts=(ZeroShift(0, 12, (0.8, -0.5, 1.2)),)),
        Faults(slips=(Slip(1, 12, (2e-3, -1e-3, 3e-3)),)),
        Faults(drifts=(Drift(0, (10.0, -6.0, 15.0)),)),
        Faults(walks=tuple(Walk(k, 3.0) for k in range(3))),
    ],
)
def test_what_one_sensor_or_time_does_is_no_contact(faults: Faults) -> None:
    for result in runs(faults, seed=7, trials=4):
        assert "contact-stays" not in {each.code for each in result.findings}
