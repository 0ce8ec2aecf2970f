"""The verdict of a validation, on postures or on a motion: does it still hold, and if not, why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.catalogue import sentence, told
from tdfscal.catalogue.numbers import p_text, rounded
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import ResidualWrench
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.numerics.streams import covered
from tdfscal.reporting import layout
from tdfscal.reporting.claims import (
    change,
    changes,
    chi2_test,
    extent,
    lengths,
    reasons,
    search_test,
)
from tdfscal.reporting.layout import Drawing, Report, Section
from tdfscal.reporting.traceability import (
    FIXED,
    Making,
    calibration_fact,
    campaign,
    day_measured,
    exact_names,
    measured_on,
    report_digest,
    stated_facts,
)
from tdfscal.significance import (
    DETECTION_POWER,
    VALIDATION_ALARM,
    VALIDATION_CHI2,
    VALIDATION_SEARCH,
)
from tdfscal.validation.in_motion import MovingValidation
from tdfscal.validation.residual_wrench import Validation
from tdfscal.wrench.contact_wrench import COMPONENTS

#: Causes that are told, where the log does not tell them apart.
_CAUSES = 3
_RULE = (
    "still valid where neither χ² nor the search for a single change falls below its limit; both "
    f"limits together reject {VALIDATION_ALARM:.1%} of calibrations that hold{FIXED}"
)

if TYPE_CHECKING:
    from tdfscal.reporting.claims import Tested

#: Verdict, and what next, by the outcome.
_SAID = {
    "holds": (
        "still valid",
        (
            "Keep this calibration in use.",
            "Validate it again in a month, and after every work on a sensor, a hinge or the "
            "terminal.",
        ),
    ),
    "touched": (
        "record again",
        (
            "Free what was touched and record this check again, before anything else.",
            "Until then it says nothing of the calibration, neither for it nor against it.",
        ),
    ),
    "changed": (
        "recalibrate",
        (
            "Do not steer by this calibration until the cause is found.",
            "Undo the cause and validate again; where that is not possible, calibrate again.",
        ),
    ),
}
_REJECTED = (
    "Mend what the quality gate names and calibrate again: a rejected calibration is not fit for "
    "use, whatever a check says."
)
_ANOTHER = "Validate on a log that did not go into the calibration."
_LATER = "Validate on a log recorded since the calibration: only that shows whether it holds."
_MORE = "Record six postures or more, with squeezes: these are too few to call it still valid."
_SHARPER = (
    "Check again with more postures, tilt and squeezes, and state no more noise or drift than "
    "there is."
)


@record
class Origin:
    """What a validation was made of: calibration and its name, rig and time of the log."""

    calibration: Calibration
    name: str
    rig: LoadedRig
    measured: MeasuredResult
    making: Making

    def document(self) -> dict[str, Any]:
        """Return it as plain JSON values."""
        c = self.calibration
        own = c.model_dump(mode="json", include={"method", "status", "created", "measured"})
        own |= {"name": self.name, "content_sha256": report_digest(c)}
        return {
            **self.making.document(),
            "measured": self.measured.model_dump(),
            "rig": {**self.rig.document, "sha256": self.rig.sha256},
            "calibration": own | {"taken_as_exact": [q.name for q in c.taken_as_exact]},
        }


def validation_document(
    v: Tested, findings: Sequence[Finding], origin: Origin | None = None
) -> dict[str, Any]:
    """Everything as JSON values, SI units."""
    parts = _of_the_motion(v) if isinstance(v, MovingValidation) else _of_the_postures(v)
    told = np.isfinite(v.zeros.change_std)
    moved = np.where(told, v.zeros.change, np.inf)
    turns = zip(("rx", "ry", "rz"), v.detectable.T, strict=True)
    return layout.document(
        v,
        "holds chi2 dof",
        p_value=v.judged.p_value,
        search_p_value=v.judged.search_p,
        verdict=_verdict(v)[0],
        why=" ".join(_why(v, findings)),
        decided_by="search" if v.decided_by_search else "chi2",
        search_limit=VALIDATION_SEARCH,
        chi2_limit=VALIDATION_CHI2,
        chi2_noise_dof=v.judged.noise_dof,
        false_alarm=VALIDATION_ALARM,
        **parts,
        **{name: w.model_dump() for name, w in _residual(v).items()},
        zeros={
            "moved": v.zeros.moved,
            "supports": layout.each_named(v.rig.supports, change=moved, std=v.zeros.change_std),
        },
        detectable_turn={
            "power": DETECTION_POWER,
            "supports": layout.each_named(v.rig.supports, **dict(turns)),
        },
        **(origin.document() if origin is not None else {}),
    )


def _verdict(v: Tested) -> tuple[str, tuple[str, ...]]:
    """The verdict, and what next."""
    if v.outcome == "unproven":
        reasons = (
            (v.gate_rejected, _REJECTED),
            (v.own, _ANOTHER),
            (v.earlier, _LATER),
            (v.few, _MORE),
        )
        return "not contradicted", (next((told for why, told in reasons if why), _SHARPER),)
    return _SAID[v.outcome]


def _own(v: Tested, found: Finding) -> bool:
    """What makes a check that passes say little: said in the headline."""
    return v.holds and found.code in (
        "rejected-in-use",
        "log-used-before",
        "log-before-calibration",
    )


def _why(v: Tested, findings: Sequence[Finding]) -> list[str]:
    """The headline's sentences."""
    own = [f"{sentence(found)}." for found in findings if _own(v, found)]
    return [*own, *reasons(v)[: -1 if own else None]]


