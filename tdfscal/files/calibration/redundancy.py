"""Numbers that a calibration file states at two places, beside those of the rotations, agree."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tdfscal.files.calibration.consistency import ALTERED, SAME, SAME_STD
from tdfscal.files.calibration.parameters import calibrated_from
from tdfscal.files.field_types import fault
from tdfscal.model.parameters import State, layout, symmetric
from tdfscal.numerics.distributions import chi2_sf, coverage_factor
from tdfscal.records import ANGLES, FloatArray

if TYPE_CHECKING:
    from tdfscal.files.calibration.document import Calibration


def check_stated(c: Calibration) -> None:
    """Refuse a file whose zeros, load, intervals, budget or χ² disagree with what they follow from.

    Raises the model's fault, which names the place.
    """
    _check_intervals(c)
    _check_budget(c)
    _check_fit(c)
    if c.parameters is not None:
        given = calibrated_from(c.parameters, c.loaded_rig().rig, c.rotation)
        _check_state(c, given.state, np.sqrt(np.diagonal(given.covariance)))


def _check_state(c: Calibration, state: State, std: FloatArray) -> None:
    """Compare with the block of all parameters; std (P,), by it."""
    n, place = len(c.supports), layout(len(c.supports))
    for index, support in enumerate(c.supports):
        where = ("supports", index)
        own = np.array([value is not None for value in support.zero])
        _same(support.offset, np.where(own, state.zero[index], 0.0), *where, "zero")
        stated = [s for s, there in zip(support.zero_std, own, strict=True) if there]
        _same_std(stated, std[place["zero"]].reshape(n, 3)[index, own], *where, "zero_std")
        scale = np.eye(3) + symmetric(state.sensitivity)[index]
        _same(c.sensitivity[index], scale, *where, "sensitivity")
    mass, bary = c.terminal.mass, c.terminal.barycenter
    _same(mass.value, state.mass, "terminal", "mass", "value")
    _same_std([mass.std], std[place["mass"]], "terminal", "mass", "std")
    _same(bary.value, state.barycentre, "terminal", "barycenter", "value")
    _same_std(bary.std, std[place["barycentre"]], "terminal", "barycenter", "std")


def _check_intervals(c: Calibration) -> None:
    """An interval is that of the Monte Carlo, or ± k standard uncertainties of some dof."""
    trials = c.monte_carlo
    for index, support in enumerate(c.supports):
        mounting = support.mounting
        if mounting is None or None in support.rpy_std:
            continue
        low, high = np.array(mounting.interval.low), np.array(mounting.interval.high)
        if trials is not None:
            drawn = np.array([trials.low[index], trials.high[index]])
            if np.allclose([low, high], drawn, rtol=0, atol=SAME):
                continue
        half, coverage = (high - low) / 2, mounting.interval.coverage
        least, most = (
            coverage_factor(coverage, dof) * np.array(mounting.rpy_std) for dof in (np.inf, 1.0)
        )
        off = np.abs((low + high) / 2 - mounting.rpy)
        if np.any((off > SAME) | (half < least - SAME) | (half > most + SAME)):
            place = ("supports", index, "rpy_interval")
            raise fault("does not follow from `rpy` and `rpy_std`", *place, hint=ALTERED)


def _check_budget(c: Calibration) -> None:
    """The sources' variances add up to each angle's."""
    stds = {s.name: s.rpy_std for s in c.supports if None not in s.rpy_std}
    for index, angle in enumerate(c.budget.angles if c.budget is not None else ()):
        if angle.support in stds:
            stated = stds[angle.support][ANGLES.index(angle.angle)]
            total = np.sqrt(sum(angle.variance.values()))
            _same_std([stated], np.array([total]), "budget", "angles", index, "variance")


def _check_fit(c: Calibration) -> None:
    """p-value and Birge ratio follow from χ² and its degrees of freedom; campaigns add up to it."""
    if c.fit is None:
        return
    chi2, dof = c.fit.chi2, c.fit.dof
    if dof:
        _same(c.fit.p_value, chi2_sf(chi2, dof), "fit", "p_value")
        _same(c.fit.birge, np.sqrt(chi2 / dof), "fit", "birge")
    if c.campaigns:
        _same(chi2, sum(one.chi2 for one in c.campaigns), "fit", "chi2")
        _same(dof, sum(one.dof for one in c.campaigns), "fit", "dof")


def _same(stated: npt.ArrayLike, other: npt.ArrayLike, *place: str | int) -> None:
    """Compare two statements of a value to rounding; a nanometre, a nanonewton."""
    if not np.allclose(stated, other, rtol=SAME, atol=SAME):
        raise fault("is not what the file says elsewhere", *place, hint=ALTERED)


def _same_std(stated: Sequence[float | None], other: FloatArray, *place: str | int) -> None:
    """Compare standard uncertainties; None is open, which a covariance cannot say."""
    values = np.array(stated, dtype=np.float64)  # None becomes no number
    known = np.isfinite(values)
    if not np.allclose(values[known], other[known], rtol=SAME_STD, atol=0):
        raise fault("does not follow from the covariance", *place, hint=ALTERED)
