"""What a self-calibration is: its record, what its user must know; what is seen without angles;
what another campaign would make of it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.estimation.exact_quantities import exact_caveats
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.judged import HeldOut, Judged
from tdfscal.estimation.observability import (
    ENOUGH,
    Observability,
    Prospect,
    prospect,
)
from tdfscal.estimation.uncertainty import Estimate, Quality
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import sensing
from tdfscal.model.statics import internal_part
from tdfscal.records import Dwells, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.estimator import Fit, at_state
from tdfscal.significance import MISFIT, OF_CAPACITY, OVERSTATED_NOISE

Estimator = Literal["ml", "linear"]


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


@record
class Undetermined:
    """A fit whose angles do not stand, and what can be looked at beside them.

    dwells : all that were found. rejected : dwell index → reason.
    """

    rig: Rig
    dwells: Dwells
    fit: Fit
    quality: Quality
    observability: Observability
    rejected: dict[int, Finding]


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


#: Postures that a campaign is easily given besides; N, what a tare just before it leaves.
_MORE, _TARED = 5.0, 0.1
#: How much harder it is squeezed.
HARDER = 2.0


def prospects(of: Estimate[Fit]) -> tuple[Prospect, ...]:
    """What a few postures more, a harder squeeze, or a tare just before would bring."""
    fit, rig = of.fit, of.fit.rig
    used = int((fit.weight > 0).sum())
    found = [prospect(of, "postures", _MORE, count=(used + _MORE) / used)]
    if (squeezed := _squeezed(fit)) is not None:
        size, harder = squeezed
        found.append(prospect(of, "squeeze", size, rows=harder.factor))
    if np.any(rig.zero.std > 2 * _TARED):
        zero = UncertainValue(rig.zero.value, np.minimum(rig.zero.std, _TARED))
        tared = Priors(replace(rig, zero=zero), fit.postures.motion)(fit.state)[1]
        found.append(prospect(of, "tare", _TARED, priors=tared))
    return tuple(found)


def _squeezed(fit: Fit) -> tuple[float, Fit] | None:
    """The same postures with larger internal forces; None where a sensor would be full."""
    seen, M = fit.postures, sensing(fit.state)
    force = np.einsum("nab,knb->kna", M, seen.force - fit.state.zero)
    arm = seen.position - fit.state.datum
    inside = internal_part(arm - arm.mean(axis=1, keepdims=True), force)
    more = np.einsum("nab,knb->kna", np.linalg.inv(M), (HARDER - 1.0) * inside)
    reading = np.where(seen.measured, seen.force + more, 0.0)
    if not np.all(seen.measured) or np.any(np.abs(reading) > OF_CAPACITY * fit.rig.capacity):
        return None
    size = HARDER * float(np.median(np.linalg.norm(inside, axis=2).max(axis=1)))
    harder = replace(seen, force=reading)
    return size, at_state(fit.rig, harder, fit.state, fit.weight)
