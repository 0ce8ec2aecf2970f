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
from tdfscal.findings import Finding
from tdfscal.records import FloatArray, InputFile
from tdfscal.reporting import phrases
from tdfscal.reporting.layout import (
    Block,
    Drawing,
    Facts,
    Items,
    Report,
    Section,
    Table,
    illustrated,
)
from tdfscal.reporting.phrases import METHODS, chi_squared
from tdfscal.reporting.validation_causes import change, lengths, start_of
from tdfscal.significance import DETECTION_POWER, VALIDATION_ALARM
from tdfscal.validation.causes import Cause
from tdfscal.validation.in_motion import MovingValidation
from tdfscal.validation.residual_wrench import Validation
from tdfscal.wrench.contact_wrench import COMPONENTS

#: At most as many postures are listed one by one, in text and on a page.
_LISTED, _LISTED_ON_PAGE = 12, 40
_KEEP = (
    "Keep this calibration in use.",
    "Validate it again in a month, and after every work on a sensor, a hinge or the terminal.",
)
_TAKE_ZEROS = (
    "Bring the new zeros in before it is used: tdfscal update CALIBRATION CAMPAIGN -o NEW.",
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


def document(v: Tested, findings: Sequence[Finding]) -> dict[str, Any]:
    """Everything as JSON values, SI units."""
    return {
        "verdict": "still valid" if v.holds else "recalibrate",
        "holds": v.holds,
        "why": " ".join(reasons(v)),
        "chi2": v.chi2,
        "dof": v.dof,
        "p_value": v.p_value,
        "search_p_value": v.search_p,
        "false_alarm": VALIDATION_ALARM,
        **(_motion(v) if isinstance(v, MovingValidation) else _postures(v)),
        **{name: w.model_dump() for name, w in _residual(v).items()},
        "zeros": {
            "moved": v.zeros.moved,
            "supports": [
                {
                    "name": name,
                    "change": _finite(np.where(told, change, np.inf)),
                    "std": _finite(std),
                }
                for name, change, std, told in zip(
                    v.rig.supports,
                    v.zeros.change,
                    v.zeros.change_std,
                    np.isfinite(v.zeros.change_std),
                    strict=True,
                )
            ],
        },
        "suspected": [_cause(v, cause) for cause in v.suspected],
        "detectable_turn": {
            "power": DETECTION_POWER,
            "supports": [
                {"name": name, **dict(zip(("rx", "ry", "rz"), _finite(turn), strict=True))}
                for name, turn in zip(v.rig.supports, v.detectable, strict=True)
            ],
        },
        "findings": documents([*changes(v), *findings]),
    }


def _postures(v: Validation) -> dict[str, Any]:
    return {
        "postures": [
            {
                "index": int(k),
                "start": float(v.dwells.start[k]),
                "end": float(v.dwells.end[k]),
                "uncalibrated": dict(zip(COMPONENTS, v.nominal[row].tolist(), strict=True)),
                "calibrated": dict(zip(COMPONENTS, v.calibrated[row].tolist(), strict=True)),
                "std": _finite(v.std[row]),
            }
            for row, k in enumerate(v.used)
        ],
        "left_out": [
            {"index": k, "code": why.code, "reason": sentence(why)}
            for k, why in sorted(v.left_out.items())
        ],
    }


def _motion(v: MovingValidation) -> dict[str, Any]:
    r = v.residual
    return {
        "motion": {
            "begin": v.begin,
            "seconds": v.seconds,
            "rejected": [
                {
                    "begin": s.begin,
                    "end": s.end,
                    "code": s.reason.code,
                    "reason": sentence(s.reason),
                }
                for s in v.rejected
            ],
            "time": r.time.tolist(),
            "force": {"before": r.before[:, 0].tolist(), "after": r.after[:, 0].tolist()},
            "moment": {"before": r.before[:, 1].tolist(), "after": r.after[:, 1].tolist()},
        }
    }


def _residual(v: Tested) -> dict[str, ResidualWrench]:
    if isinstance(v, MovingValidation):
        before, after = v.residual.before, v.residual.after
    else:
        before, after = lengths(v.nominal), lengths(v.calibrated)
    return {
        name: ResidualWrench(
            rms_before=np.sqrt(np.mean(before[:, c] ** 2)),
            rms_after=np.sqrt(np.mean(after[:, c] ** 2)),
            max_before=before[:, c].max(),
            max_after=after[:, c].max(),
        )
        for c, name in enumerate(("force", "moment"))
    }


def _finite(values: FloatArray) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]


