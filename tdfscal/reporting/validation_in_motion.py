"""The verdict of a validation on a log in motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tdfscal.reporting.layout import Drawing, Items, Report, Section, illustrated
from tdfscal.reporting.validation import (
    Origin,
    causes_document,
    power,
    residual,
    residual_table,
    sure,
    verdict_document,
    verdict_report,
    with_origin,
)
from tdfscal.validation.in_motion import MovingValidation


def document(v: MovingValidation, warnings: Sequence[str]) -> dict[str, Any]:
    """Everything as JSON values, SI units."""
    r = v.residual
    return {
        **verdict_document(v, reasons(v)),
        "motion": {
            "begin": v.begin,
            "seconds": v.seconds,
            "rejected": [{"begin": s.begin, "end": s.end, "reason": s.reason} for s in v.rejected],
            "time": r.time.tolist(),
            "force": {"before": r.before[:, 0].tolist(), "after": r.after[:, 0].tolist()},
            "moment": {"before": r.before[:, 1].tolist(), "after": r.after[:, 1].tolist()},
        },
        **_over_time(v),
        **causes_document(v),
        "warnings": list(warnings),
    }


def _over_time(v: MovingValidation) -> dict[str, dict[str, float]]:
    return residual(v.residual.before, v.residual.after)


def reasons(v: MovingValidation) -> list[str]:
    """Sentences: the reason, and what to do."""
    if v.holds:
        return [
            f"The residual wrench of {v.seconds:.0f} s of motion is what the stated uncertainties "
            f"and the noise of this log explain (p = {v.p_value:.2g}).",
            sure(v, "in this motion"),
        ]
    found = [
        "The residual wrench is not what the stated uncertainties and the noise of this log "
        f"explain: χ² = {v.chi2:.4g} for {v.dof} degrees of freedom (p = {v.p_value:.1g})."
    ]
    if not v.suspected:
        found.append(
            "No single cause explains it: not one sensor turned, one zero drifted, or another load."
        )
    elif v.suspected[0].kind == "load changed":
        found.append("Correct the load, or the rig file and calibrate again.")
    if len(v.suspected) > 1:
        found.append("The motion does not tell these causes apart; record a longer one.")
    return found


def moving_validation_report(
    v: MovingValidation,
    warnings: Sequence[str],
    origin: Origin | None = None,
    drawings: tuple[Drawing, ...] = (),
) -> Report:
    """Lay out a verdict; origin and drawings are those of a page."""
    left_out = tuple(f"{s.begin:.2f} to {s.end:.2f} s: {s.reason}" for s in v.rejected)
    lost = sum(s.end - s.begin for s in v.rejected)
    caption = "Residual contact wrench, means over a second, about the barycentre"
    found = _over_time(v)
    totals = residual_table(found, caption)
    sections = (
        *illustrated(drawings, {"residual-over-time": (totals,)}),
        Section("Stretches left out", (Items("Left out", left_out),) if left_out else ()),
        power(v, "this motion", "a longer motion, more tilt and a squeeze"),
    )
    tile = ("in motion", f"{v.seconds:.0f} s", f"tested, {lost:.0f} s left out")
    report = verdict_report(v, reasons(v), tile, found, sections, warnings)
    return with_origin(report, v, origin, f"{v.seconds:.0f} s of motion")
