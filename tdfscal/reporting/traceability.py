"""What an auditor asks of a calibration: of what, when, by whom, on what assumptions and rules."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import PurePath
from typing import Any

import numpy as np

from tdfscal.catalogue import sentence
from tdfscal.catalogue.entry import quantity, rounded
from tdfscal.files.calibration.consistency import UNCONFIRMED
from tdfscal.files.calibration.defects import doubtful
from tdfscal.files.calibration.document import Calibration, file_content, recorded
from tdfscal.files.calibration.evidence import ConformityResult, ExactQuantityResult
from tdfscal.files.calibration.parts import FindingResult
from tdfscal.files.rig.model import AcceptanceBlock
from tdfscal.numerics.distributions import probability
from tdfscal.records import FloatArray
from tdfscal.reporting.layout import FIXED, METHODS, Section, Table, utc
from tdfscal.reporting.papers import Making, by_file, day_measured, overdue, stated_facts
from tdfscal.significance import (
    CERTAIN_SHIFT,
    CERTAINLY_UNDECLARED,
    EXPANDED_COVERAGE,
    HARMFUL_SHIFT,
    LONGEST_INTERVAL,
    MOST_REJECTED,
    UNDECLARED_ERROR,
)

#: Days of a month.
_MONTH = 30.4375
_ESTIMATORS = {"ml": ", maximum likelihood", "linear": ", linear (the paper's)", None: ""}
#: Sensors beside each other in a table: 80 letters hold so many.
_BESIDE = 3
_CAPTION = (
    "Taken as exact, in no uncertainty: what a typical error would do to roll/pitch/yaw, mrad"
)
_UNITS = {"rad": (1e3, "mrad"), "m": (1e3, "mm"), "s": (1e3, "ms"), "relative": (100.0, "%"),
          "of it": (100.0, "%")}  # fmt: skip
#: Quantities named in one sentence, and the share of the half width from which on they are.
_NAMED, _NOTABLE = 3, 0.1
#: Standard uncertainties of the rig file's block, by the words for what they are of; those of which
#: a typical error is worked out are called as there.
_DECLARED = {
    "positioner": "NCP repeatability",
    "hinge": "hinge drawing",
    "datum": "servo datums",
    "force_sensitivity": "gain, crosstalk",
    "hinge_moment": "friction of the hinges",
}


def campaign_facts(c: Calibration) -> tuple[tuple[str, str], ...]:
    """The same of a calibration, with its conditions, the instruments used, what it stands on."""
    rig = c.rig.record()
    facts = [*stated_facts(rig, c.measured), ("Next due", _next_due(c))]
    if any(method != "self" for method in (c.method, *(one.method for one in c.history))):
        facts.append(("Tracker", rig.campaign.tracker))
    if c.method != "tracker" and math.isfinite(rig.mass.std):
        facts.append(("Scale", rig.campaign.scale))
    if c.dwells is not None and c.dwells.temperature is not None:
        warm = c.dwells.temperature
        facts.append(("Conditions", f"{min(warm):.1f} to {max(warm):.1f} °C at the dwells"))
    facts += [
        ("Stands on", f"{METHODS[entry.method]} of {utc(entry.created)}, SHA-256 {entry.sha256}")
        for entry in c.history
    ]
    return tuple((name, text) for name, text in facts if text)


def measured_on(c: Calibration) -> str:
    """Of which day the data are, and what says so; a file of old knows its own day alone."""
    if c.measured is None:
        return f", computed {c.created[:10]}"
    several = len(c.campaigns) > 1 and not c.history
    return f" of {day_measured(c.measured, c.measured.begin if several else '')}"


def assumptions(c: Calibration) -> tuple[tuple[str, str], ...]:
    """What is in no uncertainty, when a result is accepted, and how its contact wrench fares."""
    exact = "; ".join(exact_names(c))
    said = ("Taken as exact", exact or "nothing"), ("Decision rule", _decision_rule(c))
    if c.conformity is None:
        return said
    contact = _contact(c.conformity, exact) if c.accepted else "not judged: the result is rejected"
    return (*said, ("Contact wrench", contact))


def calibration_fact(name: str, c: Calibration) -> tuple[str, str]:
    """Name a calibration that a check stands on: when it was measured, what it holds."""
    said = f"{name}, {METHODS[c.method]}{measured_on(c)}, {c.status}"
    return "Calibration", f"{said}, content SHA-256 {report_digest(c)}"


def report_digest(c: Calibration) -> str:
    """SHA-256 of the calibration's content; a report's number is its first eight digits."""
    return str(file_content(c)["content_sha256"])


def warnings(c: Calibration) -> tuple[str, ...]:
    """What to know before the result is used; the lines of a draft stand by themselves."""
    found = (f.told for f in c.findings if f.severity == "warns" and f.code != UNCONFIRMED)
    return (*doubts(c), *found)


def doubts(c: Calibration) -> tuple[str, ...]:
    """That a file was edited, that its dates cannot be, whose certificate had ended before."""
    ended = overdue(c.rig.record(), _day(c), "this calibration")
    papers = (f"{sentence(found)}{by_file(c.measured)}" for found in ended)
    return (*map(sentence, doubtful("this calibration", c)), *papers)


def _contact(found: ConformityResult, exact: str) -> str:
    """Expanded uncertainty of force and torque against their limits; what they leave out."""
    said = []
    for name, unit, part in (("force", "N", found.force), ("torque", "N·m", found.torque)):
        if part.limit is None:
            continue
        said.append(
            f"{name} conforms: U = {part.expanded:.3g} {unit}, limit {part.limit:g} {unit}, "
            f"exceeded with probability {probability(part.exceeding)}"
        )
    rpy = ", ".join(f"{angle:g}" for angle in found.rpy)
    given = f", given that what is taken as exact ({exact}) is exact" if exact else ""
    return f"{'; '.join(said)}; at roll, pitch, yaw ({rpy}) rad{given}"


def _next_due(c: Calibration) -> str:
    """When the next calibration is due, by drift.angle and the sensors; empty where unknown."""
    angle, limit = c.rig.drift.angle, c.rig.acceptance.angle_std
    due = []
    room = limit**2 - float(c.rpy_std[c.determined].max()) ** 2
    if c.status == "accepted" and 0 < angle < math.inf and room > 0:
        months = min(room / angle**2, LONGEST_INTERVAL)
        why = "by drift.angle an angle then reaches its limit"
        if months == LONGEST_INTERVAL:
            why = "after two years, though by drift.angle no limit is reached till then"
        begin = datetime.fromtimestamp(recorded(c).end, UTC)
        day = (begin + timedelta(days=_MONTH * months)).date().isoformat()
        due.append((day, f"{why}{by_file(c.measured)}"))
    rig = c.rig.record()
    if ended := overdue(rig, _day(c)):
        first = min(ended, key=lambda found: str(found.values["due"]))
        return f"now: {sentence(first)}{by_file(c.measured)}"
    due += [
        (end, f"when the certificate of {name}'s sensor ends") for end, name in rig.certificates
    ]
    return ", ".join(min(due)) if due else ""


def _day(c: Calibration) -> str:
    """Day on which the data were recorded."""
    return (c.measured.end if c.measured is not None else c.created)[:10]


def expired_sentence(c: Calibration) -> str:
    """Whose own certificate had ended, for the first lines; the warnings have the days."""
    names = ", ".join(name for found in overdue(c.rig.record(), _day(c)) for name in found.subject)
    return f"No sensor certificate was valid any more for {names}." if names else ""


def not_whole(c: Calibration) -> tuple[FindingResult, ...]:
    """What tells that a part of the log is missing: its files, or else recorders that ran apart."""
    return c.found("log-truncated") or c.found("recorders-overlap-in-part")


def not_whole_sentence(c: Calibration) -> str:
    """What there is of a log of which a part is missing."""
    parts = [
        ("the first rows" if f.size is None else f"{f.size:.1f} s")
        + f" of {', '.join(PurePath(name).name for name in f.subject)}"
        for f in not_whole(c)
    ]
    return f"The log is not whole; used: {', '.join(parts)}." if parts else ""


def exact_sentence(c: Calibration, half_width: float) -> str:
    """What is taken as exact, the worst first, with what a typical error of each would do.

    half_width : rad, of the angles' intervals; what is small against it is not named, nor what adds
    little to those that exceed it.
    """
    more, all_of_them = exceeding(c, half_width), _by_effect(c)
    named = more or [q for q in all_of_them if _effects(q).max() > _NOTABLE * half_width]
    parts = [
        f"{q.name} ({_typical_error(q)}{by} by {rounded(1e3 * _effects(q).max())} mrad)"
        for q, by in zip(named[:_NAMED], (" moves one", *[""] * _NAMED), strict=False)
    ]
    if len(more) > 1:
        parts.append(f"together by {rounded(1e3 * _together(all_of_them))} mrad")
    taken = "They may be off by more; taken" if more else "Taken"
    said = f"{taken} as exact: {'; '.join(parts)}. " if parts else ""
    return (said + _tightly_stated(c, half_width)).strip()


def _tightly_stated(c: Calibration, half_width: float) -> str:
    """What an error of typical size does of what is stated to be better, as a tare that is none.

    Linear, and so by the budget: errors of all components of a group add in squares.
    """
    if c.budget is None or c.method == "tracker":
        return ""
    terminal, parts = c.rig.terminal, []
    stated = {
        "zero": ("tare", 1.0, "N", [std for s in c.rig.supports for std in s.zero.std]),
        "barycentre": ("barycentre", 1e-3, "m", list(terminal.barycenter.std)),
        "mass": ("mass", 1e-3 * terminal.mass.value, "kg", [terminal.mass.std]),
    }
    for source, (name, error, unit, std) in stated.items():
        variance = max((angle.variance.get(source, 0.0) for angle in c.budget.angles), default=0.0)
        move = math.sqrt(variance) * error / std[0] if 0 < max(std) < error else 0.0
        if min(std) == max(std) and move > _NOTABLE * half_width:
            parts.append(
                f"{name} ({quantity(error, unit)} wrong moves one by {rounded(1e3 * move)} mrad)"
            )
    return f"They rest on the stated {'; '.join(parts)}." if parts else ""


def exceeding(c: Calibration, half_width: float) -> list[ExactQuantityResult]:
    """Quantities taken as exact of which typical errors together move an angle by more.

    half_width : rad, of the angles' intervals. The worst first; the others together do not.
    """
    each = _by_effect(c)
    if _together(each) <= half_width:
        return []
    enough = (
        k for k in range(len(each) + 1) if _together(each[k:]) <= half_width < _together(each[:k])
    )
    return each[: next(enough)]


def _together(quantities: Sequence[ExactQuantityResult]) -> float:
    """Largest move of an angle, rad, by typical errors of all, which are independent."""
    return float(np.sqrt(np.sum([_effects(q) ** 2 for q in quantities], axis=0)).max(initial=0.0))


def _by_effect(c: Calibration) -> list[ExactQuantityResult]:
    """Quantities taken as exact, the one whose typical error moves an angle most first."""
    return sorted(c.taken_as_exact, key=lambda q: -float(_effects(q).max()))


def exact_tables(c: Calibration) -> tuple[Table, ...]:
    """One row per quantity: effect on roll, pitch, yaw of each sensor, mrad."""
    names = [support.name for q in c.taken_as_exact[:1] for support in q.supports]
    tables = []
    for first in range(0, len(names), _BESIDE):
        shown = slice(first, first + _BESIDE)
        rows = tuple(
            (
                f"{quantity.name}, {_typical_error(quantity)}",
                *("/".join(f"{1e3 * v:.2f}" for v in row) for row in _effects(quantity)[shown]),
            )
            for quantity in _by_effect(c)
        )
        tables.append(Table("" if first else _CAPTION, ("", *names[shown]), rows))
    return tuple(tables)


def _effects(quantity: ExactQuantityResult) -> FloatArray:
    """Effects (n, 3), rad, on roll, pitch, yaw; of the turns where these are not separable."""
    return np.array([s.turn if s.rpy is None else s.rpy for s in quantity.supports])


def _typical_error(quantity: ExactQuantityResult) -> str:
    """The error of each component, in a unit that reads well."""
    scale, unit = _UNITS.get(quantity.unit, (1.0, quantity.unit))
    return f"{scale * quantity.error:g} {unit}"


def provenance(c: Calibration, digest: str) -> Section:
    """What the result was made of, with which program, by which rules; see `report_digest`."""
    inputs = tuple(each.record() for each in c.inputs)
    return Making(c.command, inputs, c.created, c.software.version).section(
        ("Method", METHODS[c.method] + _ESTIMATORS[c.estimator]),
        ("Content", f"SHA-256 {digest}"),
        ("Seed", str(c.seed)),
        ("Rig file", f"{c.rig.name}, SHA-256 {c.rig.sha256}"),
        *assumptions(c),
        ("Convention", c.convention),
        ("Covariance", c.covariance.definition),
        page_only=False,
    )


def exact_names(c: Calibration) -> list[str]:
    """Quantities that the rig file states without uncertainty: the result has none of theirs.

    Those of which a typical error is worked out come first, the worst before the others.
    """
    terminal, declared = c.rig.terminal, c.rig.uncertainty
    exact = [words for name, words in _DECLARED.items() if getattr(declared, name) == 0]
    if c.method == "tracker":
        return exact
    stated: dict[str, Any] = {"mass": terminal.mass.std, "barycentre": terminal.barycenter.std}
    stated |= {f"zero of {s.name}": s.zero.std for s in c.rig.supports}
    stated["base level"] = c.rig.gravity.tilt_std
    exact += [name for name, std in stated.items() if not np.any(std)]
    return list(dict.fromkeys([*(q.name for q in _by_effect(c)), *exact]))


def _whose(limits: AcceptanceBlock, key: str) -> str:
    """Whose limit of the rig file's it is; one that is stated as the default is none other."""
    if getattr(limits, key) == getattr(AcceptanceBlock(), key):
        return f" [the tool's own default; acceptance.{key} states another]"
    return f" [the rig file's acceptance.{key}]"