def _cause(v: Tested, cause: Cause) -> dict[str, Any]:
    return {
        "kind": cause.kind,
        "support": None if cause.support is None else v.rig.supports[cause.support],
        "postures": [int(v.used[k]) for k in cause.postures] if isinstance(v, Validation) else [],
        "value": cause.value.tolist(),
        "std": cause.std.tolist(),
        "chi2_explained": cause.gain,
        "unknowns": cause.unknowns,
        "remaining_p_value": cause.remaining_p,
        "text": sentence(change(v, cause)),
    }


def _extent(v: Tested) -> str:
    """How much was tested."""
    if isinstance(v, MovingValidation):
        return f"{v.seconds:.0f} s of motion"
    return f"{len(v.used)} postures"


def reasons(v: Tested) -> list[str]:
    """Sentences: the reason, and what to do."""
    moving = isinstance(v, MovingValidation)
    noise = " and the noise of this log" if moving else ""
    explained = f"what the stated uncertainties{noise} explain"
    if v.holds:
        held = f"The residual wrench of {_extent(v)} is {explained} (p = {v.p_value:.2g})."
        return [held, *_zeros_moved(v), _sure(v)]
    found = [
        f"The residual wrench of {_extent(v)} is not {explained}: "
        f"{chi_squared(v.chi2, v.dof, v.p_value)}.",
        *_zeros_moved(v),
    ]
    if not v.suspected:
        more = "one gain changed, a tilted base, contact in a few postures, or more noise"
        tried = f"one zero drifted, {'or another load' if moving else f'another load, {more}'}"
        return [*found, f"No single cause explains it: not one sensor turned, {tried}."]
    remedy = cure(change(v, v.suspected[0]))
    found.append(f"{remedy[0].upper()}{remedy[1:]}.")
    if len(v.suspected) > 1:
        found.append(
            f"The {'motion does' if moving else 'postures do'} not tell the causes below apart, "
            f"the likeliest first; {_more(v)} would."
        )
    return found


def _zeros_moved(v: Tested) -> tuple[str, ...]:
    """Say so where the zeros are not those of the calibration, and what brings the new ones."""
    if not v.zeros.moved:
        return ()
    most = np.abs(v.zeros.change[np.isfinite(v.zeros.change_std)]).max()
    return (
        f"The zeros have moved since the calibration, by up to {most:.2g} N, as a tare moves them; "
        "`tdfscal update` brings the new ones.",
    )


def _zero_table(v: Tested) -> Section:
    """By how much the zeros have moved, each sensor."""
    if not v.zeros.moved:
        return Section("")
    rows = tuple(
        (
            name,
            *(
                f"{a:+.2f} ± {u:.2f}" if np.isfinite(u) else "unknown"
                for a, u in zip(change, std, strict=True)
            ),
        )
        for name, change, std in zip(
            v.rig.supports, v.zeros.change, v.zeros.change_std, strict=True
        )
    )
    caption = "Change of the zeros since the calibration, N, sensor frames"
    return Section("Zeros", (Table(caption, ("sensor", "x", "y", "z"), rows),))


def changes(v: Tested) -> list[Finding]:
    """Return what has changed since the calibration, the likeliest first."""
    found = []
    if v.zeros.moved:
        most = float(np.abs(v.zeros.change[np.isfinite(v.zeros.change_std)]).max())
        found.append(Finding("zeros-moved", size=most, unit="N"))
    found += [change(v, cause, tied=k > 0) for k, cause in enumerate(v.suspected)]
    if not v.holds and not v.suspected:
        found.append(Finding("change-unexplained", p_value=v.p_value, rejects=True))
    return found


