"""Campaigns of one rig: what each says by itself, which take part, and all of them pooled."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from copy import copy
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.catalogue import cure, sentence, severity
from tdfscal.catalogue.campaign import SUSPECTS
from tdfscal.commands.calibrate import Own, calibrate_few, origin_of
from tdfscal.commands.campaign import PathLike, day
from tdfscal.commands.earlier import Earlier
from tdfscal.commands.log_pass import Settings, drafted
from tdfscal.commands.recordings import (
    Read,
    Recording,
    Unusable,
    left_out,
    read_campaigns,
    refuse_repeated,
)
from tdfscal.commands.result import Calibration
from tdfscal.comparison.history import Life, life_of, turn_suspected, turns_visible
from tdfscal.comparison.members import Recorded
from tdfscal.comparison.pooling import Pool, pool
from tdfscal.errors import DataError, NotIdentifiableError, TdfscalError, UsageError
from tdfscal.estimation.exact_quantities import exact_quantities, with_unmoved
from tdfscal.files.calibration.compared import defects
from tdfscal.files.calibration.evidence import CampaignResult
from tdfscal.files.calibration.from_results import from_self
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.files.calibration.statistics import campaign
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import independent
from tdfscal.model.parameters import layout, parameter_count
from tdfscal.records import Measured, Rig
from tdfscal.reporting.history import finding as alarm_finding
from tdfscal.reporting.layout import short
from tdfscal.selfcal.pipeline import SelfCalibration, self_calibrate
from tdfscal.selfcal.preparation import usable_postures
from tdfscal.significance import MOST_REJECTED

#: Reasons of the gate that say how badly a campaign fits, not why.
_SYMPTOMS = ("residuals-large", "postures-rejected", "motion-left-out")
#: Those that say how little it knows by itself; the others may know it.
PRECISION = ("angle-uncertain", "contact-uncertain")
#: Sentences that are said of a campaign in a history.
_REMARKS = 3


@record(kw_only=True)
class Judged(Recorded):
    """A campaign with what it gives to a pool, and what is said of it by itself.

    rejected : why `calibrate` rejects it, however well it knows the angles; None where it does
    not, or where it does not suffice to be judged alone. remark : what its log, its postures and
    its residuals ask a reader to know; None where that is nothing.
    """

    read: Read
    rejected: Finding | None = None
    remark: Finding | None = None

    @property
    def measured(self) -> Measured:
        """When it was recorded."""
        return self.read.measured


def judged(read: Read) -> Judged:
    """Take a campaign's dwells, or its motion where they are few, or its survey; and judge it.

    Raises TdfscalError by cause.
    """
    rig, dwells = read.rig, read.dwells
    alone: Own | None = None
    if dwells is None:
        survey = read.survey
        assert survey is not None
        at, moves = survey.rotations, np.eye(parameter_count(rig.n), 3 * rig.n)
        exact = tuple(one.by(moves) for one in survey.exact)
        given: dict[str, Any] = {
            "estimate": independent(rig, at.rotation, at.covariance),
            "exact": exact,
        }
    else:
        with read.log.explaining():
            moved = calibrate_few(copy(read.log), dwells, read.slow, rig)
            if moved is None:
                given = {"postures": usable_postures(rig, dwells).postures}
            else:
                exact = exact_quantities(moved.fit, moved.estimate.parts)
                given = {"estimate": moved.calibrated, "exact": exact}
        alone = moved
        if moved is None:
            with suppress(TdfscalError):
                rng = np.random.default_rng(0)
                alone = self_calibrate(rig, dwells, rng=rng, max_trials=0)
    if alone is not None:
        given["contributions"] = alone.uncertainty.contributions
    found = Judged(name=read.name, month=read.measured.month, rig=rig, read=read, **given)
    said = "; ".join(_told(read, alone))
    # A cause rather than how badly it fits.
    reasons = [] if alone is None else [r for r in alone.reasons if r.code not in PRECISION]
    if reasons:
        cause = min(reasons, key=lambda reason: reason.code in _SYMPTOMS)
        why = "; ".join(filter(None, (sentence(cause), said)))
        values: dict[str, Value] = {"why": why, "hint": cure(cause), "cause": cause.code}
        return replace(found, rejected=Finding("campaign-left-out", (read.name,), values=values))
    remark = Finding("campaign-remark", (read.name,), values={"said": said}) if said else None
    return replace(found, remark=remark)


def _told(read: Read, alone: Own | None) -> list[str]:
    """What a campaign's log says of itself, what stands for few dwells, and what was left out.

    The first of each kind.
    """
    found = [one for one in read.log.messages if severity(one) == "warns"]
    found += [read.log.stops] if read.log.stops else []
    if isinstance(alone, SelfCalibration):
        found += left_out(alone.rejected.values(), len(alone.dwells))
    elif alone is not None:
        found += (one for one in alone.findings if one.code == "dwells-few")
        found += (stretch.finding for stretch in alone.rejected)
    elif read.dwells is not None:
        found.append(Finding("dwells-unjudged", size=len(read.dwells)))
    first = {one.code: one for one in reversed(found)}
    codes = list(dict.fromkeys(one.code for one in found))[:_REMARKS]
    return [sentence(first[code]).removeprefix(f"{read.name}/") for code in codes]


def usable_campaigns(
    groups: Sequence[Sequence[Path]],
    settings: Settings,
    rig: PathLike | None = None,
    known: Sequence[Earlier] = (),
    before: Sequence[Recording] = (),
) -> tuple[list[Judged], Unusable]:
    """Read campaigns of one rig, as `read_campaigns`, and judge each; and those that are unusable.

    known : calibrations of the same rig. before : recordings that none may hold again.
    """
    like = (known[0].name, known[0].rig) if known else None
    reads, unusable = read_campaigns(groups, settings, rig, like)
    refuse_repeated([*before, *reads])
    found = list[Judged]()
    for read in reads:
        with unusable.noting(read.name):
            found.append(judged(read))
    return found, unusable


def wanted(campaigns: Iterable[Finding]) -> Iterator[Finding]:
    """Say of campaigns that were rejected that the result wants them: it is rejected without."""
    return (replace(found, code="campaign-unsound", rejects=True) for found in campaigns)


def calibrate_informed(read: Read, informed: Rig, trials: int | None) -> Own:
    """Calibrate from a campaign's dwells or motion, by a rig with earlier knowledge.

    Of a log with few dwells that which determines the zeros better. What its residuals say that
    the rig file lacks names the campaign.
    """
    assert read.dwells is not None
    with read.log.explaining():
        own: Own | None = calibrate_few(read.log, read.dwells, read.slow, informed)
        if own is None or len(read.dwells):
            rng = np.random.default_rng(0).spawn(2)[0]
            stage = read.log.progress
            # A motion that tells needs no dwells that do not.
            with suppress(*([DataError, NotIdentifiableError] if own else [])):
                still = self_calibrate(
                    informed, read.dwells, rng=rng, max_trials=trials, progress=stage
                )
                own = still if own is None else min(own, still, key=_zero_std)
    assert own is not None
    named = (
        replace(f, values={**f.values, "campaign": read.name}) if f.code in SUSPECTS else f
        for f in own.findings
    )
    return replace(own, findings=tuple(named))


def _zero_std(own: Own) -> float:
    std = own.uncertainty.parameter_std[layout(own.fit.rig.n)["zero"]]
    return float(np.linalg.norm(std))


def calibrate_several(
    groups: Sequence[Sequence[Path]],
    settings: Settings,
    rig: PathLike | None = None,
    earlier: Earlier | None = None,
) -> Calibration:
    """Calibrate from several campaigns: common angles, zeros and load of each campaign its own.

    The angles are those at the time of the last campaign with a log. One that the gate rejects by
    itself takes no part, as long as others do; one that cannot be used as this rig's takes none
    either, and rejects the result. earlier : a calibration that counts as what stands behind it;
    then the last campaign takes part in any case.
    """
    known, before = [earlier] if earlier else [], earlier.recordings() if earlier else ()
    reads, unusable = usable_campaigns(groups, settings, rig, known, before)
    if not reads:
        raise next(iter(unusable.values()))
    _check([one.read for one in reads], earlier)
    settings.progress("pooling what each says")
    last = [one for one in reads if one.read.dwells is not None][-1]
    rejected = [one for one in reads if one.rejected]
    sound = [one for one in reads if not one.rejected or (earlier and one is last)]
    if len(sound) + len(known) > 1 and any(one.read.dwells is not None for one in sound):
        reads = sound
        last = [one for one in reads if one.read.dwells is not None][-1]
    read, before_them = last.read, []
    if earlier:  # it stands behind them, whatever files without a date say
        month = min(earlier.month, *(one.month for one in reads))
        before_them = [replace(earlier, month=month)]
    pooled = pool([*before_them, *reads])
    life, _ = life_of(read.rig, pooled)
    changes, pooled = _changes(life, pooled, len(before_them))
    at = pooled.index(last)
    known_before = pooled.others(at)
    if not (read.rig.drift.angle or changes):
        known_before = with_unmoved(known_before, life.detectable)
    own = calibrate_informed(read, replace(read.rig, earlier=known_before), settings.trials)
    reasons = [*changes, *_lost(pooled, at), *unusable.findings]
    causes = {reason.code for reason in own.reasons}
    for one in rejected:
        assert one.rejected is not None
        if one not in reads:
            reasons.append(one.rejected)
        elif one is not last or one.rejected.values["cause"] not in causes:  # or it is said already
            reasons += wanted([one.rejected])
    origin = origin_of(
        read.log,
        inputs=tuple(entry for one in reads for entry in one.read.log.inputs),
        measured=_whole([one.measured for one in reads]),
        campaigns=(*(earlier.campaigns if earlier else ()), *_campaigns(reads, pooled)),
        history=earlier.history() if earlier else (),
    )
    remarks = drafted(one.read.log.campaign.rig for one in reads)
    remarks += [one.remark for one in reads if one is not last and one.remark]
    remarks += [said for said in read.log.messages if said not in own.findings]
    remarks += pooled.one_tare()
    remarks += turn_suspected(life, checks=1 if earlier else max(len(reads) - 1, 1))
    if earlier:
        remarks += [*turns_visible(life), *defects(earlier.name, earlier.file)]
    said = own.findings
    if changes and not last.rejected:  # what else rejects it stands on what it does not fit
        said = tuple(f for f in said if not f.rejects or f.code in PRECISION)
    own = replace(own, findings=(*reasons, *said))
    return Calibration.of(from_self(own, origin, remarks))


def _check(reads: Sequence[Read], earlier: Earlier | None) -> None:
    """Refuse campaigns without any log, and those whose order in time is not known or wrong."""
    if all(read.dwells is None for read in reads):
        raise UsageError(
            "none of the campaigns has a log",
            where=", ".join(read.name for read in reads),
            hint="calibrate surveys one by one, and compare them",
        )
    undated = [read.name for read in reads if read.measured.source == "file"]
    if undated and reads[-1].rig.drift.angle > 0 and earlier is None:
        # Where angles walk the order of the campaigns and their distances matter.
        raise DataError(
            "drift.angle is declared, but nothing says when this was recorded",
            where=undated[0],
            hint="state campaign.date in its rig.yaml, or record with a wall clock",
        )
    if earlier is None or earlier.measured.source == "file":
        return
    for read in reads:
        if read.measured.source != "file" and read.measured.end < earlier.measured.begin:
            raise UsageError(
                f"was recorded on {day(read.measured.end)}, before the calibration "
                f"({day(earlier.measured.end)})",
                where=read.name,
                hint="update in the order of time, or give all campaigns to calibrate",
            )


def _whole(each: Sequence[Measured]) -> Measured:
    """From the first to the last, by the least sure of what tells it."""
    source = next(by for by in ("file", "rig", "log") if by in {one.source for one in each})
    return Measured(min(one.begin for one in each), max(one.end for one in each), source)


def _campaigns(reads: Sequence[Judged], pooled: Pool) -> Iterator[CampaignResult]:
    """What the file says of each campaign."""
    for read, index in ((one.read, pooled.index(one)) for one in reads):
        member = pooled.members[index]
        yield campaign(
            *pooled.own_state(index),
            read.rig.axes,
            read.means,
            name=read.name,
            measured=MeasuredResult.of(read.measured),
            inputs=tuple(read.log.inputs),
            rig_sha256=read.log.campaign.rig.sha256,
            span=read.span,
            postures=0 if member.fit is None else int(np.sum(member.fit.weight > 0)),
            chi2=member.chi2,
            dof=max(member.dof, 0),
        )


def _changes(life: Life, pooled: Pool, done: int) -> tuple[list[Finding], Pool]:
    """Why the campaigns are not of one state; and the pool, knowing what turned between them.

    done : how many of the first are calibrations already.
    """
    alarms = life.alarms
    edges = [0, *sorted({alarm.onset for alarm in alarms}), len(life.names)]
    names = short(life.names)
    apart = [
        names[a] if b - a == 1 else f"{names[a]} to {names[b - 1]}"
        for a, b in pairwise(max(edge, done) for edge in edges)
        if a < b
    ]
    values: dict[str, Value] = {
        "apart": apart,
        "parts": len(apart) > 1,
        "creeps": any(a.kind == "creep" for a in alarms),
    }
    steps = [a + b for a, b in zip(pooled.walk.steps, life.jumps, strict=True)]
    found = [
        Finding(
            "campaigns-changed",
            () if alarm.sensor is None else (life.supports[alarm.sensor],),
            alarm.size,
            "rad",
            alarm.p_value,
            values={"said": sentence(alarm_finding(life, alarm)), **values},
            rejects=True,
        )
        for alarm in alarms
    ]
    return found, replace(pooled, walk=replace(pooled.walk, steps=steps))


def _lost(pooled: Pool, last: int) -> Iterator[Finding]:
    """Campaigns of which more postures had to be left out than a faultless one loses."""
    for k, member in enumerate(pooled.members):
        count = 0 if member.fit is None else len(member.fit.weight)
        lost = len(member.rejected)
        if k != last and lost > MOST_REJECTED * count:
            values: dict[str, Value] = {"postures": count, "limit": MOST_REJECTED}
            code = "campaign-postures-rejected"
            yield Finding(code, (member.name,), lost, values=values, rejects=True)