def _decision_rule(c: Calibration) -> str:
    """When a result is accepted (ISO/IEC 17025, 7.8.6)."""
    limits = c.rig.acceptance
    rule = (
        f"accepted where every angle's standard uncertainty is at most "
        f"{1e3 * limits.angle_std:.3g} mrad{_whose(limits, 'angle_std')}, the "
        f"scatter at most {limits.birge_max:.2g} times what is stated (Birge ratio)"
        f"{_whose(limits, 'birge_max')}"
    )
    if c.method != "tracker":
        lost = "motion is left out" if c.motion is not None else "postures are rejected"
        rule += f", at most {MOST_REJECTED:.0%} of the {lost}{FIXED}"
    rule += ", and no finding rejects"
    if c.method != "tracker":
        harm = f"an angle by more than {HARMFUL_SHIFT:g}, or " if c.motion is None else ""
        harm += (
            f"where p < {CERTAINLY_UNDECLARED:g} an angle or a zero by more than {CERTAIN_SHIFT:g}"
        )
        rule += (
            f": an undeclared error does that the residuals suspect (level: {UNDECLARED_ERROR:.1%} "
            f"of faultless campaigns at most) and that moves {harm} of its standard uncertainties"
            f"{FIXED}"
        )
    rule += "; the limit is one of the uncertainty itself, so that no guard band stands before it"
    if c.status == "provisional":
        rule += "; provisional: accepted, with lines of the rig file's draft still to be confirmed"
    if limits.contact is not None:
        rule += (
            "; contact wrench: guarded acceptance, the guard band being the expanded uncertainty "
            f"of its length, coverage {100 * EXPANDED_COVERAGE:.2f} % (JCGM 106)"
        )
    return rule
