"""From dwells to postures that a fit may use: held against the rig, with noise and a start.

Before any force the distances between hinges over the postures are held against what is stated.
"""

from __future__ import annotations

import numpy as np

from tdfscal.checks import faulty_sensors
from tdfscal.checks.geometry import Cause, examine
from tdfscal.errors import DataError, RigError
from tdfscal.estimation.exact_quantities import framed_positions, misplaced
from tdfscal.estimation.fit import factored_information
from tdfscal.estimation.score_tests import Suspicion
from tdfscal.estimation.uncertainty import Estimate, quality
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State, layout
from tdfscal.model.postures import Rests
from tdfscal.model.statics import Postures, forces, postures
from tdfscal.records import Dwells, FloatArray, IntArray, Rig
from tdfscal.selfcal.channel_checks import check_forces, check_positions
from tdfscal.selfcal.estimator import Fit
from tdfscal.selfcal.mounting_search import best_start
from tdfscal.selfcal.outliers import fit_robust

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
    _check_temperature(rig, dwells)
    observed = postures(rig, dwells).subset(index)
    scatter = np.diagonal(observed.force_cov, axis1=2, axis2=3)[:, observed.measured]
    measured_noise = bool(scatter.min(initial=np.inf) <= 0)
    start = best_start(rig, _with_noise(observed, 1.0) if measured_noise else observed)
    check_forces(rig, start.postures, start, Rests(index + 1, dwells.start[index]))
    if measured_noise:
        observed = _with_residual_noise(rig, observed, start.state)
    time = ((dwells.start + dwells.end) / 2)[index]
    warmth = None if dwells.temperature is None else dwells.temperature[index]
    reasons = dict(screened.reasons)
    return Usable(observed, index, time, warmth, reasons, start.state)


def _check_temperature(rig: Rig, dwells: Dwells) -> None:
    """Raise where zeros are to follow a temperature that nobody recorded, or that never changes."""
    if not rig.drift.temperature > 0:
        return
    if dwells.temperature is None:
        raise RigError(Finding("temperature-missing"))
    if np.any(np.ptp(dwells.temperature, axis=0) == 0):
        constant = float(dwells.temperature[0].min())
        raise DataError(Finding("temperature-constant", size=constant, unit="°C"))


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

    def framed(cause: Cause) -> FloatArray:
        logged = np.zeros_like(fit.postures.position)
        logged[used] = framed_positions(cause, seen.position)
        by_place = fit.slopes[:, :, layout(fit.rig.n, fit.state.motions)["datum"]]
        white = by_place @ logged.reshape(len(logged), -1, 1)
        return np.asarray(white.ravel())

    return misplaced(of, found, framed)
