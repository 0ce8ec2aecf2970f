"""A rig's history in words: verdict, alarms, the state of every angle, when to calibrate next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np

from tdfscal.catalogue import cure, sentence, told
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import count, measured, rounded
from tdfscal.comparison.control_chart import WINDOWS, Alarm
from tdfscal.comparison.history import Life
from tdfscal.findings import Finding, Value, rejecting
from tdfscal.frozen import record
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.records import Rig
from tdfscal.reporting import layout
from tdfscal.reporting.figures import date_of
from tdfscal.reporting.layout import Drawing, Facts, Report, Section, Table, by_angle
from tdfscal.reporting.several import mrad_with
from tdfscal.reporting.traceability import FIXED, Making, campaign, certificates
from tdfscal.significance import DETECTION_POWER, LONGEST_INTERVAL

#: Codes of campaigns that take no part; and of what makes one worth its own headline.
_NO_PART = ("campaign-unsound", "campaign-unusable", "campaign-left-out")
_SLIP = "sensor-slipped"
#: Months that read as such in a sentence.
_SAID = 0.05
#: Scatter, as a multiple of what is stated, that is not worth a word.
_AS_STATED = 1.05

#: What a check was: as pages say it, and as plain JSON values.
Source = tuple[tuple[str, str], dict[str, Any]]

_CODES = {"load": "alarm-load", "step": "alarm-step", "creep": "alarm-creep"}
_ALARMS = (*_CODES.values(), "alarm-together")


def day(month: float) -> str:
    """Date of a time in months since 1970."""
    return f"{date_of(month):%Y-%m-%d}"


def finding(life: Life, alarm: Alarm) -> Finding:
    """One alarm as a finding, with the last check that saw it as it was, and the first after."""
    which = slice(None) if alarm.sensor is None else slice(alarm.sensor, alarm.sensor + 1)
    before = np.flatnonzero(np.any(life.seen[: alarm.onset, which], axis=1))
    names, onset, raised = layout.short(life.names), alarm.onset, day(life.month[alarm.raised])
    since, last = f"by {day(life.month[onset])}", day(life.month[before[-1]]) if len(before) else ""
    if last:
        since = f"between {last} and {day(life.month[onset])}"
    if last == day(life.month[onset]):
        since = f"between {names[before[-1]]} and {names[onset]}"
    values: dict[str, Value] = {
        "since": since, "check": names[onset], "onset": day(life.month[onset]), "raised": raised,
        "late": "" if alarm.raised == onset else raised, "change": alarm.turn.tolist(),
        "change_95": (INTERVAL_FACTOR * alarm.std).tolist(),
        "std": alarm.size_std,
    }  # fmt: skip
    if alarm.sensor is None:
        code = _CODES[alarm.kind] if alarm.kind == "load" else "alarm-together"
        return Finding(code, (), None, "", alarm.p_value, values=values, rejects=True)
    subject, code = (life.supports[alarm.sensor],), _CODES[alarm.kind]
    return Finding(code, subject, alarm.size, "rad", alarm.p_value, values=values, rejects=True)


@record(eq=False)
class History:
    """A rig's history.

    findings : what its reader must know, alarms too; others that reject are of campaigns that take
    no part, though the result wants them, and are said first. checks : what each was, in the order
    of time.
    making : of what all was made.
    """

    rig: Rig
    life: Life
    findings: tuple[Finding, ...]
    checks: tuple[Source, ...]
    making: Making

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Steps and creep, each with the check that raised it."""
        return self.life.alarms

    @property
    def verdict(self) -> str:
        """In a word; where nothing is known of a campaign, that there is no alarm is too much."""
        return "alarm" if self.alarms else "not all judged" if self._unjudged else "no alarm"

    @property
    def _unjudged(self) -> list[Finding]:
        return [found for found in rejecting(self.findings) if found.code not in _ALARMS]

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Lay out verdict, what was not judged, alarms, state, angles."""
        life, alarms, unjudged = self.life, self.alarms, self._unjudged
        lost = [found for found in self.findings if found.code in _NO_PART]
        raised = [found for found in self.findings if found.code in _ALARMS]
        slipped = any(found.values.get("cause") == _SLIP for found in unjudged)
        # The slip's own cure says it.
        cures = [cure(found) for found in raised if not (slipped and found.code == "alarm-step")]
        if self.verdict == "no alarm":
            cures = ["check again in a month, and after every work on the rig: tdfscal validate"]
        due = _due(life, alarms, slipped=slipped)
        if self.rig.certificates:
            ends, name = min(self.rig.certificates)
            tense = "ended" if ends < f"{datetime.now(UTC):%Y-%m-%d}" else "ends"
            due += f"; the certificate of {name}'s sensor {tense} on {ends}"
        facts = Facts(tuple(_facts(life, alarms, len(lost), due)))
        verdict = self.verdict
        if slipped and not alarms:
            verdict = "slip"
        elif lost and not alarms and not unjudged:
            verdict = f"no alarm; {len(lost)} of {len(life.names) + len(lost)} checks left out"
        by_file = any(found.code == "checks-undated" for found in self.findings)
        checks = (fact for fact, _ in self.checks)
        return Report(
            title=f"{self.rig.name}: history of {count(len(life.names), 'check')}",
            subtitle=f"{day(life.month[0])} to {day(life.month[-1])}, by date of measurement"
            + (", where nothing says it by the file's date" if by_file else ""),
            verdict=verdict.upper(),
            accepted=not alarms and not unjudged,
            provisional=bool(lost),
            reasons=(*map(told, unjudged), *map(sentence, raised)),
            summary=(facts,),
            sections=(
                Section("State", (facts,)),
                *layout.illustrated(drawings, {}),
                Section("Angles now", (_angles(life),)),
                campaign((("Serial number", self.rig.serial),), self.rig),
                self.making.section(*checks, _chart_rule(life), page_only=False),
            ),
            warnings=tuple(told(found) for found in self.findings if not found.rejects),
            advice=(
                *certificates(self.findings),
                *(begun(text, ".") for text in dict.fromkeys(cures)),
            ),
            created=layout.utc(self.making.created),
        )

    def document(self) -> dict[str, Any]:
        """Plain JSON values: SI units, rad, dates in ISO 8601."""
        life, due = self.life, self.life.due
        when = (life.month[-1],) * 2 if _turned(self.alarms) else (due.month, due.earliest)
        dates = [None if month is None else day(month) for month in when]
        return layout.document(
            self,
            "rig=rig.name verdict supports=life.supports false_alarms_per_year=life.rate "
            "birge=life.birge",
            **self.making.document(),
            verified=not rejecting(self.findings),
            checks=[_check(life, k) | source for k, (_, source) in enumerate(self.checks)],
            alarms=[_alarm(life, alarm) for alarm in self.alarms],
            walk={
                "declared": life.declared,
                "estimate": None if life.walk is None else life.walk.value,
                "interval": None if life.walk is None else [life.walk.low, life.walk.high],
                "unit": "rad/√month",
            },
            next_calibration=layout.document(
                due, "turn_std=now limit",
                date=dates[0], earliest=dates[1], support=life.supports[due.sensor],
            ),
            detectable_step={
                "power": DETECTION_POWER,
                "supports": layout.each_named(life.supports, rpy=life.detectable),
            },
        )  # fmt: skip


def _smallest(life: Life) -> str:
    """The turn of each sensor, mrad, from which on the last check shows it."""
    seen = zip(life.supports, life.detectable.max(axis=1), strict=True)
    return ", ".join(
        f"{name} {measured(1e3 * x)} mrad" if np.isfinite(x) else f"{name} none" for name, x in seen
    )


def _chart_rule(life: Life) -> tuple[str, str]:
    """What the chart asks, and how often it errs."""
    *shorter, longest = map(str, WINDOWS)
    rule = (
        f"an alarm is raised where the last {', '.join(shorter)} or {longest} checks show a sensor "
        "turned against all checks before, by more than drift.angle allows (χ² of a turn of that "
        "one alone), or all sensors together changed. All tests of a check share its level "
        f"({rounded(life.level[-1])} for the last), so that an unchanged rig raises at most "
        f"{rounded(life.rate)} false alarms a year, however often it is checked{FIXED}"
    )
    return "Decision rule", rule


def _facts(life: Life, alarms: tuple[Alarm, ...], lost: int, due: str) -> Iterator[tuple[str, str]]:
    months = life.month[-1] - life.month[0]
    several = day(life.month[0]) != day(life.month[-1])
    time = f" in {months:.1f} months" if several else " of one day"
    yield "checks", f"{len(life.names)}{time}" + f"; {lost} more left out" * bool(lost)
    yield "alarms", f"{len(alarms)}" + " in the checks judged" * bool(lost)
    yield "false alarms", f"at most {rounded(life.rate)} a year while nothing changes"
    seen = f"{_smallest(life)} (by the last check alone, at once, with {DETECTION_POWER:.0%} "
    yield "turn surely seen", f"{seen}probability; smaller ones later, or by chance)"
    stated = f"the rig file states {rounded(1e3 * life.declared)} mrad/√month"
    walk = f"{stated}; checks or days are too few to estimate it"
    if life.walk is not None:
        most, low, high = (
            measured(1e3 * x) for x in (life.walk.value, life.walk.low, life.walk.high)
        )
        walk = f"{most} mrad/√month by the checks (95 %: {low} to {high}); {stated}"
    yield "random walk", walk
    yield "next calibration", due
    if life.birge > _AS_STATED:
        scatter = f"{life.birge:.2f} times what is stated; all uncertainties were scaled by it"
        yield "scatter of checks", scatter


def _turned(alarms: Sequence[Alarm]) -> bool:
    """Whether the sensors are no longer mounted as was calibrated; another load turns none."""
    return any(alarm.kind != "load" for alarm in alarms)


def _due(life: Life, alarms: Sequence[Alarm], *, slipped: bool) -> str:
    if slipped or _turned(alarms):
        return "now: the mounting has changed"
    due, name = life.due, life.supports[life.due.sensor]
    now = f"{name} is at {measured(1e3 * due.now)} of {measured(1e3 * due.limit)} mrad"
    if due.now >= due.limit:
        return f"now: {now}"
    months = life.month[-1] - life.month[0]
    if due.month is not None:
        said = f"by {day(due.month)}, by the most that the history allows"
    elif due.earliest is None:
        said = "no date: no walk is declared, and checks or days are too few to tell one"
    elif due.earliest - life.month[-1] >= LONGEST_INTERVAL:
        said = "within two years, though no limit is reached till then"
    else:
        told = f"these {months:.1f} months" if months >= _SAID else "so few days"
        said = f"by {day(due.earliest)}, as far as {told} tell"
    return f"{said} ({now}); check monthly (tdfscal validate)"


def _angles(life: Life) -> Table:
    """Where the sensors stand, by all checks together."""
    known = np.flatnonzero(life.known)
    rows = by_angle(
        np.array(life.supports)[known].tolist(),
        mrad_with(life.path[-1, known], life.path_std[-1, known]),
    )
    names = zip(life.supports, life.known, strict=True)
    rows += tuple((name, "undetermined", "") for name, seen in names if not seen)
    caption = "By all checks together, mrad, 95 %"
    return Table(caption, ("sensor", "angle", "now"), rows, left=2)


def _check(life: Life, k: int) -> dict[str, Any]:
    """One check; None for the angles of sensors of which it, or no check, says anything."""
    own = {"rpy": life.rpy, "rpy_std": life.rpy_std, "limit_rpy": life.limit}
    smoothed = {"path_rpy": life.path, "path_rpy_std": life.path_std, "mean_rpy": life.mean}
    seen = life.seen[k]
    return {
        "name": life.names[k],
        "date": day(life.month[k]),
        **{key: _where(values[k], seen) for key, values in own.items()},
        **{key: _where(values[k], life.known) for key, values in smoothed.items()},
        "p_value": life.smallest[k],
        "level": life.level[k],
    }


def _where(values: Any, seen: Any) -> list[Any]:
    return [row if known else None for row, known in zip(values, seen, strict=True)]


def _alarm(life: Life, alarm: Alarm) -> dict[str, Any]:
    found = finding(life, alarm)
    return layout.document(
        alarm,
        "kind turn turn_std=std p_value",
        support=None if alarm.sensor is None else life.supports[alarm.sensor],
        onset=day(life.month[alarm.onset]),
        onset_check=life.names[alarm.onset],
        raised=day(life.month[alarm.raised]),
        per="month" if alarm.kind == "creep" else None,
        code=found.code,
        text=sentence(found),
    )
