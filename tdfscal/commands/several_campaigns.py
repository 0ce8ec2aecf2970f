"""Campaigns of one rig: what each says by itself, which take part, and all of them pooled."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.catalogue import cure, sentence, severity
from tdfscal.catalogue.campaign import SUSPECTS
from tdfscal.commands.calibrate import Own, calibrate_motion, origin_of
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.recordings import (
    Read,
    Recording,
    Unusable,
    left_out,
    naming,
    read_campaigns,
    refuse_repeated,
)
from tdfscal.commands.result import Calibration
from tdfscal.comparison.history import life_of
from tdfscal.comparison.misfit import Misfit
from tdfscal.comparison.pooling import Pool, Recorded, pool
from tdfscal.errors import DataError, TdfscalError, UsageError
from tdfscal.estimation.exact_quantities import exact_quantities
from tdfscal.files.calibration.evidence import CampaignResult
from tdfscal.files.calibration.from_results import from_self
from tdfscal.files.calibration.statistics import campaign
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import layout
from tdfscal.records import Measured, Rig
from tdfscal.reporting.history import sentence as alarm_sentence
from tdfscal.reporting.layout import short
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.preparation import usable_postures
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.significance import MOST_REJECTED

#: Reasons of the gate that say how badly a campaign fits, not why.
_SYMPTOMS = ("residuals-large", "postures-rejected", "motion-left-out")
#: Those that say how little it knows by itself; the others may know it.
PRECISION = ("angle-uncertain", "contact-uncertain")
#: Sentences that are said of a campaign in a history.
_REMARKS = 3


@record
class Judged(Read):
    """A campaign with what it gives to a pool, and what is said of it by itself.

    rejected : why `calibrate` rejects it, however well it knows the angles; None where it does
    not, or where it does not suffice to be judged alone. remark : what its log, its postures and
    its residuals ask a reader to know; None where that is nothing.
    """

    recorded: Recorded
    rejected: Finding | None
    remark: Finding | None


def judged(read: Read) -> Judged:
    """Take a campaign's dwells, or its motion where they are few, or its survey; and judge it.

    Raises TdfscalError by cause; it names the campaign.
    """
    rig = read.rig
    alone: Own | None = None
    if read.dwells is None:
        given: dict[str, Any] = {"survey": read.survey, "exact": read.exact}
    else:
        with naming(read.name), read.log.explaining():
            alone = calibrate_motion(read.log, read.dwells, rig)
            if alone is None:
                given = {"postures": usable_postures(rig, read.dwells).postures}
            else:
                exact = exact_quantities(alone.fit, alone.estimate.parts)
                given = {"estimate": alone.calibrated, "exact": exact}
        if alone is None:
            with suppress(TdfscalError):
                alone = self_calibrate(rig, read.dwells, rng=np.random.default_rng(0), max_trials=0)
    said, rejected, remark = "; ".join(_told(read, alone)), None, None
    # A cause rather than how badly it fits.
    reasons = [] if alone is None else [r for r in alone.reasons if r.code not in PRECISION]
    if reasons:
        cause = min(reasons, key=lambda reason: reason.code in _SYMPTOMS)
        why = "; ".join(filter(None, (sentence(cause), said)))
        values: dict[str, Value] = {"why": why, "hint": cure(cause), "cause": cause.code}
        rejected = Finding("campaign-left-out", (read.name,), values=values)
    elif said:
        remark = Finding("campaign-remark", (read.name,), values={"said": said})
    return Judged(
        **{field.name: getattr(read, field.name) for field in fields(Read)},
        recorded=Recorded(
            read.name,
            read.measured.month,
            rig,
            contributions={} if alone is None else alone.uncertainty.contributions,
            **given,
        ),
        rejected=rejected,
        remark=remark,
    )


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
    like: tuple[str, Rig] | None = None,
    before: Sequence[Recording] = (),
) -> tuple[list[Judged], Unusable]:
    """Read campaigns of one rig, as `read_campaigns`, and judge each; and those that are unusable.

    before : recordings that none of them may hold again.
    """
    reads, unusable = read_campaigns(groups, settings, like=like)
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
    own = _informed(read, informed, trials)
    named = (
        replace(f, values={**f.values, "campaign": read.name}) if f.code in SUSPECTS else f
        for f in own.findings
    )
    return replace(own, findings=tuple(named))


def _informed(read: Read, informed: Rig, trials: int | None) -> Own:
    assert read.dwells is not None
    with read.log.explaining():
        moving = calibrate_motion(read.log, read.dwells, informed)
        if moving is not None and not len(read.dwells):
            return moving
        still = self_calibrate(
            informed,
            read.dwells,
            rng=np.random.default_rng(0).spawn(2)[0],
            max_trials=trials,
            progress=read.log.progress,
        )
    if moving is None:
        return still
    zero = layout(informed.n)["zero"]
    moving_std = moving.uncertainty.parameter_std[zero]
    surer = np.linalg.norm(moving_std) < np.linalg.norm(still.uncertainty.parameter_std[zero])
    return moving if surer else still


def calibrate_several(groups: Sequence[Sequence[Path]], settings: Settings) -> Calibration:
    """Calibrate from several campaigns: common angles, zeros and load of each campaign its own.

    The angles are those at the time of the last campaign with a log. One that the gate rejects by
    itself takes no part, as long as two others do; one that cannot be used as this rig's takes
    none either, and rejects the result.
    """
    reads, unusable = usable_campaigns(groups, settings)
    if not reads:
        raise unusable.first
    if all(read.dwells is None for read in reads):
        raise UsageError(
            "none of the campaigns has a log",
            where=", ".join(read.name for read in reads),
            hint="calibrate surveys one by one, and compare them",
        )
    undated = [read.name for read in reads if read.measured.source == "file"]
    if undated and reads[-1].rig.drift.angle > 0:
        # Where angles walk the order of the campaigns and their distances matter.
        raise DataError(
            "drift.angle is declared, but nothing says when this was recorded",
            where=undated[0],
            hint="state campaign.date in its rig.yaml, or record with a wall clock",
        )
    settings.progress(f"pooling {len(reads)} campaigns")
    rejected = {read.name: read.rejected for read in reads if read.rejected}
    sound = [read for read in reads if not read.rejected]
    enough = len(sound) > 1 and any(read.dwells is not None for read in sound)
    reads = sound if enough else reads
    pooled = pool([read.recorded for read in reads])
    last = max(k for k, read in enumerate(reads) if read.dwells is not None)
    read = reads[last]
    changes, pooled = _changes(reads, pooled)
    inputs = tuple(entry for one in reads for entry in one.inputs)
    informed = replace(read.rig, earlier=pooled.others(read.rig, last))
    own = calibrate_informed(read, informed, settings.trials)
    if not enough and read.rejected:  # what it says of itself names its cause once
        said = {reason.code for reason in own.reasons}
        rejected = {
            n: f for n, f in rejected.items() if n != read.name or f.values["cause"] not in said
        }
    reasons = [*changes, *_lost(reads, pooled, last), *unusable.findings]
    reasons += rejected.values() if enough else wanted(rejected.values())
    whole = Measured(
        min(one.measured.begin for one in reads),
        max(one.measured.end for one in reads),
        next(by for by in ("file", "rig", "log") if by in {r.measured.source for r in reads}),
    )
    told = {"inputs": inputs, "measured": whole, "campaigns": _campaigns(reads, pooled)}
    origin = origin_of(read.log, **told)
    remarks = [one.remark for one in reads if one is not read and one.remark]
    remarks += [said for said in read.log.messages if said not in own.findings]
    own = replace(own, findings=(*reasons, *own.findings))
    return Calibration.of(from_self(own, origin, remarks))


def _campaigns(reads: Sequence[Read], pooled: Pool) -> tuple[CampaignResult, ...]:
    """What the file says of each campaign."""
    return tuple(
        campaign(
            *pooled.own_state(read.rig, k),
            read.rig.axes,
            read.means,
            name=read.name,
            measured=read.measured,
            inputs=read.inputs,
            postures=0 if member.fit is None else int(np.sum(member.fit.weight > 0)),
            chi2=member.chi2,
            dof=max(member.dof, 0),
        )
        for k, (read, member) in enumerate(zip(reads, pooled.members, strict=True))
    )


def _changes(reads: Sequence[Read], pooled: Pool) -> tuple[list[Finding], Pool]:
    """Why the campaigns are not of one state; and the pool, knowing what turned between them.

    Turns that the control chart alarms of, unless fewer campaigns that do not fit the others
    explain as much.
    """
    life, _ = life_of(reads[-1].rig, [], pooled)
    alarms, misfits = life.alarms, pooled.misfits
    unnamed = any(alarm.sensor is None for alarm in alarms)
    if not alarms or (misfits and (unnamed or len(misfits) < len(alarms))):
        return [misfit_finding(misfit) for misfit in misfits], pooled
    edges = [0, *sorted({alarm.onset for alarm in alarms}), len(life.names)]
    names = short(life.names)
    apart = [
        names[a] if b - a == 1 else f"{names[a]} to {names[b - 1]}" for a, b in pairwise(edges)
    ]
    values: dict[str, Value] = {"apart": apart, "creeps": any(a.kind == "creep" for a in alarms)}
    steps = [a + b for a, b in zip(pooled.walk.steps, life.jumps, strict=True)]
    found = [
        Finding(
            "campaigns-changed",
            () if alarm.sensor is None else (life.supports[alarm.sensor],),
            alarm.size,
            "rad",
            alarm.p_value,
            values={"said": alarm_sentence(life, alarm), **values},
            rejects=True,
        )
        for alarm in alarms
    ]
    return found, replace(pooled, walk=replace(pooled.walk, steps=steps))


def _lost(reads: Sequence[Read], pooled: Pool, last: int) -> Iterator[Finding]:
    """Campaigns of which more postures had to be left out than a faultless one loses."""
    for k, (read, member) in enumerate(zip(reads, pooled.members, strict=True)):
        count = 0 if member.fit is None else len(member.fit.weight)
        lost = len(member.rejected)
        if k != last and lost > MOST_REJECTED * count:
            values: dict[str, Value] = {"postures": count, "limit": MOST_REJECTED}
            code = "campaign-postures-rejected"
            yield Finding(code, (read.name,), lost, values=values, rejects=True)


def misfit_finding(misfit: Misfit, *, since: str | None = None) -> Finding:
    """A campaign that does not fit the others, or an earlier calibration (since)."""
    code, subject, size = f"misfit-{misfit.cause or 'unexplained'}", misfit.campaign, None
    if misfit.sensor is not None:
        code, subject = "misfit-turned", misfit.sensor
        size = float(np.linalg.norm(misfit.turn))
    values: dict[str, Value] = {
        "campaign": misfit.campaign,
        "than": since or "the other campaigns",
        "updating": since is not None,
    }
    unit = "" if size is None else "rad"
    return Finding(code, (subject,), size, unit, misfit.p_value, values=values, rejects=True)
