"""What to do next, from the numbers of a calibration and from why it was rejected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.motion import MotionResult
from tdfscal.significance import INCOMPATIBLE, MOST_REJECTED

_ANGLES = ("roll", "pitch", "yaw")
#: A source worth naming contributes at least this share of the angles' variance.
_NOTABLE = 0.25
_LESSEN = {
    "noise": "More postures, or a harder squeeze, would lower the uncertainty further: noise "
    "dominates.",
    "zero": "A tare just before the campaign would lower the uncertainty: the zeros dominate.",
    "positioner": "A harder squeeze would lower the uncertainty: NCP repeatability dominates.",
    "mass": "Weighing the terminal would lower the uncertainty: its mass dominates.",
    "barycentre": "More tilt, or a better barycentre, would lower the uncertainty: it dominates.",
    "hinge": "Measuring the hinge centres would lower the uncertainty: they dominate.",
    "datum": "Measuring the servo datums would lower the uncertainty: they dominate.",
    "gravity": "Levelling the BCS would lower the uncertainty: the direction of gravity dominates.",
    "sensitivity": "Calibrated gains would lower the uncertainty: the sensitivity dominates.",
    "instrument angles": "A tracker nearer to the rig would lower the uncertainty: its angles "
    "dominate.",
}
#: The same of samples in motion.
_LESSEN_IN_MOTION = {
    "noise": "A longer motion, a larger tilt, or a harder squeeze would lower the uncertainty "
    "further: noise dominates (`tdfscal plan RIG --motion` finds the best motion).",
    "noise spectrum": "A longer motion would lower the uncertainty: how noisy its slow part is "
    "dominates.",
    "positioner": "A harder squeeze, or a faster motion, would lower the uncertainty: the NCPs' "
    "position errors dominate.",
    "motion": "A slower motion, or an inertia, a friction and a delay that are stated, would lower "
    "the uncertainty: what the motion adds dominates.",
}


def advise(c: Calibration) -> tuple[str, ...]:
    """Return sentences in the order in which to act on them."""
    if c.status == "rejected":
        return (
            "Do not load this result into a controller.",
            *_mend(c),
            "Then record again and calibrate again.",
        )
    new = "three to five new postures" if c.motion is None else "the next motion without contact"
    advice = [f"Prove it on {new}: tdfscal validate CALIBRATION LOG. Repeat monthly."]
    shares = _shares(c)
    lessen = _LESSEN if c.motion is None else _LESSEN | _LESSEN_IN_MOTION
    if shares:
        largest = max(shares, key=lambda source: shares[source])
        if shares[largest] > _NOTABLE and largest in lessen:
            advice.append(lessen[largest])
    return tuple(advice)


def _mend(c: Calibration) -> tuple[str, ...]:
    """What may have caused each reason of the gate."""
    limits, fit, found = c.rig.acceptance, c.fit, []
    std = c.rpy_std[c.determined]
    if np.any(std > limits.angle_std):
        i, j = np.unravel_index(int(std.argmax()), std.shape)
        more = (
            "record more postures with more tilt"
            if c.motion is None
            else "move for longer and tilt farther"
        )
        found.append(
            f"Squeeze the NCPs against each other, or {more}: "
            f"{_ANGLES[j]} of {c.mounted[i].name} is the weakest angle."
            if c.method != "tracker"
            else "Measure more targets, farther apart, or from nearer: the angles are too weak."
        )
    named = any("the residuals say that" in reason for reason in c.quality.reasons)
    if c.motion is not None:
        found += _mend_motion(c.motion, c.quality.reasons)
    elif fit is not None and fit.birge > limits.birge_max and not named:
        found.append(
            "Look at the postures one by one: a few bad ones are contact or a jolt; misfit that "
            "grows with time is drift (tare again); misfit everywhere is crosstalk or gain "
            "(declare uncertainty.force_sensitivity), or a wrong mass, hinge or barycentre in "
            "rig.yaml."
        )
    if fit is not None and len(fit.rejected) > MOST_REJECTED * (fit.postures + len(fit.rejected)):
        sensors = [r for r in fit.rejected if "capacity" in r.reason or "frozen" in r.reason]
        if sensors:
            found.append(
                "Squeeze less, or carry less: sensors reached their capacity or froze at the "
                "postures rejected (or correct supports.capacity in rig.yaml)."
            )
        if len(sensors) < len(fit.rejected):
            found.append(
                "Find what touched the terminal at the postures rejected (cables, a hand, a stop) "
                "and free it."
            )
    if any(entry.integrity == "salvaged" for entry in c.inputs):
        found.append("Copy the log from the recorder again; the file is damaged.")
    consistency = c.tracker.get("consistency_p_value") if c.tracker else None
    if isinstance(consistency, float) and consistency < INCOMPATIBLE:
        found.append(
            "Calibrate by each method alone and compare: the tracker sees a sensor's body, "
            "self-calibration its sensing axes (tracker.misalignment states what may lie between)."
        )
    birge = c.tracker.get("birge") if c.tracker else None
    if c.method != "self" and isinstance(birge, float) and birge > limits.birge_max:
        found.append(
            "Look at the tracker's residuals: a moved instrument, a loose target, or "
            "understated uncertainties."
        )
    return tuple(found)


def _mend_motion(motion: MotionResult, reasons: Sequence[str]) -> Iterator[str]:
    """What may have caused the reasons that only a motion has."""
    if any("had to be left out" in reason for reason in reasons):
        touched = any("contact" in stretch.reason for stretch in motion.rejected)
        yield (
            "Find what touched the terminal in the stretches left out (cables, a hand, a stop), "
            "and free it; where nothing did, move more slowly."
            if touched
            else "Squeeze less, or carry less: sensors reached their capacity or froze in the "
            "stretches left out."
        )
    if any("halves of the log" in reason for reason in reasons):
        yield (
            "See what changed while it moved (a screw, a hinge, a warming sensor: declare "
            "drift.time), and calibrate the two halves of the log apart."
        )


def _shares(c: Calibration) -> dict[str, float]:
    """Mean share of each source over the angles."""
    if c.budget is None or not c.budget.sources:
        return {}
    table = np.array([[a.variance[s] for s in c.budget.sources] for a in c.budget.angles])
    total = table.sum(axis=1, keepdims=True)
    share = np.divide(table, total, out=np.zeros_like(table), where=total > 0).mean(axis=0)
    return dict(zip(c.budget.sources, share.tolist(), strict=True))
