"""Does a calibration still hold? Residual contact wrenches of static postures.

The residual wrenches of all postures are tested together: the error of the calibration is common
to them, only the dwells' own noise is not (theory, section 7).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy import special

from tdfscal.checks import faulty_sensors, log_against_rig
from tdfscal.checks.wiring import turned_axes
from tdfscal.dwells.find import no_dwell
from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated, informed, loosened, redrawn, with_own_load
from tdfscal.model.parameters import State, nominal, starting_state, with_motions
from tdfscal.model.postures import Rests, ZeroAge
from tdfscal.model.statics import Balance, Postures, balance, features_jacobian, postures
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.records import Dwells, FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import Fit, at_state, fit
from tdfscal.selfcal.misreadings import Misreading, Mistake, misreading
from tdfscal.selfcal.mounting_search import best_start
from tdfscal.selfcal.preparation import check_positions, misread
from tdfscal.significance import BETTER, CAUSES_APART, MISFIT, MOST_POSTURES
from tdfscal.validation.causes import Cause, causes
from tdfscal.validation.residuals import Course, Linearised, Whitened, moving_zeros
from tdfscal.validation.verdict import (
    Judged,
    Verdict,
    Zeros,
    judged_with_zeros,
    searched,
)
from tdfscal.wrench.contact_wrench import contact_wrench, reached, to_lcs

#: Postures by which a calibration is tested; fewer show no more than a gross change.
ENOUGH = 3


@record
class KnownNoise:
    """What a calibration's own postures say of the noise.

    birge : √(χ²/dof) of its fit, where above 1, by which its own noise was scaled too. dof : behind
    that.
    """

    birge: float = 1.0
    dof: int = 0

    def scaled(self, observed: Postures) -> Postures:
        """Postures whose noise is what the calibration's own postures showed it to be."""
        if self.birge > 1.0:
            variance = self.birge**2
            observed = replace(
                observed,
                force_cov=variance * observed.force_cov,
                position_cov=variance * observed.position_cov,
                moment_var=variance * observed.moment_var,
            )
        return observed

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was taken from the calibration, where the noise was not as stated."""
        found = []
        if self.birge > 1.0 and chi2_sf(self.birge**2 * self.dof, self.dof) < MISFIT:
            found.append(Finding("noise-as-calibrated", size=self.birge))
        return tuple(found)

    @property
    def freedom(self) -> float:
        """Degrees of freedom with which the noise is known: ∞ as stated, or those that told it."""
        return self.dof if self.birge > 1.0 else np.inf

    def chi2_sf(self, square: float, freedom: int) -> float:
        """Probability of a larger sum of squares of so many white residuals, by Fisher's F."""
        if np.isinf(self.freedom):
            return float(special.chdtrc(freedom, square))
        return float(special.fdtrc(freedom, self.freedom, square / freedom))

    def gain_sf(self, gain: float, unknowns: int, rest: float, rest_freedom: int) -> float:
        """Probability that chance alone lets so many unknowns take more of a sum of squares.

        rest : what they leave, which tells of the noise too where it is not known as stated; it
        never makes that smaller than stated.
        """
        if unknowns == 0:
            return 1.0
        if np.isinf(self.freedom) or rest_freedom <= 0:
            return self.chi2_sf(gain, unknowns)
        freedom = self.freedom + rest_freedom
        variance = max((self.freedom + rest) / freedom, self.birge**-2)
        return float(special.fdtrc(unknowns, freedom, gain / unknowns / variance))


#: A calibration that says nothing of the noise.
AS_STATED = KnownNoise()


@record(kw_only=True)
class Validation(Verdict):
    """Verdict on a calibration by K postures without contact.

    dwells : those found. used : (K,), indices of the dwells in the test. left_out : dwell index →
    reason. nominal, calibrated : (K, 6), residual contact wrench in the LCS about its origin, N
    and N·m, without and with the calibration, zeros that moved as they are now; std : (K, 6), the
    latter's predicted standard uncertainty.
    """

    dwells: Dwells
    used: IntArray
    left_out: dict[int, Finding]
    nominal: FloatArray
    calibrated: FloatArray
    std: FloatArray

    @property
    def few(self) -> bool:
        """Its postures are fewer than are enough."""
        return len(self.used) < ENOUGH


