"""What an auditor asks of a result: when, where and by whom, of which files, by which rules."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import PurePath
from typing import Any

from tdfscal import __version__
from tdfscal.catalogue import sentence, told
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import count, measured, probability, rounded
from tdfscal.estimation.exact_quantities import UNMOVED
from tdfscal.files.calibration.document import Calibration, file_content, overdue, unsealed
from tdfscal.files.calibration.evidence import ConformityResult
from tdfscal.files.calibration.parameters import UNCONFIRMED
from tdfscal.files.calibration.parts import MeasuredResult, instant
from tdfscal.findings import Finding
from tdfscal.frozen import field, record
from tdfscal.records import InputFile, Rig, SensorInfo
from tdfscal.reporting.headline import exact_names, parts
from tdfscal.reporting.layout import METHODS, Facts, Section, document, utc
from tdfscal.significance import (
    CERTAIN_SHIFT,
    CERTAINLY_UNDECLARED,
    DETECTION_POWER,
    EXPANDED_COVERAGE,
    HARMFUL_SHIFT,
    LONGEST_INTERVAL,
    MOST_REJECTED,
    UNDECLARED_ERROR,
)

#: Days of a month.
_MONTH = 30.4375
_NOT_STATED = "not stated"
#: Whose limit it is that no rig file states.
FIXED = " (fixed in the tool)"
_ESTIMATORS = {"ml": ", maximum likelihood", "linear": ", linear (the paper's)", None: ""}
_SOURCES = {"log": "by the log's own clock", "rig": "by the rig file", "file": "by the file's date"}


@record
class Making:
    """How a result was made. created : UTC, ISO 8601."""

    command: str
    inputs: tuple[InputFile, ...]
    created: str = field(default_factory=lambda: instant(time.time()))
    version: str = __version__

    def section(
        self,
        *facts: tuple[str, str],
        title: str = "Where this result comes from",
        page_only: bool = True,
    ) -> Section:
        """What a result was made of: command, program, facts, and files with their digests."""
        rows = (
            ("Command", self.command),
            ("Created", utc(self.created)),
            ("Software", f"tdfscal {self.version}"),
            *(
                ("Input file", f"{f.path}, {f.bytes:,} bytes; {f.integrity}; SHA-256 {f.sha256}")
                for f in self.inputs
            ),
        )
        blocks = (Facts(facts), Facts(rows, verbatim=True))
        return Section(title, blocks, page_only=page_only)

    def document(self) -> dict[str, Any]:
        """Return it under the keys of a calibration file, as plain JSON values."""
        software = {"name": "tdfscal", "version": self.version}
        return document(self, "created command inputs", software=software)


def making_of(c: Calibration) -> Making:
    """How a calibration was made."""
    inputs = tuple(each.record() for each in c.inputs)
    return Making(c.command, inputs, c.created, c.software.version)


def content_facts(c: Calibration) -> tuple[tuple[str, str], ...]:
    """By which method a calibration was made, what it holds, on what it relies."""
    return (
        ("Method", METHODS[c.method] + _ESTIMATORS[c.estimator]),
        ("Content", digest_told(c)),
        ("Rig file", f"{c.rig.name}, SHA-256 {c.rig.sha256}"),
        *(
            ("Rig file", f"of {one.name}, SHA-256 {one.rig_sha256}")
            for one in c.campaigns
            if one.rig_sha256 not in (None, c.rig.sha256)
        ),
        ("Taken as exact", exact_names(c)),
    )


def titled(c: Calibration) -> str:
    """The rig's name; of a pool whose draft bears a campaign's name, that there are others."""
    more = len(c.campaigns) - 1
    drafted = more > 0 and c.rig.name in [PurePath(one.name).name for one in c.campaigns]
    return f"{c.rig.name} and {count(more, 'more campaign')}" if drafted else c.rig.name


def provenance(c: Calibration) -> Section:
    """What a calibration was made of, with which program, by which rules."""
    facts = [*content_facts(c), ("Decision rule", decision_rule(c))]
    if c.conformity is not None:
        judged = _contact(c, c.conformity) if c.accepted else "not judged: the result is rejected"
        facts.append(("Contact wrench", judged))
    size = len(c.covariance.parameters)
    whole = f"{c.covariance.definition}; the file's covariance block has all {size} × {size} of it"
    facts += [("Convention", c.convention), ("Covariance", whole)]
    return making_of(c).section(*facts, page_only=False)


def report_digest(c: Calibration) -> str | None:
    """SHA-256 of the calibration's content, None where it was read from a file without one.

    A report's number is its first eight digits.
    """
    digest: str | None = file_content(c)["content_sha256"]
    return digest


def digest_told(c: Calibration) -> str:
    """The same in words."""
    return f"SHA-256 {report_digest(c) or 'not stated by the file'}"


def calibration_fact(name: str, c: Calibration) -> tuple[str, str]:
    """Name a calibration that a check stands on: when it was measured, what it holds."""
    said = f"{name}, {METHODS[c.method]}{measured_on(c)}, {c.status}"
    return "Calibration", f"{said}, content {digest_told(c)}"


def decision_rule(c: Calibration) -> str:
    """When a result is accepted (ISO/IEC 17025, 7.8.6), and who set each limit."""
    limits = c.rig.acceptance
    rules = [
        f"every angle's standard uncertainty is at most {rounded(1e3 * limits.angle_std, 3)} mrad"
        + _whose(c, "angle_std"),
        f"the residuals are at most {rounded(limits.birge_max)} times what the stated "
        f"uncertainties predict{_whose(c, 'birge_max')}",
    ]
    end = "no finding rejects"
    if c.method != "tracker":
        lost = "motion is left out" if c.motion is not None else "postures are rejected"
        rules.append(f"at most {MOST_REJECTED:.0%} of the {lost}{FIXED}")
        harm = f"an angle by more than {HARMFUL_SHIFT:g} of its standard uncertainties, or "
        if c.motion is not None:
            harm = ""
        end += (
            ". A finding rejects, for example, where the residuals point to an undeclared error "
            f"that would move {harm}an angle or a zero by more than {CERTAIN_SHIFT:g} where the "
            f"evidence is strong (p < {rounded(CERTAINLY_UNDECLARED)}){FIXED}; by chance "
            f"{100 * UNDECLARED_ERROR:.1f} % of sound campaigns at most raise such a suspicion"
        )
    numbered = "; ".join(f"({k + 1}) {rule}" for k, rule in enumerate((*rules, end)))
    said = f"Accepted where {numbered}. Limits of uncertainties need no guard band."
    for moved in (q for q in c.taken_as_exact if q.name == UNMOVED):
        said += (
            f" All {parts(c)} count as of one state: that a sensor turned before the last of "
            f"them is excluded, with {DETECTION_POWER:.0%} probability, from "
            f"{measured(1e3 * moved.error)} mrad on only{FIXED}."
        )
    if c.status == "provisional":
        said += " Provisional: accepted, with lines of the drafted rig file still to be confirmed."
    if limits.contact is not None:
        said += (
            " Contact wrench: accepted with a guard band as wide as the expanded uncertainty U, "
            f"coverage {100 * EXPANDED_COVERAGE:.2f} %: known error + U is at most the limit (JCGM "
            "106); what is known is corrected, so that the known error is 0."
        )
    return said


def _whose(c: Calibration, key: str) -> str:
    """Who set a limit: the rig file that states it, or the tool."""
    stated = c.rig.stated_limits
    if stated is None:  # a file that does not tell
        return ""
    return " (set in the rig file)" if key in stated else f" (the tool's default for {key})"


def _contact(c: Calibration, found: ConformityResult) -> str:
    """Expanded uncertainty of force and torque against their limits; what they leave out."""
    said = [
        f"{name} conforms: U = {measured(part.expanded, 3)} {unit}, limit {part.limit:g} {unit}, "
        f"exceeded with probability {probability(part.exceeding)}"
        for name, unit, part in (("force", "N", found.force), ("torque", "N·m", found.torque))
        if part.limit is not None
    ]
    rpy = ", ".join(f"{angle:g}" for angle in found.rpy)
    given = f", given that what is taken as exact ({exact_names(c)}) is exact"
    return f"{'; '.join(said)}; known error 0; at roll, pitch, yaw ({rpy}) rad{given}"


def campaign(
    facts: Iterable[tuple[str, str | None]], rig: Rig, title: str = "Campaign and sensors"
) -> Section:
    """What is told of a campaign and its sensors, and what is not."""
    rows = (*facts, *_papers(rig))
    lacking = ", ".join(name for name, text in rows if not text)
    said = [(name, text) for name, text in rows if text]
    return Section(title, (Facts((*said, *[("Not stated", lacking)] * bool(lacking))),))


def _papers(rig: Rig) -> tuple[tuple[str, str | None], ...]:
    """Serial number and certificate of each sensor."""
    if all(one == SensorInfo() for one in rig.sensors):
        return (("Serial numbers and certificates of the sensors", None),)
    papers = ("serial number", "certificate", "due")
    known = ((one.serial, one.certificate, one.due) for one in rig.sensors)
    said = (
        ", ".join(f"{what} {text or _NOT_STATED}" for what, text in zip(papers, of, strict=True))
        for of in known
    )
    return tuple((f"Sensor of {name}", of) for name, of in zip(rig.supports, said, strict=True))


def stated_facts(rig: Rig, measured: MeasuredResult) -> list[tuple[str, str | None]]:
    """What is told of the rig's serial number, dates, people and place."""
    said, span = rig.campaign, " to ".join(dict.fromkeys(map(utc, measured.told)))
    when = f"{span}, {_SOURCES[measured.source]}"
    if measured.source == "file":
        when += "; a copy of the file has another, so state campaign.date in rig.yaml"
    facts = [("Serial number", rig.serial), ("Measured", when)]
    facts += [("Operator", said.operator), ("Site", said.site)]
    return facts + [("Note", said.note)] * bool(said.note)


