"""Self-calibration from dwells to a judged result: the steps in their order."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import Literal

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.checks.faulty_sensors import exceeded_ranges
from tdfscal.errors import NotConvergedError, NotIdentifiableError, RigError
from tdfscal.estimation.exact_quantities import exact_caveats
from tdfscal.estimation.judged import HeldOut, Judged, Undetermined, holding
from tdfscal.estimation.observability import ENOUGH, require_angles, verdict
from tdfscal.estimation.score_tests import PARABOLAS, Suspicion, likeliest
from tdfscal.estimation.uncertainty import Estimate, estimate
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import loosened
from tdfscal.model.postures import Rests
from tdfscal.model.statics import Postures
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import Dwells, FloatArray, Rig
from tdfscal.selfcal.changes import find_change
from tdfscal.selfcal.estimator import Fit, at_state, fit
from tdfscal.selfcal.linear_method import evaluate_linear, fit_linear
from tdfscal.selfcal.monte_carlo import simulate
from tdfscal.selfcal.mounting_search import Rival, describe
from tdfscal.selfcal.outliers import (
    RobustFit,
    contact_worth,
    cross_validate,
    fit_robust,
    hidden_contact,
    settled,
)
from tdfscal.selfcal.preparation import Usable, check_readings, misplaced_hinges, usable_postures
from tdfscal.selfcal.score_tests import suspicions, wandering
from tdfscal.significance import (
    AMBIGUOUS_MOUNTING,
    CAUSE_EXPLAINS,
    CAUSES_APART,
    INTERVAL_COVERAGE,
    MISFIT,
    MOST_REJECTED,
    OVERSTATED_NOISE,
)

Estimator = Literal["ml", "linear"]

#: Trials after which a Monte Carlo stops although its averages still move: the ends of an interval
#: are then known to 0.013 σ, a quarter of the finest tolerance that clause 8 can ask for.
MAX_TRIALS = 20_000
#: Sensors up to which trials are made unasked: their work grows with the cube of that number.
MOST_SIMULATED = 12
#: Trials for the covariance of the linear method.
LINEAR_TRIALS = 1_000


@record(kw_only=True)
class SelfCalibration(Judged[Fit]):
    """The judged result of a self-calibration.

    dwells : all that were found; the fit's postures are those not screened out. rejected : dwell
    index → reason. with_moves : (n, 3), rad, standard uncertainties of roll, pitch, yaw to expect
    from dwells and moves together, where the log holds moves.
    """

    estimator: Estimator
    dwells: Dwells
    validation: HeldOut
    rejected: dict[int, Finding]
    with_moves: FloatArray | None = None


def self_calibrate(
    rig: Rig,
    dwells: Dwells,
    *,
    rng: np.random.Generator,
    estimator: Estimator = "ml",
    max_trials: int | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> SelfCalibration:
    """Calibrate from static dwells by maximum likelihood, or by the paper's linear method.

    What is wrong with log or rig file is asked of the likeliest angles in either case.

    max_trials : of the Monte Carlo, 0 for none, which the linear method cannot do without; None
    for `MAX_TRIALS` with up to `MOST_SIMULATED` sensors, none with more.
    progress : told the name of each long stage.

    Raises
    ------
    DataError
        The log contradicts the rig file, or a sensor is dead or saturated.
    NotIdentifiableError
        The data do not determine an angle.
    NotConvergedError
        The iteration does not settle.
    """
    if estimator == "linear":
        likeliest = partial(self_calibrate, rig, dwells, rng=rng, max_trials=0, progress=progress)
        return _linear(rig, likeliest, rng, max_trials or LINEAR_TRIALS)
    usable = usable_postures(rig, dwells)
    robust, told = _likeliest_rotations(rig, usable)
    known = told.known
    result, stats = known.fit, known.quality
    seen = verdict(rig, result.state, result.postures, known.uncertainty.covariance)
    rejected = dict(usable.reasons) | {
        int(usable.index[k]): reason for k, reason in robust.rejected.items()
    }
    _check(result, Undetermined(rig, stats, seen, dwells, rejected), usable, robust.rivals)
    doubts = misplaced_hinges(known)
    # With hinges elsewhere than stated, whatever else the residuals ask for is an echo.
    if not any(doubt.harmful for doubt in doubts):
        placed, known = doubts, holding(known, doubts)  # till it is mended
        many = len(robust.rejected) > MOST_REJECTED * len(usable.index)
        doubts = _doubts(told, many_rejected=many)
        if any(doubt.kind in PARABOLAS for doubt in doubts):
            bent = replace(rig, drift=replace(rig.drift, parabola=np.inf))
            again = self_calibrate(bent, dwells, rng=rng, max_trials=max_trials, progress=progress)
            return replace(again, findings=(*again.findings, Finding("parabola-estimated")))
        doubts = _with_change(doubts, told)
        scaled = {doubt.support for doubt in doubts if doubt.kind == "vertical scale"}
        echoes = (doubt.kind.startswith("scaled") and doubt.support in scaled for doubt in placed)
        placed = tuple(doubt for doubt, echo in zip(placed, echoes, strict=True) if not echo)
        doubts = (*placed, *doubts)
    trials = None
    unasked = max_trials is None and rig.n > MOST_SIMULATED
    if max_trials != 0 and not unasked:
        progress("confirming the uncertainties by Monte Carlo")
        trials = simulate(known, rng, max_trials or MAX_TRIALS, seen.determined)
    calibration = SelfCalibration(
        rig=rig,
        estimator=estimator,
        dwells=dwells,
        estimate=known,
        observability=seen,
        suspicions=doubts,
        validation=cross_validate(result, known.parts),
        monte_carlo=trials,
        rejected=rejected,
    )
    return _judged(calibration, *caveats(calibration, unasked=unasked))


def _judged(of: SelfCalibration, *notes: Finding) -> SelfCalibration:
    """The same with what the gate says, notes beside that, and ranges that were exceeded."""
    gate = of.gate(used=len(of.dwells) - len(of.rejected), rejected=len(of.rejected))
    ranges = exceeded_ranges(of.rig, of.dwells, of.fit.state)
    return replace(of, findings=(*gate, *notes, *ranges))


def caveats(of: SelfCalibration, *, unasked: bool) -> tuple[Finding, ...]:
    """Collect what the user must know although the result may be good.

    unasked : too many sensors for trials.
    """
    rig, trials = of.rig, of.monte_carlo
    found = list(of.dwells.findings)
    if (used := int(np.count_nonzero(of.fit.weight))) < ENOUGH:
        found.append(Finding("postures-few", size=used, values={"enough": ENOUGH}))
    found += log_against_rig.turned(rig, of.dwells.position)
    found += of.turned_sensors()
    found += of.observability.findings
    if rig.declared.force_sensitivity > 0:
        found.append(Finding("sensitivity-in-situ", size=rig.declared.force_sensitivity))
    if of.quality.birge <= rig.acceptance.birge_max:  # the gate says so else
        found += _of_the_noise(of.estimate)
    found += of.harmless()
    if trials is not None and trials.unsettled:
        values: dict[str, Value] = {"trials": trials.trials}
        found.append(Finding("trials-unsettled", size=trials.unsettled, values=values))
    if trials is not None and trials.decides:
        found.append(Finding("intervals-by-trials"))
    if of.estimator == "ml":
        found += exact_caveats(of.estimate)
        if unasked:
            found.append(Finding("trials-left-out", size=rig.n))
    return tuple(found)


def _of_the_noise(known: Estimate[Fit]) -> list[Finding]:
    """Noise that nobody stated, or that was stated too small or too large."""
    stats = known.quality
    if known.fit.postures.noise_from_residuals:
        return [Finding("noise-from-residuals")]
    if stats.p_value < MISFIT:
        return [Finding("noise-understated", size=stats.birge, p_value=stats.p_value)]
    if stats.p_value > 1 - OVERSTATED_NOISE:
        return [Finding("noise-overstated", size=stats.birge, p_value=1 - stats.p_value)]
    return []


def _check(fit: Fit, seen: Undetermined, usable: Usable, near: tuple[Rival, ...]) -> None:
    """Raise where no angles can be given; what is wrong with the log before advice on postures.

    near : other mountings that may explain the postures as well.
    """
    rig = seen.rig
    try:
        require_angles(seen.observability, fit.converged, fit.iterations, seen)
        if near and near[0].p_value > AMBIGUOUS_MOUNTING:  # the data do not tell it
            mountings, same = describe(rig, fit.state, near[0].state)
            values: dict[str, Value] = {"mountings": mountings, "same": same}
            if (used := int(np.count_nonzero(fit.weight))) < ENOUGH:
                values |= {"few": used, "least": ENOUGH}
            values["alike"] = near[0].p_value > 1.0 - INTERVAL_COVERAGE
            gap, p_value = abs(near[0].gap), near[0].p_value
            alike = Finding("mountings-alike", size=gap, p_value=p_value, values=values)
            raise NotIdentifiableError(alike, evidence=seen)
    except (NotIdentifiableError, NotConvergedError):
        everyone = np.ones(len(usable.index))
        present = at_state(rig, usable.postures, fit.state, everyone)
        check_readings(rig, usable.postures, present, Rests(usable.number, usable.time))
        raise


@record
class _Told:
    """What the residuals of an estimate say that the rig file lacks; each test is made once."""

    known: Estimate[Fit]
    usable: Usable

    @cached_property
    def doubts(self) -> tuple[Suspicion, ...]:
        """The likeliest suspicions."""
        return suspicions(self.known, self.usable.time, self.usable.temperature)

    @cached_property
    def change(self) -> Suspicion | None:
        """The likeliest change on the way."""
        return find_change(self.known, self.usable.time, self.usable.number)

    @cached_property
    def whole(self) -> _Told:
        """The same of the estimate by all postures."""
        whole = _by_all(self.known.fit.rig, self.known.fit)
        return self if whole is self.known.fit else _Told(estimate(whole), self.usable)


def _by_all(rig: Rig, result: Fit) -> Fit:
    """The fit by all of the postures: the result itself where it leaves none out."""
    same = result.rig is rig and result.weight.all()
    return result if same else fit(rig, result.postures, result.state)


def _likeliest_rotations(rig: Rig, usable: Usable) -> tuple[RobustFit, _Told]:
    """Maximum likelihood; without postures in contact that hide each other, or over which one
    stayed, where that explains more than any other cause.
    """
    loose, seen = loosened(rig), usable.postures
    robust = _with_earlier(rig, seen, fit_robust(loose, seen, usable.start))
    told = _Told(estimate(robust.fit), usable)
    if seen.noise_from_residuals:
        return robust, told
    # Each by how far −2 ln L falls below that of all postures, less what its unknowns are worth.
    rivals, named = list[tuple[float, RobustFit]](), 0.0
    whole, change = told.whole, told.change
    if told.known.quality.p_value < MISFIT:
        hidden = hidden_contact(loose, seen, _by_all(loose, whole.known.fit))
        if hidden is not None:
            hidden = _with_earlier(rig, seen, hidden)
            rivals.append((contact_worth(hidden.fit, whole.known.fit), hidden))
    if change is not None:
        weight = change.weight + contact_worth(robust.fit, whole.known.fit)
        if change.kind == "contact":
            rivals.append((weight, _without(rig, usable, robust, change)))
        else:
            named = weight
    if not rivals:
        return robust, told
    likelier, found = max(rivals, key=lambda rival: rival[0])
    if max([named, *(doubt.weight for doubt in whole.doubts)]) > likelier:
        return robust, told
    return found, _Told(estimate(found.fit), usable)


def _without(rig: Rig, usable: Usable, robust: RobustFit, change: Suspicion) -> RobustFit:
    """The fit without the postures over which a contact stayed."""
    first, last = (change.causes[0].values[end] for end in ("posture", "last"))
    assert isinstance(first, int)
    assert isinstance(last, int)
    touched = (usable.number >= first) & (usable.number <= last)
    weight = np.where(touched, 0.0, 1.0)
    state = robust.fit.state
    return RobustFit.of(settled(rig, usable.postures, fit(rig, usable.postures, state, weight)))


def _with_earlier(rig: Rig, observed: Postures, robust: RobustFit) -> RobustFit:
    """What earlier campaigns know comes in whole once the outliers are out."""
    if rig.earlier is None:
        return robust
    return replace(robust, fit=fit(rig, observed, robust.fit.state, robust.fit.weight))


def _linear(
    rig: Rig, likeliest: Callable[[], SelfCalibration], rng: np.random.Generator, trials: int
) -> SelfCalibration:
    """The paper's angles, of the postures that the likeliest ones leave, which judge the data.

    The residuals of the paper's angles hold the method's own errors. What it takes as stated
    and is not moves its angles from the likeliest, farther than its trials explain.
    """
    for i, j in np.argwhere(~rig.axes)[:1]:
        missing = Finding("linear-axis-missing", (rig.supports[i],), values={"axis": "xyz"[j]})
        raise RigError(missing)
    own = likeliest()
    result = fit_linear(rig, own.fit.postures, own.fit.weight)
    spread = evaluate_linear(result, rng, trials)
    known = replace(estimate(result), quality=own.quality, uncertainty=spread)
    linear = replace(own, estimator="linear", estimate=known)
    turn = so3.log(result.state.rotation @ np.swapaxes(own.fit.state.rotation, 1, 2)).ravel()
    apart = float(turn @ np.linalg.solve(spread.covariance, turn))
    notes = caveats(linear, unasked=False)
    if chi2_sf(apart, len(turn)) < MISFIT:
        size = np.sqrt(apart / len(turn))
        notes = (Finding("linear-apart", size=float(size), rejects=True), *notes)
    return _judged(linear, *notes)


def _doubts(told: _Told, *, many_rejected: bool) -> tuple[Suspicion, ...]:
    """What the residuals say that the rig file lacks."""
    if told.usable.postures.noise_from_residuals:
        return ()
    if told.doubts or not many_rejected:
        return told.doubts
    # So many do not err each for itself.
    whole = told.whole
    contact = contact_worth(told.known.fit, whole.known.fit)
    doubts = (replace(doubt, weight=doubt.weight - contact) for doubt in whole.doubts)
    return tuple(doubt for doubt in doubts if doubt.weight > -CAUSES_APART)


def _with_change(doubts: tuple[Suspicion, ...], told: _Told) -> tuple[Suspicion, ...]:
    """Hold a change on the way against the other doubts: the likeliest, and those about as likely.

    What spoils the whole campaign may look like a slip, and a slip like much that does.
    """
    if told.change is None:
        return doubts
    walks = wandering(told.known, told.usable.time)
    rivals = doubts or [walk for walk in walks if walk.p_value < CAUSE_EXPLAINS]
    return likeliest([told.change, *rivals])