def validate(
    given: Calibrated,
    dwells: Dwells,
    *,
    rig: Rig | None = None,
    noise: float | None = None,
    known: KnownNoise = AS_STATED,
    age: ZeroAge | None = None,
    aside: Mapping[int, Finding] = MappingProxyType({}),
) -> Validation:
    """Test a calibration on static dwells without contact.

    rig : the rig of this log, for what it declares, its zeros and its load; default the
    calibration's.
    noise : N, standard uncertainty of a reading per axis where neither log nor rig state one.
    known : what the calibration found of the noise.
    age : of the calibration's zeros at the first dwell, from which on they move as is declared.
    aside : dwells that take no part, with the reason.

    Raises
    ------
    DataError
        There is no dwell, positions do not fit the hinges, a sensor is dead or saturated, no noise
        is stated, or forces are not what their fields are called, or in another unit.
    """
    rig = rig or given.rig
    given = with_own_load(given, rig)
    every, left_out = _postures(rig, dwells, age, aside)
    used = np.setdiff1d(np.arange(len(dwells)), list(left_out))
    observed, found = _with_noise(every.subset(used), noise)
    middle = (dwells.start + dwells.end)[used] / 2
    warm = None if dwells.temperature is None else dwells.temperature[used]
    tested = partial(_tested, given, rig, known, Course(middle, warm))
    (balanced, slopes, at), judged, zeros = tested(observed, np.arange(len(used)))
    if not judged.holds:
        rests = Rests(used + 1, dwells.start[used])
        refuse_misread(given, rig, observed, lambda *part: tested(*part)[1], rests)
    if zeros.moved:
        given = redrawn(given, zero=(zeros.value, zeros.covariance))
    before, after = (
        contact_wrench(state, given.rig.gravity, balanced.rotation, balanced.seen.force)
        for state in (nominal(given.rig), given.state)
    )
    return Validation(
        rig=rig,
        dwells=dwells,
        used=used,
        left_out=left_out,
        nominal=before,
        calibrated=after,
        std=_std(balanced, slopes @ block_diagonal(given.root, at.own_root)),
        judged=judged,
        zeros=zeros,
        findings=(
            *dwells.findings,
            *found,
            *known.findings,
            *log_against_rig.turned(rig, dwells.position),
        ),
    )


def _postures(
    rig: Rig, dwells: Dwells, age: ZeroAge | None, aside: Mapping[int, Finding]
) -> tuple[Postures, dict[int, Finding]]:
    """All of a log's, held against the rig file, and why some of them take no part."""
    if len(dwells) == 0:
        raise no_dwell(dwells)
    log_against_rig.check_unit(rig, dwells.force)
    every = postures(rig, dwells, age)
    check_positions(rig, every)
    reasons = faulty_sensors.screen(rig, dwells).reasons
    left_out = {**reasons, **aside}
    if len(left_out) == len(dwells):
        raise DataError(Finding("dwells-unusable"), findings=tuple(reasons.values())[:1])
    return every, left_out


def _tested(
    given: Calibrated, rig: Rig, known: KnownNoise, course: Course, seen: Postures, which: IntArray
) -> tuple[tuple[Balance, FloatArray, Linearised], Judged, Zeros]:
    """Postures at the calibration, judged by its zeros or new ones; which : of the course's."""
    found = _linearised(given, known.scaled(seen), course.subset(which))
    weigh = partial(judged_by, known=known)
    return found, *judged_with_zeros(found[2], given, rig, weigh)


def judged_by(white: Whitened, known: KnownNoise = AS_STATED) -> Judged:
    """Residuals held against chance: all together, and what looks most like one single cause."""
    found = causes(white)
    overall = known.chi2_sf(white.chi2, white.dof) if white.dof > 0 else 1.0

    def chance(cause: Cause) -> float:
        rest = white.chi2 - cause.gain
        return known.gain_sf(cause.gain, cause.unknowns, rest, white.dof - cause.unknowns)

    return Judged(white, found, overall, searched(found, chance), noise_dof=known.freedom)