def campaign_facts(c: Calibration) -> tuple[tuple[str, str | None], ...]:
    """The same of a calibration, with its conditions, the instruments used, what it stands on."""
    rig = c.rig.record()
    facts = stated_facts(rig, c.measured)
    facts += [("Next due", due)] if (due := _next_due(c)) else []
    facts += instruments(c)
    if c.dwells is not None and c.dwells.temperature is not None:
        warm = c.dwells.temperature
        facts.append(("Conditions", f"{min(warm):.1f} to {max(warm):.1f} °C at the dwells"))
    facts += [
        ("Stands on", f"{METHODS[entry.method]} of {utc(entry.created)}, SHA-256 {entry.sha256}")
        for entry in c.history
    ]
    return tuple(facts)


def instruments(c: Calibration) -> list[tuple[str, str | None]]:
    """The tracker and the scale that a calibration rests on, as the rig file tells of them."""
    rig, methods = c.rig.record(), (c.method, *(one.method for one in c.history))
    found = [("Tracker", rig.campaign.tracker)] * any(method != "self" for method in methods)
    weighed = c.method != "tracker" and math.isfinite(rig.mass.std)
    return found + [("Weighed with", rig.campaign.scale)] * weighed


def measured_on(c: Calibration) -> str:
    """Of which day the data are, and what says so."""
    several = len(c.campaigns) > 1 and not c.history
    return f" of {day_measured(c.measured, c.measured.begin if several else '')}"


