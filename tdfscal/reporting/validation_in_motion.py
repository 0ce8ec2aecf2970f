"""The verdict of a validation on a log in motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.reporting.calibration import RESIDUAL_HEADER
from tdfscal.reporting.layout import Items, Report, Section, Table, illustrated
from tdfscal.reporting.validation import (
    KEEP,
    RENEW,
    Origin,
    causes_document,
    describe,
    power,
    sure,
    verdict_document,
    with_origin,
)
from tdfscal.validation.in_motion import MovingValidation

if TYPE_CHECKING:
    from tdfscal.reporting.figures.style import Drawing


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
        **{name: _residual(v, column) for column, name in enumerate(("force", "moment"))},
        **causes_document(v),
        "warnings": list(warnings),
    }


def _residual(v: MovingValidation, column: int) -> dict[str, float]:
    before, after = v.residual.before[:, column], v.residual.after[:, column]
    return {
        "rms_before": float(np.sqrt(np.mean(before**2))),
        "rms_after": float(np.sqrt(np.mean(after**2))),
        "max_before": float(before.max()),
        "max_after": float(after.max()),
    }


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
    force, moment = (_residual(v, column) for column in range(2))
    report = Report(
        title=v.rig.name,
        verdict="STILL VALID" if v.holds else "RECALIBRATE",
        accepted=v.holds,
        claim=" ".join(reasons(v)),
        reasons=tuple(describe(v, cause) for cause in v.suspected),
        tiles=(
            ("in motion", f"{v.seconds:.0f} s", f"tested, {lost:.0f} s left out"),
            ("residual contact force", f"{force['rms_after']:.2g} N",
             f"uncalibrated {force['rms_before']:.3g} N"),
            ("residual contact moment", f"{moment['rms_after']:.2g} N·m",
             f"uncalibrated {moment['rms_before']:.3g} N·m"),
            ("χ² / degrees of freedom", f"{v.chi2 / v.dof:.2f}", f"p = {v.p_value:.2g}"),
        ),
        sections=(
            *illustrated(drawings, {"residual-over-time": (_totals(v),)}),
            Section("Stretches left out", (Items("Left out", left_out),) if left_out else ()),
            power(v, "this motion", "a longer motion, more tilt and a squeeze"),
        ),
        warnings=tuple(warnings),
        advice=KEEP if v.holds else RENEW,
    )  # fmt: skip
    return with_origin(report, v, origin, f"{v.seconds:.0f} s of motion")


def _totals(v: MovingValidation) -> Table:
    """Residual wrench over the log, without and with the calibration."""
    names = ("rms_before", "rms_after", "max_before", "max_after")
    rows = tuple(
        (name, *(f"{_residual(v, column)[key]:.3g} {unit}" for key in names))
        for column, (name, unit) in enumerate((("force", "N"), ("moment", "N·m")))
    )
    caption = "Residual contact wrench, means over a second, about the barycentre"
    return Table(caption, RESIDUAL_HEADER, rows)