def _with_noise(observed: Postures, noise: float | None) -> tuple[Postures, tuple[Finding, ...]]:
    """Postures with a noise level: their own, or the one that the calibration met."""
    if np.diagonal(observed.force_cov, axis1=2, axis2=3)[:, observed.measured].min() > 0:
        return observed, ()
    if not noise:
        raise DataError(Finding("noise-unstated"))
    cov = np.broadcast_to(noise**2 * np.eye(3), observed.force_cov.shape)
    return replace(observed, force_cov=cov), (
        Finding("noise-of-calibration", size=noise, unit="N"),
    )


def _linearised(
    given: Calibrated, observed: Postures, course: Course
) -> tuple[Balance, FloatArray, Linearised]:
    """Postures in balance at the calibration; the residual wrenches' slopes (K, 6, P + E) in the
    LCS; and both whitened by each posture's own noise.
    """
    rig, state = given.rig, with_motions(given.state, observed.motions)
    at = balance(observed, state, state.barycentre, rig.gravity)
    T = to_lcs(at)
    slopes = T @ (at.design @ features_jacobian(state, at, rig.gravity))
    residual = contact_wrench(state, rig.gravity, at.rotation, at.seen.force)
    own = at.whitener @ np.linalg.inv(T)
    root, unknown = moving_zeros(rig, observed.motion)
    white = Linearised(
        residual=(own @ residual[..., None]).ravel(),
        columns=(own @ slopes).reshape(-1, slopes.shape[2]),
        own=own,
        own_root=root,
        own_unknown=unknown,
        rows=int(at.rows.sum()),
        sensors=rig.n,
        course=course,
    )
    return at, slopes, white


def _std(at: Balance, half: FloatArray) -> FloatArray:
    """Standard uncertainty (K, 6) of residual wrenches, ∞ where an unmeasured force reaches.

    half : (K, 6, r), what the calibration's error makes of them.
    """
    T = to_lcs(at)
    total = T @ at.cov @ np.swapaxes(T, 1, 2) + half @ np.swapaxes(half, 1, 2)
    std = np.sqrt(np.diagonal(total, axis1=1, axis2=2))
    return np.asarray(np.where(reached(T @ at.free), np.inf, std))


def refuse_misread(
    given: Calibrated,
    rig: Rig,
    seen: Postures,
    judge: Callable[[Postures, IntArray], Judged] | None = None,
    rests: Rests | None = None,
) -> None:
    """Raise DataError where one mistake in the readings explains them, likelier than any change.

    given : the calibration, with the load of this log. seen : K postures, or moments of a motion,
    which have no rests. judge : of postures, and which of K; without it the search is the judge.
    """
    some = np.unique(np.linspace(0, len(seen) - 1, MOST_POSTURES).round().astype(np.int64))
    seen = seen.subset(some)
    if rests is not None:
        rests = Rests(rests.number[some], rests.time[some])
    known = loosened(informed(rig, given))
    start = starting_state(known, seen.motions)
    present = fit(known, seen, start)
    _refuse_turned(known, seen, start, present)
    found = misreading(known, seen, present, rests)
    if found is None:
        return
    if judge is not None:
        now = judge(seen, some)
        if found.jump is not None:  # a cause too, which stands beside a slip there
            best = now.causes.best[0]
            if (best.kind, best.support) != ("zero jumped", found.mistake.support):
                return
            raise misread(known, found, present, rests, check=True)
        without = judge(found.fit.postures, some)
        # What has a number is no likelier by little, nor beside a second cause.
        apart = 0.0 if found.exact else CAUSES_APART
        if without.merit <= (now.merit[0], now.merit[1] + apart) or not (
            found.exact or without.holds
        ):
            return
    raise misread(known, found, present, rests, check=True)


def _refuse_turned(known: Rig, seen: Postures, start: State, present: Fit) -> None:
    """Raise DataError where sensors turned by quarter turns explain what they do not as mounted.

    Who mounted none anew has axes of the opposite sign, or exchanged; a fit about the calibrated
    mounting, `start`, does not find its way so far: all mountings are searched.
    """
    if present.misfit >= BETTER:
        present = best_start(known, seen)
    turns = np.swapaxes(start.rotation, 1, 2) @ present.state.rotation
    if (other := turned_axes(known.supports, turns)) is None:
        return
    found = Misreading(Mistake(other), fit(known, other.postures(seen), start))
    if found.fit.misfit < BETTER:
        mounted = at_state(known, seen, start, np.ones(len(seen)))
        raise misread(known, found, mounted, check=True)