def day_measured(measured: MeasuredResult, begin: str = "") -> str:
    """Of which day data are, and what says so; begin : of the first of several campaigns."""
    first = f"{begin[:10]} to " if begin[:10] not in ("", measured.end[:10]) else ""
    return f"{first}{measured.end[:10]}, {_SOURCES[measured.source]}"


def _by_file(measured: MeasuredResult) -> str:
    """That nothing but a file's date says when data were recorded."""
    return f" ({_SOURCES['file']})" if measured.source == "file" else ""


def _next_due(c: Calibration) -> str:
    """When the next calibration is due, by drift.angle and the sensors; empty where unknown."""
    angle, limit, rig = c.rig.drift.angle, c.rig.acceptance.angle_std, c.rig.record()
    if ended := overdue(rig, c.created[:10]):
        first = min(ended, key=lambda found: str(found.values["due"]))
        return f"now: {sentence(first)}{_by_file(c.measured)}"
    due = [(end, f"when the certificate of {name}'s sensor ends") for end, name in rig.certificates]
    room = limit**2 - float(c.rpy_std[c.determined].max()) ** 2
    if c.status == "accepted" and 0 < angle < math.inf and room > 0:
        months = min(room / angle**2, LONGEST_INTERVAL)
        why = "by drift.angle an angle then reaches its limit"
        if months == LONGEST_INTERVAL:
            why = "after two years, though by drift.angle no limit is reached till then"
        begin = datetime.fromtimestamp(c.measured.record().end, UTC)
        day = (begin + timedelta(days=_MONTH * months)).date().isoformat()
        due.append((day, f"{why}{_by_file(c.measured)}"))
    return ", ".join(min(due)) if due else ""


def warnings(c: Calibration) -> tuple[str, ...]:
    """What to know before the result is used, beside what its first paragraph says."""
    said = (UNCONFIRMED, "sensor-turned") if c.accepted else (UNCONFIRMED,)
    found = (f.told for f in c.findings if f.severity == "warns" and f.code not in said)
    return (*doubts(c), *found)


def doubts(c: Calibration) -> tuple[str, ...]:
    """That a file was edited, that its dates cannot be, whose certificate had ended before."""
    papers = (f"{sentence(found)}{_by_file(c.measured)}" for found in expired(c))
    return (*map(sentence, unsealed("this calibration", c)), *papers)


def expired(c: Calibration) -> tuple[Finding, ...]:
    """Whose own certificate had ended when the calibration's data were recorded."""
    return overdue(c.rig.record(), c.measured.end[:10], "this calibration")


def certificates(findings: Iterable[Finding]) -> tuple[str, ...]:
    """What next of sensors whose certificate has ended: before all else."""
    ended = {found.subject: found for found in findings if found.code == "sensor-overdue"}
    return tuple(begun(told(found), ".") for found in ended.values())
