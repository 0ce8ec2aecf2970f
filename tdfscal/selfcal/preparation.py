"""From dwells to postures that a fit may use: held against the rig, with noise and a start.

Are the log's channels what they are called? Distances between hinges over the postures are held
against what is stated, then forces against the weight where they fit best, and where they fit
nowhere against what they would be without one mistake. Which of both is exchanged where a rig looks
alike with its supports in another order, forces and positions tell together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tdfscal.checks import faulty_sensors, log_against_rig
from tdfscal.checks.geometry import examine
from tdfscal.errors import DataError, RigError
from tdfscal.estimation.exact_quantities import misplaced
from tdfscal.estimation.fit import factored_information
from tdfscal.estimation.score_tests import Suspicion
from tdfscal.estimation.uncertainty import Estimate, quality
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State, layout, nominal
from tdfscal.model.postures import Rests
from tdfscal.model.statics import Postures, forces, postures
from tdfscal.records import Dwells, FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import Fit
from tdfscal.selfcal.mounting_search import apart, best_start
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.significance import BETTER, MOST_POSTURES

if TYPE_CHECKING:
    from tdfscal.checks.wiring import Wiring
    from tdfscal.selfcal.misreadings import Misreading

#: Variance of the residuals, in units of the one stated, above which no mounting explains them.
_LOST = 100.0
#: Noise of a reading, N, where it is not known yet.
_NOISE = 1.0
#: Rounds that bring an unknown noise level and the fit into agreement.
_LEVELS = 6


@record
class Usable:
    """Postures that a fit may use.

    index : (K,), their dwells. time : (K,), s, when each was held. temperature : (K, n), °C, where
    it is known. reasons : dwell → why it is not among them. start : in the basin of the lowest
    minimum over all mountings.
    """

    postures: Postures
    index: IntArray
    time: FloatArray
    temperature: FloatArray | None
    reasons: dict[int, Finding]
    start: State

    @property
    def number(self) -> IntArray:
        """By which the postures go, (K,)."""
        return self.index + 1


def usable_postures(rig: Rig, dwells: Dwells) -> Usable:
    """Hold the dwells against the rig file and leave out what no sensor can have felt.

    Raises DataError where there is nothing left, or log and rig file contradict each other;
    NotIdentifiableError where the sensors together miss a direction of forces.
    """
    if len(dwells) == 0:
        from tdfscal.dwells.find import no_dwell

        raise no_dwell(dwells)
    check_positions(rig, postures(rig, dwells))
    faulty_sensors.check_directions(rig)
    screened = faulty_sensors.screen(rig, dwells)
    index = np.flatnonzero(screened.keep)
    if len(index) == 0:
        raise DataError(Finding("postures-unusable"), findings=(screened.reasons[0],))
    warmth = dwells.temperature
    if rig.drift.temperature > 0 and warmth is None:
        raise RigError(Finding("temperature-missing"))
    if rig.drift.temperature > 0 and warmth is not None and np.any(np.ptp(warmth, axis=0) == 0):
        constant = float(warmth[0].min())
        raise DataError(Finding("temperature-constant", size=constant, unit="°C"))
    observed = postures(rig, dwells).subset(index)
    scatter = np.diagonal(observed.force_cov, axis1=2, axis2=3)[:, observed.measured]
    measured_noise = bool(scatter.min(initial=np.inf) <= 0)
    start = best_start(rig, _with_noise(observed, 1.0) if measured_noise else observed)
    check_forces(rig, start.postures, start, Rests(index + 1, dwells.start[index]))
    if measured_noise:
        observed = _with_residual_noise(rig, observed, start.state)
    time = ((dwells.start + dwells.end) / 2)[index]
    warmth = None if warmth is None else warmth[index]
    reasons = dict(screened.reasons)
    return Usable(observed, index, time, warmth, reasons, start.state)


def _with_noise(observed: Postures, level: float) -> Postures:
    """Postures whose forces have this standard uncertainty, N per axis."""
    return replace(
        observed, force_cov=np.broadcast_to(level**2 * np.eye(3), observed.force_cov.shape)
    )


def _with_residual_noise(rig: Rig, observed: Postures, start: State) -> Postures:
    """Postures with the noise level that their residuals show.

    Averaged postures (`rows: postures`) without `uncertainty.force_noise` carry no scatter. The
    level is then the one with χ² = dof, at the price that χ² can no longer warn of anything.
    """
    level = 1.0
    for _ in range(_LEVELS):
        guess = _with_noise(observed, level)
        result = fit_robust(rig, guess, start).fit
        start = result.state
        stats = quality(result, factored_information(result))
        if stats.dof <= 0 or abs(stats.birge - 1) < 1e-3:
            break
        level *= stats.birge
    return replace(guess, noise_from_residuals=True)


def misplaced_hinges(of: Estimate[Fit]) -> tuple[Suspicion, ...]:
    """Name what contradicts the stated distances between hinges, with what it does to angles."""
    fit = of.fit
    used = np.flatnonzero(fit.weight > 0)
    seen = fit.at.seen.subset(used)
    variance = np.trace(seen.position_cov, axis1=2, axis2=3).mean(axis=1) / 3
    found = examine(fit.rig, seen.position, variance, forces(fit.state, seen.force), frames=True)

    def framed(wrong: FloatArray) -> FloatArray:
        away = seen.position - seen.position.mean(axis=0)
        logged = np.zeros_like(fit.postures.position)
        logged[used] = np.einsum("iab,kib->kia", wrong, away)
        by_place = fit.slopes[:, :, layout(fit.rig.n, fit.state.motions)["datum"]]
        white = by_place @ logged.reshape(len(logged), -1, 1)
        return np.asarray(white.ravel())

    return misplaced(of, found, framed)


def check_positions(rig: Rig, seen: Postures) -> None:
    """Refuse positions with which no fit can be trusted, and name whole supports exchanged.

    Raises DataError as `log_against_rig.check_geometry`.
    """
    try:
        log_against_rig.check_geometry(rig, seen.position, seen.force)
    except DataError as error:
        ways = log_against_rig.explanations(rig, seen.position, seen.force)
        if len(ways) < 2 and not any(way.whole for way in ways):
            raise
        cov = np.broadcast_to(_NOISE**2 * np.eye(3), seen.force_cov.shape)
        some = _some(replace(seen, force_cov=cov))
        fits: list[tuple[float, bool, Wiring]] = []
        for way in ways:
            placed = way.positions(some)
            fits.append((best_start(rig, placed).misfit, False, way))
            if way.whole:
                fits.append((best_start(rig, way.postures(placed)).misfit, True, way))
        (best, whole, way), (second, *_) = sorted(fits, key=lambda fit: fit[0])[:2]
        if not (best < BETTER and BETTER * best < second):
            raise
        own = {"moved", "sources", "turned", "signs"}
        values = {key: value for key, value in error.finding.values.items() if key not in own}
        values |= {"fits": way.words, "whole": whole, **way.written(rig.supports)}
        raise DataError(replace(error.finding, values=values)) from error


def _some(seen: Postures) -> Postures:
    """Of many postures a part, evenly spread."""
    some = np.linspace(0, len(seen) - 1, min(len(seen), MOST_POSTURES)).round()
    return seen.subset(some.astype(np.int64))


def check_forces(rig: Rig, observed: Postures, start: Fit, rests: Rests | None = None) -> None:
    """Raise where units, signs or names of the channels cannot be right at any mounting.

    Parameters
    ----------
    start : the best that can be made of the forces as they are named.
    rests : what the postures are; none of a motion.

    Raises
    ------
    DataError
        Forces and weight differ, or one mistake explains what the readings as they are do not.
    """
    strongest = np.linalg.norm(observed.force - rig.zero.value, axis=2).sum(axis=1)
    mass, std = float(rig.mass.value), float(rig.mass.std)
    # With weaker ones no mounting makes them carry the weight.
    least = mass * rig.gravity * (1 - log_against_rig.weight_tolerance(std / mass))
    weak = bool(np.median(strongest) < least)
    held = log_against_rig.weight_share(nominal(rig), rig.gravity, observed.force)
    if weak and any(log_against_rig.unit_of(float(np.median(held)))):
        log_against_rig.check_weight(rig, observed, nominal(rig))
    if start.misfit > _LOST:
        check_readings(rig, observed, start, rests)
        log_against_rig.check_weight(rig, observed, nominal(rig))
    elif start.misfit > BETTER:
        _check_places(rig, observed, start)
    if start.state.mass <= 0:
        raise _mirrored(rig, start)
    log_against_rig.check_weight(rig, observed, start.state)
    _check_hand(rig, observed, start)


def _check_hand(rig: Rig, observed: Postures, start: Fit) -> None:
    """Raise where only unstated zeros hold the weight up, and not so with log and hinges mirrored.

    Where the hinges are those of a left-handed log, its forces fit with all sensors turned by half
    a turn: about a horizontal axis zeros make up for the weight that they then pull down.
    """
    bare = replace(start.state, zero=rig.zero.value)
    if np.median(log_against_rig.weight_share(bare, rig.gravity, observed.force)) > 0:
        return
    from tdfscal.checks.wiring import frames

    near = nominal(rig).rotation
    found: list[tuple[float, Wiring]] = []
    for way in (way for way in frames(rig.n) if way.mirror):
        centre = replace(rig.barycentre, value=rig.barycentre.value * way.sign[0])
        mirrored = replace(rig, hinge=rig.hinge * way.sign[0], barycentre=centre)
        other = best_start(mirrored, way.positions(observed))
        if other.misfit < BETTER * start.misfit:
            found.append((float(apart(other.state.rotation, near)), way))
    turn, likely = min(found, key=lambda each: each[0], default=(np.inf, None))
    if likely is not None and turn < apart(start.state.rotation, near):
        values = {"fits": likely.words, "hinges": True, **likely.written(rig.supports)}
        raise DataError(Finding("positions-renamed", values=values))


def _mirrored(rig: Rig, start: Fit) -> DataError:
    """The error for forces that hold up a negative mass: an odd number of axes is of opposite sign.

    Which one is a matter of quarter turns: the one whose sensors are turned least is named.
    """
    turn = {
        f"F{axis}": float(apart(-start.state.rotation @ M, nominal(rig).rotation))
        for axis, M in zip("xyz", np.eye(3) - 2 * np.eye(3)[:, :, None] * np.eye(3), strict=True)
    }
    axis = min(turn, key=turn.__getitem__)
    mass = float(start.state.mass)
    return DataError(Finding("forces-mirrored", size=mass, unit="kg", values={"axis": axis}))


def check_readings(rig: Rig, observed: Postures, present: Fit, rests: Rests | None = None) -> None:
    """Raise DataError where other positions, or one mistake in the readings, explain the postures.

    present : the best that can be made of them as they are. rests : as in `check_forces`.
    """
    from tdfscal.selfcal.misreadings import misreading  # of forces that fit nowhere

    _check_places(rig, observed, present)
    if (found := misreading(rig, observed, present, rests)) is not None:
        raise misread(rig, found, present, rests)


def _check_places(rig: Rig, observed: Postures, present: Fit) -> None:
    """Raise where the postures fit only with the positions of a left-handed log, or upright."""
    turned = log_against_rig.upright(rig, observed.position)
    for other in (*log_against_rig.mirrors(rig, observed.position), *filter(None, [turned])):
        placed = best_start(rig, other.positions(_some(observed))).misfit
        if placed < BETTER and BETTER * placed < present.misfit:
            values = {"fits": other.words, **other.written(rig.supports)}
            raise DataError(Finding("positions-renamed", values=values))


def misread(
    rig: Rig,
    found: Misreading,
    present: Fit,
    rests: Rests | None = None,
    *,
    check: bool = False,
) -> DataError:
    """The error that names a mistake with its evidence; parameters as in `check_readings`.

    check : the postures are those of a check, which has no zeros to calibrate.
    """
    from tdfscal.checks.wiring import REACTION

    mistake = found.mistake
    if mistake.wiring is not None and mistake.wiring.words == REACTION:
        allowed = log_against_rig.weight_tolerance(0.0)
        return log_against_rig.weight_error(-1.0, allowed, float(rig.mass.value))
    values: dict[str, Value] = {
        "before": float(np.sqrt(present.misfit)),
        "after": float(np.sqrt(found.fit.misfit)),
    }
    if mistake.wiring is not None:
        values |= {"exchange": mistake.wiring.words, **mistake.wiring.written(rig.supports)}
        values["check"] = check and mistake.wiring.mounting
        # Hinges that lie as the positions have them are exchanged with these.
        values["either"] = mistake.wiring.whole and not check
        return DataError(Finding("forces-exchanged", values=values))
    subject = (rig.supports[mistake.support],)
    if rests is None or found.jump is None:
        axis = "" if mistake.axis is None else "xyz"[mistake.axis]
        unit, declared = log_against_rig.unit_of(mistake.factor)
        values |= {"axis": axis, "unit": unit, "declared": declared}
        return DataError(Finding("force-rescaled", subject, mistake.factor, values=values))
    last, first = found.between
    values |= {
        "jump": [f"{value:.3g}" for value in found.jump],
        "first": float(rests.number[first]),
        "tared": found.tared,
        "check": check,
    }
    if not np.array_equal(rests.time, rests.number - 1):  # a row that is a posture has no other
        values |= {"between": rests.time[[last, first]].tolist(), "cut": float(rests.time[first])}
    size = float(np.linalg.norm(found.jump))
    return DataError(Finding("zero-tared", subject, size, "N", values=values))