def _of_the_postures(v: Validation) -> dict[str, Any]:
    wrenches = {"uncalibrated": v.nominal, "calibrated": v.calibrated, "std": v.std}
    return {
        "postures": len(v.used),
        "residuals": [
            {
                "index": k,
                "start": v.dwells.start[k],
                "end": v.dwells.end[k],
                **{n: dict(zip(COMPONENTS, w[row], strict=True)) for n, w in wrenches.items()},
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


def validation_report(
    v: Tested,
    findings: Sequence[Finding],
    origin: Origin | None = None,
    drawings: tuple[Drawing, ...] = (),
) -> Report:
    """Lay out a verdict; origin and drawings are those of a page."""
    found = _residual(v)
    if isinstance(v, MovingValidation):
        lost = covered(v.rejected)
        tested = ("in motion", f"{v.seconds:.0f} s", f"tested, {lost:.0f} s left out")
        table = layout.residual_table(found, "means over a second, about the barycentre")
        figure = "residual-over-time"
        left_out = layout.stretches(v.rejected)
    else:
        tested = ("postures", f"{len(v.used)} of {len(v.dwells)}", "in the test")
        table = layout.residual_table(found, "LCS, about its origin")
        figure = "validation"
        left_out = tuple(
            f"posture {k + 1}: {sentence(why)}" for k, why in sorted(v.left_out.items())
        )
    verdict, advice = _verdict(v)
    report = Report(
        title=v.rig.name,
        verdict=verdict.upper(),
        accepted=v.holds and not v.gate_rejected,
        claim=" ".join(_why(v, findings)),
        reasons=_causes(v),
        tiles=(
            tested,
            *layout.residual_tiles(found),
            ("residuals against stated", f"{(v.chi2 / v.dof) ** 0.5:.3g}",
             f"{p_text(v.judged.p_value)}, limit {VALIDATION_CHI2:.3g}"),
            ("single change", p_text(v.judged.search_p), f"limit {VALIDATION_SEARCH:.3g}"),
        ),
        summary=(table,),
        sections=(
            *layout.illustrated(drawings, {figure: (table,)}),
            Section("Left out", layout.listed("Left out", left_out)),
        ),
        warnings=tuple(told(found) for found in findings if not _own(v, found)),
        advice=advice,
    )  # fmt: skip
    if origin is None:
        return report
    c = origin.calibration
    rig, when = origin.rig.rig, origin.measured
    papers = campaign(stated_facts(rig, when), rig)
    return replace(
        report,
        subtitle=f"validation of {origin.name}, a {layout.METHODS[c.method]}{measured_on(c)}, on "
        f"{extent(v)} of {day_measured(when)}",
        created=layout.utc(origin.making.created),
        sections=(
            *report.sections,
            papers,
            _provenance(v, origin),
        ),
    )


def _causes(v: Tested) -> tuple[str, ...]:
    """The likeliest causes, how many others the log does not tell from them, and moved zeros."""
    said = [told(change(v, cause)) for cause in v.suspected]
    rest = len(said) - _CAUSES
    if rest > 1:
        said[_CAUSES:] = [f"{rest} less likely causes cannot be excluded (--json lists them)"]
    zeros = () if v.holds else changes(v)
    return (*said, *(told(found) for found in zeros if found.code == "zeros-beside-change"))


def _provenance(v: Tested, origin: Origin) -> Section:
    """The calibration, the test and the logs."""
    c = origin.calibration
    return origin.making.section(
        calibration_fact(origin.name, c),
        ("Rig file", f"{origin.rig.rig.name}, SHA-256 {origin.rig.sha256}"),
        (
            "χ² test",
            f"χ² = {rounded(v.chi2, 4)} for {v.dof} degrees of freedom, {chi2_test(v)}"
            + ", by Fisher's F" * bool(np.isfinite(v.judged.noise_dof)),
        ),
        ("Single change", f"the likeliest one, by chance alone: {search_test(v)}"),
        ("Decision rule", _RULE),
        ("Taken as exact", exact_names(c)),
        ("Convention", c.convention),
    )