def _more(v: Tested) -> str:
    """What would show a smaller change."""
    longer = "a longer motion" if isinstance(v, MovingValidation) else "more postures"
    return f"{longer}, more tilt and a squeeze"


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
    beside: tuple[Block, ...]
    if isinstance(v, MovingValidation):
        lost = sum(s.end - s.begin for s in v.rejected)
        tested = ("in motion", f"{v.seconds:.0f} s", f"tested, {lost:.0f} s left out")
        figure, where = "residual-over-time", "means over a second, about the barycentre"
        left_out = phrases.stretches(v.rejected)
        beside = ()
    else:
        tested = ("postures", f"{len(v.used)} of {len(v.dwells)}", "in the test")
        figure, where = "validation", "LCS, about its origin"
        left_out = tuple(
            f"posture {k + 1}: {sentence(why)}" for k, why in sorted(v.left_out.items())
        )
        beside = (_posture_table(v, _LISTED_ON_PAGE if drawings else _LISTED),)
    table = phrases.residual_table(found, where)
    left_out_items = (Items("Left out", left_out),) if left_out else ()
    report = Report(
        title=v.rig.name,
        verdict="STILL VALID" if v.holds else "RECALIBRATE",
        accepted=v.holds,
        claim=" ".join(reasons(v)),
        reasons=tuple(sentence(change(v, cause)) for cause in v.suspected),
        tiles=(
            tested,
            *phrases.residual_tiles(found),
            ("χ² / degrees of freedom", f"{v.chi2 / v.dof:.2f}", f"p = {v.p_value:.2g}"),
        ),
        summary=(table, *_zero_table(v).blocks),
        sections=(
            *illustrated(drawings, {figure: (table, *beside)}),
            _zero_table(v),
            Section("Left out", left_out_items),
            _power(v),
        ),
        warnings=tuple(map(told, findings)),
        advice=(*(_TAKE_ZEROS if v.zeros.moved else ()), *_KEEP) if v.holds else _RENEW,
    )  # fmt: skip
    if origin is None:
        return report
    c = origin.calibration
    return replace(
        report,
        subtitle=f"validation of {origin.name}, a {METHODS[c.method]} of {c.created[:10]}, on "
        f"{_extent(v)}",
        created=origin.created,
        sections=(*report.sections, _provenance(v, origin)),
    )


def _posture_table(v: Validation, most: int) -> Table:
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


def _power(v: Tested) -> Section:
    """The smallest turns that would have been seen."""
    rows = tuple(
        (name, *("none" if t is None else f"{1e3 * t:.2f}" for t in _finite(turn)))
        for name, turn in zip(v.rig.supports, v.detectable, strict=True)
    )
    moving = isinstance(v, MovingValidation)
    return Section(
        f"What {'this motion' if moving else 'these postures'} would have shown",
        (Table("Turn about the BCS's axes, mrad", ("sensor", "x", "y", "z"), rows),),
        "The smallest turn of a single sensor that is detected with a probability of "
        f"{DETECTION_POWER:.0%}; {_more(v)} make it smaller.",
        page_only=True,
    )


def _provenance(v: Tested, origin: Origin) -> Section:
    """The calibration, the test and the logs."""
    c = origin.calibration
    facts = (
        ("Calibration", f"{origin.name}, {METHODS[c.method]}, {c.created}, {c.status}"),
        ("Command", origin.command),
        ("Created", origin.created),
        ("Software", f"tdfscal {__version__}"),
        ("Test", chi_squared(v.chi2, v.dof, v.p_value)),
        ("Single causes", f"the likeliest by chance alone: p = {v.search_p:.2g}"),
        ("Convention", c.convention),
    )
    blocks = (Facts(facts), phrases.inputs_table(origin.inputs, "Logs"))
    return Section("Where this result comes from", blocks, page_only=True)
