"""The verdict of a validation, on postures or on a motion: does it still hold, and if not, why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from tdfscal.catalogue import sentence, told
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import count, measured, p_text, rounded
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import ResidualWrench
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.numerics.streams import covered
from tdfscal.records import FloatArray
from tdfscal.reporting import layout
from tdfscal.reporting.changes import Tested, allowed, change, changes, lengths
from tdfscal.reporting.headline import exact_names
from tdfscal.reporting.layout import Drawing, Report, Section
from tdfscal.reporting.traceability import (
    FIXED,
    Making,
    calibration_fact,
    campaign,
    certificates,
    day_measured,
    instruments,
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
#: mrad; a turn as large as this is as good as any.
_UNSEEN = 785.0
_RULE = (
    "still valid where neither χ² nor the search for a single change falls below its limit; both "
    f"limits together reject {VALIDATION_ALARM:.1%} of calibrations that hold{FIXED}"
)

#: Verdict, and what next, by the outcome; of what proves nothing by the first reason that holds.
_AGAIN = "Validate it again in a month, and after every work on a sensor, a hinge or the terminal."
_KEEP = "Keep this calibration in use."
_RENEWED = "The angles stand; use them once the certificate does."
_NEW_ZEROS = (
    "If the sensors were tared, keep its angles and bring their zeros in by `tdfscal update`. If "
    "not, look how they sit: a small turn moves a sensor's readings alike."
)
_SAID = {
    "holds": ("still valid", _KEEP, _AGAIN),
    "tared": ("still valid", _NEW_ZEROS, _AGAIN),
    "touched": (
        "record again",
        "Free what was touched and record this check again, before anything else.",
        "Until then it says nothing of the calibration, neither for it nor against it.",
    ),
    "changed": (
        "recalibrate",
        "Do not steer by this calibration until the cause is found.",
        "Undo the cause and validate again; where that is not possible, calibrate again.",
    ),
}
_UNPROVEN = {
    "gate_rejected": ("not fit for use", "Mend what the quality gate names, and calibrate again."),
    "own": ("not contradicted", "Validate on a log that did not go into the calibration."),
    "earlier": ("not contradicted", "Validate on a log recorded since the calibration."),
    "few": ("not contradicted", "Record six postures or more, with squeezes, to call it valid."),
    "blind": (
        "not contradicted",
        "Check again with more postures, tilt and squeezes, and state no more noise or drift than "
        "there is.",
    ),
}
_LITTLE = ("rejected-in-use", "log-used-before", "log-before-calibration")


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
            "rig": self.rig.document,
            "calibration": own | {"taken_as_exact": [q.name for q in c.taken_as_exact]},
        }


def validation_document(v: Tested, findings: Sequence[Finding], origin: Origin) -> dict[str, Any]:
    """Everything as JSON values, SI units."""
    parts = _of_the_motion(v) if isinstance(v, MovingValidation) else _of_the_postures(v)
    moved = np.where(np.isfinite(v.zeros.change_std), v.zeros.change, np.inf)
    turns = zip(("rx", "ry", "rz"), v.detectable.T, strict=True)
    return layout.document(
        v,
        "holds chi2 dof p_value=judged.p_value search_p_value=judged.search_p "
        "chi2_noise_dof=judged.noise_dof",
        verdict=_verdict(v)[0],
        why=" ".join(_why(v, findings)),
        decided_by="search" if v.decided_by_search else "chi2",
        search_limit=VALIDATION_SEARCH,
        chi2_limit=VALIDATION_CHI2,
        false_alarm=VALIDATION_ALARM,
        **parts,
        **{name: w.model_dump() for name, w in _residual(v).items()},
        zeros={
            "moved": v.zeros.moved,
            "supports": layout.each_named(
                v.rig.supports, change=moved, std=v.zeros.change_std, detectable=v.zeros.detectable
            ),
        },
        detectable_turn={
            "power": DETECTION_POWER,
            "supports": layout.each_named(v.rig.supports, **dict(turns)),
        },
        **origin.document(),
    )


def _verdict(v: Tested) -> tuple[str, list[str]]:
    """The verdict, and what next."""
    if v.outcome == "unproven" or (v.outcome == "changed" and v.gate_rejected):
        verdict, *steps = next(_UNPROVEN[why] for why in _UNPROVEN if getattr(v, why))
    else:
        verdict, *steps = _SAID["tared" if v.holds and v.zeros.moved else v.outcome]
    return verdict, steps


def _own(v: Tested, found: Finding) -> bool:
    """What makes a check that passes say little: said in the headline."""
    return v.holds and found.code in _LITTLE


def _why(v: Tested, findings: Sequence[Finding]) -> Iterator[str]:
    """The headline: what the check found, what of zeros, and what it would have seen."""
    moving = isinstance(v, MovingValidation)
    left = f"In {_extent(v)} the calibrated sensors leave"
    noise = " and the noise of this log" * moving
    allow = f"force and moment than the stated uncertainties{noise} allow"
    search, chi2 = _tests(v)
    if v.holds:
        own = [f"{sentence(found)}." for found in findings if _own(v, found)]
        yield from own
        yield f"{left} no more {allow} (χ² test: {chi2}; test for a single change: {search})."
        yield from (begun(sentence(found), ".") for found in changes(v))
        yield from [*([] if own else [_sure(v)]), *allowed(v)]
        return
    failed = []
    if v.judged.search_p < VALIDATION_SEARCH:
        failed.append(f"a single change explains more of it than chance would ({search})")
    if v.judged.p_value < VALIDATION_CHI2:
        said = f"χ² = {rounded(v.chi2, 4)} for {v.dof} degrees of freedom ({chi2})"
        failed.insert(len(failed) if v.decided_by_search else 0, said)
    yield from (f"{sentence(found)}." for found in findings if found.code == "rejected-in-use")
    yield f"{left} more {allow}: {'; '.join(failed)}."
    if not v.suspected:
        yield (
            "No single change explains all of it: several things may have changed, or the "
            "calibration is that of another rig."
        )
    elif len(v.suspected) > 1:
        more = "a longer motion" if moving else "more postures"
        yield (
            f"The causes below explain it about equally well; {more}, more tilt and a squeeze "
            "would tell them apart."
        )
    yield from allowed(v)


def _tests(v: Tested) -> tuple[str, str]:
    """The probabilities of the likeliest single change and of χ², each with its limit."""
    both = (v.judged.search_p, VALIDATION_SEARCH), (v.judged.p_value, VALIDATION_CHI2)
    search, chi2 = (f"{p_text(p)}, limit {rounded(limit, 3)}" for p, limit in both)
    return search, chi2


def _extent(v: Tested) -> str:
    """How much was tested."""
    if isinstance(v, MovingValidation):
        return f"{v.seconds:.0f} s of motion"
    whole = f"{len(v.used)} of " if v.left_out else ""
    return f"{whole}{count(len(v.dwells), 'posture')}"


def _sure(v: Tested) -> str:
    """What would have been detected."""
    lean, twist = 1e3 * v.detectable[:, :2].max(), 1e3 * v.detectable[:, 2].max()
    upright = f"about the vertical, by more than {measured(twist)} mrad."
    said = (
        f"Had one sensor turned by more than {measured(lean)} mrad in roll or pitch, this check "
        f"would have shown it with {DETECTION_POWER:.0%} probability, even behind a new tare; "
        f"{upright if twist <= _UNSEEN else 'it would not show a turn about the vertical.'}"
    )
    if np.isfinite(zero := v.zeros.detectable).all():
        said += (
            f" A zero that moved alone by {measured(zero.max())} N or more is remarked on as "
            "surely; the verdict is on angles, load and gain."
        )
    if v.blind:
        limit = measured(1e3 * v.limit)
        said += f" The angles have to hold to ± {limit} mrad: a harmful turn could go unseen."
    return said


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
    both: dict[str, Any] = {"time": v.residual.time}
    both["rejected"] = [
        {"begin": s.begin, "end": s.end, "code": s.reason.code, "reason": sentence(s.reason)}
        for s in v.rejected
    ]
    for k, name in enumerate(("force", "moment")):
        both[name] = {"before": v.residual.before[:, k], "after": v.residual.after[:, k]}
    return {"motion": layout.document(v, "begin seconds", **both)}


def _residual(v: Tested) -> dict[str, ResidualWrench]:
    if isinstance(v, MovingValidation):
        return ResidualWrench.of(v.residual.before, v.residual.after)
    return ResidualWrench.of(lengths(v.nominal), lengths(v.calibrated))


def _rms(sizes: FloatArray) -> dict[str, float]:
    """Root mean square of lengths (K, 2) of force, N, and moment, N·m; ∞ where unknown."""
    rms = np.sqrt(np.mean(np.square(sizes), axis=0))
    return dict(zip(("force", "moment"), rms.tolist(), strict=True))


def validation_report(
    v: Tested, findings: Sequence[Finding], origin: Origin, drawings: tuple[Drawing, ...] = ()
) -> Report:
    """Lay out a verdict; drawings are those of a page."""
    found = _residual(v)
    if isinstance(v, MovingValidation):
        lost = covered(v.rejected)
        tested = ("in motion", f"{v.seconds:.0f} s", f"tested, {lost:.0f} s left out")
        where = "means over a second, about the barycentre"
        # A log's own noise would hide its faults.
        motion = origin.calibration.motion
        then = None if motion is None else _rms(np.array(motion.residual.after))
        table = layout.residual_table(
            found, f"{where}; then: when calibrated" if then else where, then, "rms then"
        )
        left_out = layout.stretches(v.rejected)
    else:
        tested = ("postures", f"{len(v.used)} of {len(v.dwells)}", "in the test")
        table = layout.residual_table(found, "LCS, about its origin", _rms(lengths(v.std)))
        left_out = layout.rejected(v.left_out)
    verdict, advice = _verdict(v)
    if ended := certificates(findings):
        advice = [_RENEWED if step == _KEEP else step for step in advice]
    return Report(
        title=v.rig.name,
        subtitle=_about(v, origin),
        verdict=verdict.upper(),
        accepted=v.holds and not v.gate_rejected,
        provisional=v.outcome == "unproven",
        claim=" ".join(_why(v, findings)),
        reasons=_causes(v),
        tiles=(
            tested,
            *layout.residual_tiles(found),
            ("residuals against stated", f"{measured((v.chi2 / v.dof) ** 0.5)}",
             f"{p_text(v.judged.p_value)}, limit {rounded(VALIDATION_CHI2, 3)}"),
            ("single change", p_text(v.judged.search_p), f"limit {rounded(VALIDATION_SEARCH, 3)}"),
        ),
        summary=(table,),
        sections=(
            *layout.illustrated(drawings, {"".join(d.name for d in drawings): (table,)}),
            Section("Left out", layout.listed("Left out", left_out)),
            *_papers(v, origin),
        ),
        warnings=tuple(told(found) for found in findings if not _own(v, found)),
        advice=(*ended, *advice),
        created=layout.utc(origin.making.created),
    )  # fmt: skip


def _about(v: Tested, origin: Origin) -> str:
    c = origin.calibration
    said = f"validation of {origin.name}, a {layout.METHODS[c.method]}{measured_on(c)}, on "
    return f"{said}{_extent(v)} of {day_measured(origin.measured)}"


def _causes(v: Tested) -> tuple[str, ...]:
    """The likeliest causes, how many others the log does not tell from them, and moved zeros."""
    said = [told(change(v, cause)) for cause in v.suspected]
    rest = len(said) - _CAUSES
    if rest > 1:
        said[_CAUSES:] = [f"{rest} less likely causes cannot be excluded (--json lists them)"]
    zeros = () if v.holds else changes(v)
    return (*said, *(told(found) for found in zeros if found.code == "zeros-beside-change"))


def _papers(v: Tested, origin: Origin) -> tuple[Section, Section]:
    """Campaign and sensors; the calibration, the test and the logs."""
    c, rig = origin.calibration, origin.rig.rig
    fisher = " by Fisher's F" * bool(np.isfinite(v.judged.noise_dof))
    test = layout.chi_squared(v.chi2, v.dof, v.judged.p_value)
    facts = *stated_facts(rig, origin.measured), *instruments(c)
    return campaign(facts, rig), origin.making.section(
        calibration_fact(origin.name, c),
        ("Rig file", f"{rig.name}, SHA-256 {origin.rig.sha256}"),
        ("χ² test", f"{test}{fisher}, limit {rounded(VALIDATION_CHI2, 3)}"),
        ("Decision rule", _RULE),
        ("Taken as exact", exact_names(c)),
    )
