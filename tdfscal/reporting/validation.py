"""The verdict of a validation: does the calibration still hold, and if not, why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal import __version__
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.log_time import origin_of
from tdfscal.records import FloatArray, InputFile
from tdfscal.reporting.calibration import RESIDUAL_HEADER
from tdfscal.reporting.layout import Facts, Items, Report, Row, Section, Table, illustrated
from tdfscal.reporting.phrases import METHODS, inputs_table
from tdfscal.significance import DETECTION_POWER, VALIDATION_ALARM
from tdfscal.validation.causes import Cause, Kind
from tdfscal.validation.in_motion import MovingValidation
from tdfscal.validation.residual_wrench import Validation
from tdfscal.wrench.contact_wrench import COMPONENTS

if TYPE_CHECKING:
    from tdfscal.reporting.figures.style import Drawing

#: At most as many postures are listed one by one.
_LISTED = 12

_LISTED_ON_PAGE = 40
Verdict = Validation | MovingValidation
KEEP = (
    "Keep this calibration in use.",
    "Validate it again in a month, and after every work on a sensor, a hinge or the terminal.",
)
RENEW = (
    "Do not steer by this calibration until the cause is found.",
    "Undo the cause and validate again; where that is not possible, calibrate again.",
)


#: What to do first about the likeliest cause.
_REMEDIES: dict[Kind, str] = {
    "sensor turned": "Look at the mounting of this sensor, then calibrate again.",
    "zero drifted": "Tare, and validate again; if it returns, calibrate again.",
    "gain changed": "Have this sensor, its amplifier and its cable checked; calibrate again with "
    "uncertainty.force_sensitivity declared until then.",
    "load changed": "Correct the load, or the rig file and calibrate again.",
    "base tilted": "Level the base, or calibrate again with gravity.tilt_std declared.",
    "contact": "Free these postures and record them again before anything else.",
    "hinges stick": "See whether the hinges move freely, or state uncertainty.hinge_moment.",
    "noise grown": "Look for what shakes or hums, at cables and amplifiers, or state "
    "uncertainty.force_noise, and validate again.",
}


@dataclass(frozen=True, slots=True)
class Origin:
    """What a validation was made of: calibration and its name, command, time in words, logs."""

    calibration: Calibration
    name: str
    command: str
    created: str
    inputs: tuple[InputFile, ...]


def lengths(wrench: FloatArray) -> FloatArray:
    """Lengths (K, 2) of force and moment of wrenches (K, 6)."""
    return np.asarray(np.linalg.norm(wrench.reshape(-1, 2, 3), axis=2))


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
        **{name: _residual(v, column) for column, name in enumerate(("force", "moment"))},
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


def _residual(v: Validation, column: int) -> dict[str, float]:
    before, after = lengths(v.nominal)[:, column], lengths(v.calibrated)[:, column]
    return {
        "rms_before": float(np.sqrt(np.mean(before**2))),
        "rms_after": float(np.sqrt(np.mean(after**2))),
        "max_before": float(before.max()),
        "max_after": float(after.max()),
    }


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


def describe(v: Verdict, cause: Cause) -> str:
    """One cause in words, with its size."""
    value, std = cause.value, cause.std
    if cause.kind == "sensor turned":
        assert cause.support is not None
        turn = _pairs(1e3 * value, 1e3 * std)
        return (
            f"the sensor of {v.rig.supports[cause.support]} has turned by "
            f"{1e3 * np.linalg.norm(value):.2f} mrad: {turn} mrad about x, y, z of the BCS"
        )
    if cause.kind == "zero drifted":
        assert cause.support is not None
        return (
            f"the zero of {v.rig.supports[cause.support]} has drifted by {_pairs(value, std)} N "
            "along x, y, z of the sensor"
        )
    if cause.kind == "load changed":
        return (
            f"the terminal's mass has changed by {value[0]:+.3f} ± {std[0]:.3f} kg, and its "
            f"barycentre by {_pairs(1e3 * value[1:], 1e3 * std[1:])} mm"
        )
    if cause.kind == "gain changed":
        assert cause.support is not None
        return f"the gain of {v.rig.supports[cause.support]} has changed by {_gain(cause)}"
    if cause.kind == "base tilted":
        return (
            f"the base is no longer level as it was: {_pairs(1e3 * value, 1e3 * std)} mrad about "
            "x, y of the BCS"
        )
    if cause.kind == "noise grown":
        whose = "all sensors" if cause.support is None else v.rig.supports[cause.support]
        return (
            f"the forces of {whose} scatter by {value[0]:.2g} N per axis and posture more than log "
            "and rig file state"
        )
    if cause.kind == "hinges stick":
        return f"the moments scatter as friction of {value[0]:.2g} N·m in the hinges makes them"
    assert isinstance(v, Validation)  # in motion a contact is a stretch that is left out
    named = ", ".join(f"{v.used[k] + 1} ({_start(v, int(v.used[k]))} s)" for k in cause.postures)
    largest = lengths(v.calibrated)[list(cause.postures)].max(axis=0)
    return (
        f"contact in posture{'s' if len(cause.postures) > 1 else ''} {named}: "
        f"{largest[0]:.2g} N, {largest[1]:.2g} N·m"
    )


def _gain(cause: Cause) -> str:
    """Change of a gain, %, by the shape that was fitted."""
    value, std = 100 * cause.value, 100 * cause.std
    moved = np.flatnonzero(std > 0)
    if cause.unknowns == 1:
        where = "on all axes" if len(moved) == 3 else f"along {'xyz'[moved[0]]} of the sensor"
        return f"{value[moved[0]]:+.3f} ± {std[moved[0]]:.3f} % {where}"
    words = "along x, y, z of the sensor" if cause.unknowns == 3 else (
        "along x, y, z of the sensor, with crosstalk yz, xz, xy"
    )  # fmt: skip
    return ", ".join(f"{value[k]:+.3f} ± {std[k]:.3f}" for k in moved) + f" % {words}"


def _pairs(value: FloatArray, std: FloatArray) -> str:
    return ", ".join(f"{a:+.2f} ± {s:.2f}" for a, s in zip(value, std, strict=True))


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
    found.append(_REMEDIES[v.suspected[0].kind])
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


def _start(v: Validation, k: int) -> str:
    """Seconds at which a dwell begins; those of a date count from the first dwell."""
    return f"{v.dwells.start[k] - origin_of(float(v.dwells.start[0])):.1f}"


def validation_report(
    v: Validation,
    warnings: Sequence[str],
    origin: Origin | None = None,
    drawings: tuple[Drawing, ...] = (),
) -> Report:
    """Lay out a verdict; origin and drawings are those of a page."""
    why = tuple(reasons(v))
    postures = (_totals(v), _postures(v, _LISTED_ON_PAGE if drawings else _LISTED))
    left_out = tuple(f"posture {k + 1}: {reason}" for k, reason in sorted(v.left_out.items()))
    report = Report(
        title=v.rig.name,
        verdict="STILL VALID" if v.holds else "RECALIBRATE",
        accepted=v.holds,
        claim=" ".join(why),
        reasons=tuple(describe(v, cause) for cause in v.suspected),
        tiles=_tiles(v),
        sections=(
            *illustrated(drawings, {"validation": postures}),
            Section("Postures left out", (Items("Left out", left_out),) if left_out else ()),
            power(v),
        ),
        warnings=tuple(warnings),
        advice=KEEP if v.holds else RENEW,
    )
    return with_origin(report, v, origin, f"{len(v.used)} postures")


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
        sections=(*report.sections, provenance(v, origin)),
    )


def _totals(v: Validation) -> Table:
    """Residual wrench over all postures, without and with the calibration."""
    names = ("rms_before", "rms_after", "max_before", "max_after")
    rows = tuple(
        (name, *(f"{_residual(v, column)[key]:.3g} {unit}" for key in names))
        for column, (name, unit) in enumerate((("force", "N"), ("moment", "N·m")))
    )
    return Table("Residual contact wrench, LCS, about its origin", RESIDUAL_HEADER, rows)


def _postures(v: Validation, most: int) -> Table:
    """The postures with the largest residual force, in the order of the log."""
    order = np.sort(np.argsort(lengths(v.calibrated)[:, 0])[::-1][:most])
    rows = tuple(
        (
            str(v.used[k] + 1),
            _start(v, int(v.used[k])),
            *(f"{v.calibrated[k, c]:.2f}" for c in range(6)),
            f"{np.max(np.abs(v.calibrated[k]) / v.std[k]):.1f}",
        )
        for k in order
    )
    units = (f"{c} {'N' if c[0] == 'f' else 'N·m'}" for c in COMPONENTS)
    which = f"The {most} worst postures" if len(v.calibrated) > most else "Postures"
    caption = f"{which}, calibrated; u is the standard uncertainty"
    return Table(caption, ("", "s", *units, "largest / u"), rows)


def _tiles(v: Validation) -> tuple[Row, ...]:
    wrench = [
        (
            f"residual contact {name}",
            f"{_residual(v, column)['rms_after']:.2g} {unit}",
            f"uncalibrated {_residual(v, column)['rms_before']:.3g} {unit}",
        )
        for column, (name, unit) in enumerate((("force", "N"), ("moment", "N·m")))
    ]
    return (
        ("postures", f"{len(v.used)} of {len(v.dwells)}", "in the test"),
        *wrench,
        ("χ² / degrees of freedom", f"{v.chi2 / v.dof:.2f}", f"p = {v.p_value:.2g}"),
    )


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


def provenance(v: Verdict, origin: Origin) -> Section:
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
