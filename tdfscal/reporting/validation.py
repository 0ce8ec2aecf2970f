"""The verdict of a validation, on postures or on a motion: does it still hold, and if not, why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tdfscal import __version__
from tdfscal.catalogue import cure, documents, sentence, told
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import ResidualWrench
from tdfscal.findings import Finding, Value
from tdfscal.records import FloatArray, InputFile
from tdfscal.reporting import layout
from tdfscal.reporting.figures.log_time import clock_from
from tdfscal.reporting.layout import Drawing, Report, Section, Table, chi_squared
from tdfscal.significance import DETECTION_POWER, VALIDATION_ALARM
from tdfscal.validation.causes import NOISE, Cause
from tdfscal.validation.in_motion import MovingValidation
from tdfscal.validation.residual_wrench import Validation
from tdfscal.wrench.contact_wrench import COMPONENTS

#: At most as many postures are listed one by one, in text and on a page.
_LISTED, _LISTED_ON_PAGE = 12, 40
_KEEP = (
    "Keep this calibration in use.",
    "Validate it again in a month, and after every work on a sensor, a hinge or the terminal.",
)
_RENEW = (
    "Do not steer by this calibration until the cause is found.",
    "Undo the cause and validate again; where that is not possible, calibrate again.",
)
Tested = Validation | MovingValidation


@dataclass(frozen=True, slots=True)
class Origin:
    """What a validation was made of: calibration and its name, command, time in words, logs."""

    calibration: Calibration
    name: str
    command: str
    created: str
    inputs: tuple[InputFile, ...]


def changes(v: Tested) -> list[Finding]:
    """Return what has changed since the calibration, the likeliest first."""
    found = []
    if v.zeros.moved:
        most = np.abs(v.zeros.change[np.isfinite(v.zeros.change_std)]).max()
        found.append(Finding("zeros-moved", size=float(most), unit="N"))
    found += [change(v, cause, tied=k > 0) for k, cause in enumerate(v.suspected)]
    if not v.holds and not v.suspected:
        found.append(Finding("change-unexplained", p_value=v.p_value, rejects=True))
    return found


def change(v: Tested, cause: Cause, *, tied: bool = False) -> Finding:
    """Return one cause with its size; tied : it is not told apart from a likelier one."""
    value, std = cause.value.tolist(), cause.std.tolist()
    support = None if cause.support is None else v.rig.supports[cause.support]
    values: dict[str, Value] = {
        "tied": tied, "whose": support or "all sensors", "change": value, "change_std": std
    }  # fmt: skip
    size, unit = None, ""
    match cause.kind:
        case "sensor turned":
            size, unit = float(np.linalg.norm(cause.value)), "rad"
        case "zero drifted":
            values["stated"] = v.zeros.moved
        case "load changed":
            values |= {"mass": value[0], "mass_std": std[0]}
            values |= {"barycentre": value[1:], "barycentre_std": std[1:]}
        case "gain changed":
            values |= _gain(cause)
        case "contact":
            assert isinstance(v, Validation)  # in motion a contact is a stretch that is left out
            force, moment = _lengths(v.calibrated)[list(cause.postures)].max(axis=0)
            size, unit = float(force), "N"
            which = [int(v.used[k]) for k in cause.postures]
            values["postures"] = [f"{k + 1} ({_start(v, k)} s)" for k in which]
            values |= {"more": len(which) > 1, "torque": float(moment)}
    if cause.kind in NOISE:
        size, unit = value[0], "N·m" if cause.kind == "hinges stick" else "N"
    subject = () if support is None else (support,)
    code = f"change-{cause.kind.removesuffix(' changed').replace(' ', '-')}"
    return Finding(code, subject, size, unit, cause.p_value, values=values, rejects=True)


def _gain(cause: Cause) -> dict[str, Value]:
    """Change of a gain, %, by the shape that was fitted."""
    moved = np.flatnonzero(cause.std > 0)
    axes = ["xyz"[k] for k in moved if k < 3]
    if cause.unknowns == 1:
        moved = moved[:1]
    return {
        "change": (100 * cause.value[moved]).tolist(),
        "change_std": (100 * cause.std[moved]).tolist(),
        "axes": axes,
        "alike": cause.unknowns == 1 and len(axes) > 1,
        "crosstalk": cause.unknowns > 3,
    }


def validation_document(v: Tested, findings: Sequence[Finding]) -> dict[str, Any]:
    """Everything as JSON values, SI units."""
    parts = _of_the_motion(v) if isinstance(v, MovingValidation) else _of_the_postures(v)
    told = np.isfinite(v.zeros.change_std)
    moved = np.where(told, v.zeros.change, np.inf)
    turns = zip(("rx", "ry", "rz"), v.detectable.T, strict=True)
    return layout.document(
        v,
        "holds chi2 dof p_value search_p_value=search_p",
        verdict="still valid" if v.holds else "recalibrate",
        why=" ".join(_reasons(v)),
        false_alarm=VALIDATION_ALARM,
        **parts,
        **{name: w.model_dump() for name, w in _residual(v).items()},
        zeros={
            "moved": v.zeros.moved,
            "supports": layout.each_named(v.rig.supports, change=moved, std=v.zeros.change_std),
        },
        suspected=[
            layout.document(
                cause,
                "kind value std chi2_explained=gain unknowns remaining_p_value=remaining_p",
                support=None if cause.support is None else v.rig.supports[cause.support],
                postures=[v.used[k] for k in cause.postures] if isinstance(v, Validation) else [],
                text=sentence(change(v, cause)),
            )
            for cause in v.suspected
        ],
        detectable_turn={
            "power": DETECTION_POWER,
            "supports": layout.each_named(v.rig.supports, **dict(turns)),
        },
        findings=documents([*changes(v), *findings]),
    )


def _of_the_postures(v: Validation) -> dict[str, Any]:
    wrenches = {"uncalibrated": v.nominal, "calibrated": v.calibrated}
    return {
        "postures": [
            {
                "index": k,
                "start": v.dwells.start[k],
                "end": v.dwells.end[k],
                **{n: dict(zip(COMPONENTS, w[row], strict=True)) for n, w in wrenches.items()},
                "std": v.std[row],
            }
            for row, k in enumerate(v.used)
        ],
        "left_out": [
            {"index": k, "code": why.code, "reason": sentence(why)}
            for k, why in sorted(v.left_out.items())
        ],
    }


def _of_the_motion(v: MovingValidation) -> dict[str, Any]:
    r = v.residual
    left_out = [
        {"begin": s.begin, "end": s.end, "code": s.reason.code, "reason": sentence(s.reason)}
        for s in v.rejected
    ]
    both: dict[str, Any] = {"rejected": left_out, "time": r.time}
    for k, name in enumerate(("force", "moment")):
        both[name] = {"before": r.before[:, k], "after": r.after[:, k]}
    return {"motion": layout.document(v, "begin seconds", **both)}


def _residual(v: Tested) -> dict[str, ResidualWrench]:
    if isinstance(v, MovingValidation):
        before, after = v.residual.before, v.residual.after
    else:
        before, after = _lengths(v.nominal), _lengths(v.calibrated)
    return {
        name: ResidualWrench(
            rms_before=np.sqrt(np.mean(before[:, c] ** 2)),
            rms_after=np.sqrt(np.mean(after[:, c] ** 2)),
            max_before=before[:, c].max(),
            max_after=after[:, c].max(),
        )
        for c, name in enumerate(("force", "moment"))
    }


def _extent(v: Tested) -> str:
    """How much was tested."""
    if isinstance(v, MovingValidation):
        return f"{v.seconds:.0f} s of motion"
    return f"{len(v.used)} postures"


def _reasons(v: Tested) -> list[str]:
    """Sentences: the reason, and what to do."""
    moving = isinstance(v, MovingValidation)
    noise = " and the noise of this log" if moving else ""
    explained = f"what the stated uncertainties{noise} explain"
    zeros = [layout.begun(told(f), ".") for f in changes(v) if f.code == "zeros-moved"]
    if v.holds:
        held = f"The residual wrench of {_extent(v)} is {explained} ({layout.p_value(v.p_value)})."
        return [held, *zeros, _sure(v)]
    found = [
        f"The residual wrench of {_extent(v)} is not {explained}: "
        f"{chi_squared(v.chi2, v.dof, v.p_value)}.",
        *zeros,
    ]
    if not v.suspected:
        return [*found, "No single change, of a sensor, a zero or the load, explains it."]
    found.append(layout.begun(cure(change(v, v.suspected[0])), "."))
    if len(v.suspected) > 1:
        found.append(
            f"{'The motion does' if moving else 'The postures do'} not tell the causes below "
            f"apart; {'a longer motion' if moving else 'more postures'}, more tilt and a squeeze "
            "would."
        )
    return found


def _sure(v: Tested) -> str:
    """What would have been detected."""
    lean, twist = v.detectable[:, :2].max(), v.detectable[:, 2].max()
    text = (
        f"A single sensor turned by more than {1e3 * lean:.2g} mrad in roll or pitch would have "
        f"been detected with {DETECTION_POWER:.0%} probability"
    )
    if twist > np.pi / 4:
        return f"{text}; a turn about the vertical would not show here."
    return f"{text}, about the vertical by more than {1e3 * twist:.2g} mrad."


def validation_report(
    v: Tested,
    findings: Sequence[Finding],
    origin: Origin | None = None,
    drawings: tuple[Drawing, ...] = (),
) -> Report:
    """Lay out a verdict; origin and drawings are those of a page."""
    found = _residual(v)
    beside: tuple[Table, ...] = ()
    if isinstance(v, MovingValidation):
        lost = sum(s.end - s.begin for s in v.rejected)
        tested = ("in motion", f"{v.seconds:.0f} s", f"tested, {lost:.0f} s left out")
        table = layout.residual_table(found, "means over a second, about the barycentre")
        figure = "residual-over-time"
        left_out = layout.stretches(v.rejected)
    else:
        tested = ("postures", f"{len(v.used)} of {len(v.dwells)}", "in the test")
        table = layout.residual_table(found, "LCS, about its origin")
        beside = (_posture_table(v, _LISTED_ON_PAGE if drawings else _LISTED),)
        figure = "validation"
        left_out = tuple(
            f"posture {k + 1}: {sentence(why)}" for k, why in sorted(v.left_out.items())
        )
    zeros = _zero_table(v)
    report = Report(
        title=v.rig.name,
        verdict="STILL VALID" if v.holds else "RECALIBRATE",
        accepted=v.holds,
        claim=" ".join(_reasons(v)),
        reasons=tuple(sentence(change(v, cause)) for cause in v.suspected),
        tiles=(
            tested,
            *layout.residual_tiles(found),
            ("scatter against stated", f"{(v.chi2 / v.dof) ** 0.5:.3g}", layout.p_value(v.p_value)),
        ),
        summary=(table, *zeros),
        sections=(
            *layout.illustrated(drawings, {figure: (table, *beside)}),
            Section("Zeros" if zeros else "", zeros),
            Section("Left out", layout.listed("Left out", left_out)),
        ),
        warnings=tuple(map(told, findings)),
        advice=_KEEP if v.holds else _RENEW,
    )  # fmt: skip
    if origin is None:
        return report
    c = origin.calibration
    return replace(
        report,
        subtitle=f"validation of {origin.name}, a {layout.METHODS[c.method]} of "
        f"{c.created[:10]}, on {_extent(v)}",
        created=origin.created,
        sections=(*report.sections, _provenance(v, origin)),
    )


def _zero_table(v: Tested) -> tuple[Table, ...]:
    """By how much the zeros have moved, each sensor."""
    if not v.zeros.moved:
        return ()
    rows = tuple(
        (name, *(f"{a:+.2f} ± {u:.2f}" if np.isfinite(u) else "unknown"
                 for a, u in zip(change, std, strict=True)))
        for name, change, std in zip(
            v.rig.supports, v.zeros.change, v.zeros.change_std, strict=True
        )
    )  # fmt: skip
    caption = "Change of the zeros since the calibration, N, sensor frames"
    return (Table(caption, ("sensor", "x", "y", "z"), rows),)


def _posture_table(v: Validation, most: int) -> Table:
    """The postures with the largest residual force, in the order of the log."""
    order = np.sort(np.argsort(_lengths(v.calibrated)[:, 0])[::-1][:most])
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


def _provenance(v: Tested, origin: Origin) -> Section:
    """The calibration, the test and the logs."""
    c = origin.calibration
    return layout.provenance(
        ("Calibration", f"{origin.name}, {layout.METHODS[c.method]}, {c.created}, {c.status}"),
        ("Command", origin.command),
        ("Created", origin.created),
        ("Software", f"tdfscal {__version__}"),
        ("Test", chi_squared(v.chi2, v.dof, v.p_value)),
        ("Single causes", f"the likeliest by chance alone: {layout.p_value(v.search_p)}"),
        ("Convention", c.convention),
        inputs=origin.inputs,
    )


def _start(v: Validation, k: int) -> str:
    """Seconds at which a dwell begins; those of a date count from the first dwell."""
    return f"{v.dwells.start[k] - clock_from(float(v.dwells.start[0])).origin:.1f}"


def _lengths(wrench: FloatArray) -> FloatArray:
    """Lengths (K, 2) of force and moment of wrenches (K, 6)."""
    return np.asarray(np.linalg.norm(wrench.reshape(-1, 2, 3), axis=2))
