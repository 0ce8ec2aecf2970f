"""The verdict of a validation: does the calibration still hold, and if not, why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tdfscal import __version__
from tdfscal.files.calibration.document import Calibration
from tdfscal.records import FloatArray, InputFile
from tdfscal.reporting.calibration import RESIDUAL_HEADER
from tdfscal.reporting.layout import Drawing, Facts, Items, Report, Row, Section, Table, illustrated
from tdfscal.reporting.phrases import METHODS, inputs_table
from tdfscal.reporting.validation_causes import REMEDIES, describe, lengths, start_of
from tdfscal.significance import DETECTION_POWER, VALIDATION_ALARM
from tdfscal.validation.causes import Cause
from tdfscal.validation.residual_wrench import Validation
from tdfscal.validation.verdict import Verdict
from tdfscal.wrench.contact_wrench import COMPONENTS

#: At most as many postures are listed one by one.
_LISTED = 12

_LISTED_ON_PAGE = 40
#: Units of the wrench's two parts.
_UNITS = {"force": "N", "moment": "N·m"}
_KEEP = (
    "Keep this calibration in use.",
    "Validate it again in a month, and after every work on a sensor, a hinge or the terminal.",
)
_RENEW = (
    "Do not steer by this calibration until the cause is found.",
    "Undo the cause and validate again; where that is not possible, calibrate again.",
)


@dataclass(frozen=True, slots=True)
class Origin:
    """What a validation was made of: calibration and its name, command, time in words, logs."""

    calibration: Calibration
    name: str
    command: str
    created: str
    inputs: tuple[InputFile, ...]


def document(v: Validation, warnings: Sequence[str]) -> dict[str, Any]:
    """Everything as JSON values, SI units."""
    return {
        **verdict_document(v, reasons(v)),
        "postures": [
            {
                "index": int(k),
                "start": float(v.dwells.start[k]),
                "end": float(v.dwells.end[k]),
                "uncalibrated": dict(zip(COMPONENTS, v.nominal[row].tolist(), strict=True)),
                "calibrated": dict(zip(COMPONENTS, v.calibrated[row].tolist(), strict=True)),
                "std": [float(s) if np.isfinite(s) else None for s in v.std[row]],
            }
            for row, k in enumerate(v.used)
        ],
        "left_out": [{"index": k, "reason": reason} for k, reason in sorted(v.left_out.items())],
        **_of_postures(v),
        **causes_document(v),
        "warnings": list(warnings),
    }


def verdict_document(v: Verdict, why: Sequence[str]) -> dict[str, Any]:
    """The verdict and its figures."""
    return {
        "verdict": "still valid" if v.holds else "recalibrate",
        "holds": v.holds,
        "why": " ".join(why),
        "chi2": v.chi2,
        "dof": v.dof,
        "p_value": v.p_value,
        "search_p_value": v.search_p,
        "false_alarm": VALIDATION_ALARM,
    }


def causes_document(v: Verdict) -> dict[str, Any]:
    """What is suspected, and what would have been seen."""
    return {
        "suspected": [_cause(v, cause) for cause in v.suspected],
        "detectable_turn": {
            "power": DETECTION_POWER,
            "supports": [
                {"name": name, **_axes(turn)}
                for name, turn in zip(v.rig.supports, v.detectable, strict=True)
            ],
        },
    }


def residual(before: FloatArray, after: FloatArray) -> dict[str, dict[str, float]]:
    """RMS and largest force (N) and moment (N·m) of lengths (K, 2), uncalibrated and calibrated."""
    return {
        name: {
            "rms_before": float(np.sqrt(np.mean(before[:, c] ** 2))),
            "rms_after": float(np.sqrt(np.mean(after[:, c] ** 2))),
            "max_before": float(before[:, c].max()),
            "max_after": float(after[:, c].max()),
        }
        for c, name in enumerate(("force", "moment"))
    }


def residual_table(found: dict[str, dict[str, float]], caption: str) -> Table:
    """Residual wrench, as `residual`, without and with the calibration."""
    rows = tuple(
        (name, *(f"{value:.3g} {unit}" for value in found[name].values()))
        for name, unit in _UNITS.items()
    )
    return Table(caption, RESIDUAL_HEADER, rows)


def _of_postures(v: Validation) -> dict[str, dict[str, float]]:
    return residual(lengths(v.nominal), lengths(v.calibrated))


def _axes(turn: FloatArray) -> dict[str, float | None]:
    values = (float(t) if np.isfinite(t) else None for t in turn)
    return dict(zip(("rx", "ry", "rz"), values, strict=True))


def _cause(v: Verdict, cause: Cause) -> dict[str, Any]:
    return {
        "kind": cause.kind,
        "support": None if cause.support is None else v.rig.supports[cause.support],
        "postures": [int(v.used[k]) for k in cause.postures] if isinstance(v, Validation) else [],
        "value": cause.value.tolist(),
        "std": cause.std.tolist(),
        "chi2_explained": cause.gain,
        "unknowns": cause.unknowns,
        "remaining_p_value": cause.remaining_p,
        "text": describe(v, cause),
    }


def reasons(v: Validation) -> list[str]:
    """Sentences: the reason, and what to do."""
    if v.holds:
        return [
            f"The residual wrenches of {len(v.used)} postures are what the stated uncertainties "
            f"explain (p = {v.p_value:.2g}).",
            sure(v),
        ]
    found = [
        f"The residual wrenches are not what the stated uncertainties explain: χ² = {v.chi2:.4g} "
        f"for {v.dof} degrees of freedom (p = {v.p_value:.1g})."
    ]
    if not v.suspected:
        found.append(
            "No single cause explains them: not one sensor turned, one zero drifted, one gain "
            "changed, another load, a tilted base, contact in a few postures, or more noise."
        )
        return found
    found.append(REMEDIES[v.suspected[0].kind])
    if len(v.suspected) > 1:
        found.append(
            "The postures do not tell the causes below apart, the likeliest first; more of them, "
            "with more tilt and other squeezes, would."
        )
    return found


def sure(v: Verdict, where: str = "in these postures") -> str:
    """What would have been detected."""
    lean, twist = v.detectable[:, :2].max(), v.detectable[:, 2].max()
    text = (
        f"A single sensor turned by more than {1e3 * lean:.2g} mrad in roll or pitch would have "
        f"been detected with {DETECTION_POWER:.0%} probability"
    )
    if twist > np.pi / 4:
        return f"{text}; a turn about the vertical would not show {where}."
    return f"{text}, about the vertical by more than {1e3 * twist:.2g} mrad."


def validation_report(
    v: Validation,
    warnings: Sequence[str],
    origin: Origin | None = None,
    drawings: tuple[Drawing, ...] = (),
) -> Report:
    """Lay out a verdict; origin and drawings are those of a page."""
    found = _of_postures(v)
    totals = residual_table(found, "Residual contact wrench, LCS, about its origin")
    postures = (totals, _postures(v, _LISTED_ON_PAGE if drawings else _LISTED))
    left_out = tuple(f"posture {k + 1}: {reason}" for k, reason in sorted(v.left_out.items()))
    sections = (
        *illustrated(drawings, {"validation": postures}),
        Section("Postures left out", (Items("Left out", left_out),) if left_out else ()),
        power(v),
    )
    tile = ("postures", f"{len(v.used)} of {len(v.dwells)}", "in the test")
    report = verdict_report(v, reasons(v), tile, found, sections, warnings)
    return with_origin(report, v, origin, f"{len(v.used)} postures")


def verdict_report(
    v: Verdict,
    why: Sequence[str],
    tile: Row,
    found: dict[str, dict[str, float]],
    sections: tuple[Section, ...],
    warnings: Sequence[str],
) -> Report:
    """Lay out a verdict with its evidence; tile : what was tested. found : as `residual`."""
    tiles = (
        (
            f"residual contact {name}",
            f"{found[name]['rms_after']:.2g} {unit}",
            f"uncalibrated {found[name]['rms_before']:.3g} {unit}",
        )
        for name, unit in _UNITS.items()
    )
    ratio = ("χ² / degrees of freedom", f"{v.chi2 / v.dof:.2f}", f"p = {v.p_value:.2g}")
    return Report(
        title=v.rig.name,
        verdict="STILL VALID" if v.holds else "RECALIBRATE",
        accepted=v.holds,
        claim=" ".join(why),
        reasons=tuple(describe(v, cause) for cause in v.suspected),
        tiles=(tile, *tiles, ratio),
        sections=sections,
        warnings=tuple(warnings),
        advice=_KEEP if v.holds else _RENEW,
    )


def with_origin(report: Report, v: Verdict, origin: Origin | None, extent: str) -> Report:
    """Say of which calibration it is, on how much of a log, and what went into it."""
    if origin is None:
        return report
    c = origin.calibration
    return replace(
        report,
        subtitle=f"validation of {origin.name}, a {METHODS[c.method]} of {c.created[:10]}, on "
        f"{extent}",
        created=origin.created,
        sections=(*report.sections, _provenance(v, origin)),
    )


def _postures(v: Validation, most: int) -> Table:
    """The postures with the largest residual force, in the order of the log."""
    order = np.sort(np.argsort(lengths(v.calibrated)[:, 0])[::-1][:most])
    rows = tuple(
        (
            str(v.used[k] + 1),
            start_of(v, int(v.used[k])),
            *(f"{v.calibrated[k, c]:.2f}" for c in range(6)),
            f"{np.max(np.abs(v.calibrated[k]) / v.std[k]):.1f}",
        )
        for k in order
    )
    units = (f"{c} {'N' if c[0] == 'f' else 'N·m'}" for c in COMPONENTS)
    which = f"The {most} worst postures" if len(v.calibrated) > most else "Postures"
    caption = f"{which}, calibrated; u is the standard uncertainty"
    return Table(caption, ("", "s", *units, "largest / u"), rows)


def power(
    v: Verdict, what: str = "these postures", more: str = "more postures, more tilt and a squeeze"
) -> Section:
    """The smallest turns that would have been seen."""
    rows = tuple(
        (name, *("none" if not np.isfinite(t) else f"{1e3 * t:.2f}" for t in turn))
        for name, turn in zip(v.rig.supports, v.detectable, strict=True)
    )
    return Section(
        f"What {what} would have shown",
        (Table("Turn about the BCS's axes, mrad", ("sensor", "x", "y", "z"), rows),),
        "The smallest turn of a single sensor that is detected with a probability of "
        f"{DETECTION_POWER:.0%}; {more} make it smaller.",
        page_only=True,
    )


def _provenance(v: Verdict, origin: Origin) -> Section:
    """The calibration, the test and the logs."""
    c = origin.calibration
    facts = (
        ("Calibration", f"{origin.name}, {METHODS[c.method]}, {c.created}, {c.status}"),
        ("Command", origin.command),
        ("Created", origin.created),
        ("Software", f"tdfscal {__version__}"),
        ("Test", f"χ² = {v.chi2:.4g} for {v.dof} degrees of freedom, p = {v.p_value:.2g}"),
        ("Single causes", f"the likeliest by chance alone: p = {v.search_p:.2g}"),
        ("Convention", c.convention),
    )
    blocks = (Facts(facts), inputs_table(origin.inputs, "Logs"))
    return Section("Where this result comes from", blocks, page_only=True)
