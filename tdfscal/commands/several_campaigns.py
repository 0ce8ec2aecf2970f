"""Campaigns of one rig, each in a folder with a rig.yaml of its own, each counted once; pooled."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.catalogue import cure, rigs_apart, sentence, told
from tdfscal.checks.same_rig import different_constants
from tdfscal.commands.arguments import PathLike
from tdfscal.commands.calibrate import origin_of, surveyed
from tdfscal.commands.calibration import Calibration, as_calibration
from tdfscal.commands.campaign import resolve
from tdfscal.commands.log_pass import LogPass, Recording, Settings, measured, refuse_repeated
from tdfscal.commands.samples import Own, calibrate_motion
from tdfscal.comparison.misfit import Misfit
from tdfscal.comparison.pooling import Pool, Recorded, pool
from tdfscal.errors import (
    DataError,
    NotConvergedError,
    NotIdentifiableError,
    OutputError,
    RigError,
    TdfscalError,
    UsageError,
)
from tdfscal.estimation.exact_quantities import exact_quantities
from tdfscal.files.calibration.statistics import campaign_document
from tdfscal.findings import Finding, Value
from tdfscal.model.parameters import layout
from tdfscal.records import Acceptance, ExactMoves, InputFile, Measured, Rig, Rotations
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.preparation import usable_postures
from tdfscal.significance import MOST_REJECTED

#: Reasons of the gate that say how badly a campaign fits, not why.
_SYMPTOMS = ("residuals-large", "postures-rejected")


@dataclass(frozen=True, slots=True, kw_only=True)
class Read(Recording):
    """A campaign that was read: its dwells, or its tracker's survey, and when it was measured.

    exact : how the survey moves with errors of what it took as exact.
    """

    measured: Measured
    rig: Rig
    log: LogPass
    survey: Rotations | None = None
    exact: tuple[ExactMoves, ...] = ()


def read_campaigns(
    groups: Sequence[Sequence[Path]],
    settings: Settings,
    rig: PathLike | None = None,
    like: tuple[str, Rig] | None = None,
) -> tuple[list[Read], Unusable]:
    """Read campaigns of one rig, each by its log, or its survey where it has none.

    like : name and rig whose constants they must state; of the first, if none is given. Returned
    in the order of time, and those that cannot be read by name.

    Raises UsageError where they are of different rigs.
    """
    logs, unusable = list[tuple[str, LogPass]](), Unusable()
    for group in groups:
        with unusable.noting(str(group[0])):
            logs.append((str(group[0]), LogPass(resolve(group, rig), settings)))
    for name, log in logs:
        like = like or (name, log.rig)
        require_one_rig(like, (name, log.rig))
    reads = list[Read]()
    for name, log in logs:
        with unusable.noting(name):
            reads.append(_read(name, log))
    return sorted(reads, key=lambda read: read.measured.month), unusable


class Unusable(dict[str, TdfscalError]):
    """Campaigns that cannot be used, by name, each with what is wrong with it."""

    @contextmanager
    def noting(self, name: str) -> Iterator[None]:
        """Take down what the data or the files of a campaign do not give."""
        try:
            yield
        except OutputError:
            raise
        except (UsageError, RigError, DataError, NotIdentifiableError, NotConvergedError) as error:
            self[name] = error

    @property
    def first(self) -> TdfscalError:
        """What is wrong with the first, to be raised where nothing is left to judge."""
        return next(iter(self.values()))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Name them, each with why; the result wants them."""
        return tuple(
            Finding(
                "campaign-unusable",
                (name,),
                values={"why": error.what, "hint": error.hint or "compare it with the others"},
                rejects=True,
            )
            for name, error in self.items()
        )


def _read(name: str, log: LogPass) -> Read:
    dwells, survey = None, None
    exact: tuple[ExactMoves, ...] = ()
    inputs: Sequence[InputFile] = log.inputs
    if log.campaign.logs:
        with _naming(name), log.explaining():
            dwells = log.dwells()
    else:
        log.messages += log.campaign.lost_log
        found, inputs, _ = surveyed(log.campaign, 0, np.random.default_rng(0))
        survey, exact = found.rotations, found.exact
    return Read(
        name=name,
        inputs=tuple(inputs),
        measured=measured(log),
        rig=log.rig,
        dwells=dwells,
        samples=log.samples,
        log=log,
        survey=survey,
        exact=exact,
    )


def require_one_rig(first: tuple[str, Rig], other: tuple[str, Rig]) -> None:
    """Raise UsageError where two rigs, each with a name to call it by, state other constants."""
    if found := different_constants(first[1], other[1]):
        raise UsageError(rigs_apart(found, "rigs-differ", first=first[0]), where=other[0])


@contextmanager
def _naming(campaign: str) -> Iterator[None]:
    """Let an error name the campaign."""
    try:
        yield
    except TdfscalError as error:
        where = f"{campaign}: {error.where}" if error.where else campaign
        raise error.restated(where=where) from error


def recorded(read: Read) -> Recorded:
    """What `pool` takes of a campaign: its dwells, or what its motion says where they are few.

    Raises TdfscalError by cause; it names the campaign.
    """
    rig, month = read.rig, read.measured.month
    if read.dwells is None:
        return Recorded(read.name, month, rig, survey=read.survey, exact=read.exact)
    with _naming(read.name), read.log.explaining():
        moving = calibrate_motion(read.log, read.dwells, rig)
        if moving is not None:
            exact = exact_quantities(moving.fit)
            return Recorded(read.name, month, rig, estimate=moving.calibrated, exact=exact)
        return Recorded(read.name, month, rig, usable_postures(rig, read.dwells).postures)


def usable_campaigns(campaigns: Sequence[Read], unusable: Unusable) -> dict[str, Recorded]:
    """What `pool` takes of each campaign, by name; those that give nothing become unusable."""
    usable = dict[str, Recorded]()
    for read in campaigns:
        with unusable.noting(read.name):
            usable[read.name] = recorded(read)
    return usable


def rejected_alone(read: Read) -> Finding | None:
    """Why `calibrate` rejects a campaign's dwells by themselves, however well they know the angles.

    A cause rather than how badly they fit. None where it does not reject them, or where they do
    not suffice to be judged alone. Its words, cure and code are values of what is said of it.
    """
    if read.dwells is None or not len(read.dwells):
        return None
    limits = Acceptance(angle_std=np.inf, birge_max=read.rig.acceptance.birge_max)
    rig = replace(read.rig, acceptance=limits)
    try:
        alone = self_calibrate(rig, read.dwells, rng=np.random.default_rng(0), max_trials=0)
    except TdfscalError:
        return None
    reasons = sorted(alone.reasons, key=lambda found: found.code in _SYMPTOMS)
    if not reasons:
        return None
    why = sentence(reasons[0])
    if reasons[0].code == "postures-rejected":
        spoilt = Counter(map(sentence, alone.rejected.values()))
        why = f"{why}: {spoilt.most_common(1)[0][0]}"
    values: dict[str, Value] = {"why": why, "hint": cure(reasons[0]), "cause": reasons[0].code}
    return Finding("campaign-left-out", (read.name,), values=values)


def unsound(campaigns: Sequence[Read]) -> dict[str, Finding]:
    """Campaigns whose own data do not agree among themselves, by name, each with why."""
    return {read.name: why for read in campaigns if (why := rejected_alone(read)) is not None}


def wanted(campaigns: Mapping[str, Finding]) -> tuple[Finding, ...]:
    """Say the same of campaigns that the result wants: it is rejected without them."""
    return tuple(
        replace(found, code="campaign-unsound", rejects=True) for found in campaigns.values()
    )


def calibrate_informed(
    read: Read, informed: Rig, trials: int | None, inputs: tuple[InputFile, ...]
) -> Own:
    """Calibrate from a campaign's dwells or motion, by a rig with earlier knowledge.

    Of a log with few dwells that which determines the zeros better.
    """
    assert read.dwells is not None
    settings = read.log.settings
    with read.log.explaining():
        moving = calibrate_motion(read.log, read.dwells, informed, inputs)
        if moving is not None and not len(read.dwells):
            return moving
        still = self_calibrate(
            informed,
            read.dwells,
            rng=np.random.default_rng(settings.seed).spawn(2)[0],
            max_trials=trials,
            progress=settings.progress.stage,
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
    reads, unusable = read_campaigns(groups, settings)
    refuse_repeated(reads)
    usable = usable_campaigns(reads, unusable)
    if not usable:
        raise unusable.first
    reads = [read for read in reads if read.name in usable]
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
    settings.progress.stage(f"pooling {len(reads)} campaigns")
    rejected = unsound(reads)
    sound = [read for read in reads if read.name not in rejected]
    enough = len(sound) > 1 and any(read.dwells is not None for read in sound)
    reads = sound if enough else reads
    pooled = pool([usable[read.name] for read in reads])
    last = max(k for k, read in enumerate(reads) if read.dwells is not None)
    read = reads[last]
    inputs = tuple(entry for one in reads for entry in one.inputs)
    informed = replace(read.rig, earlier=pooled.others(read.rig, last))
    own = calibrate_informed(read, informed, settings.trials, inputs)
    reasons = [*map(misfit_finding, pooled.misfits), *_lost(reads, pooled, last)]
    reasons += (*unusable.findings, *(rejected.values() if enough else wanted(rejected)))
    whole = Measured(
        min(one.measured.begin for one in reads),
        max(one.measured.end for one in reads),
        next(by for by in ("file", "rig", "log") if by in {r.measured.source for r in reads}),
    )
    origin = origin_of(read.log, inputs, whole, campaigns=_campaigns(reads, pooled))
    remarks = [
        Finding("campaign-remark", (one.name,), values={"said": told(found)})
        for one in reads
        if one is not read
        for found in one.log.messages
    ]
    return as_calibration(replace(own, findings=(*own.findings, *reasons)), origin, remarks)


def _campaigns(reads: Sequence[Read], pooled: Pool) -> tuple[dict[str, Any], ...]:
    """What the file says of each campaign."""
    return tuple(
        campaign_document(
            read.name,
            read.measured,
            read.inputs,
            *pooled.own_state(read.rig, k),
            read.rig.axes,
            postures=0 if member.fit is None else int(np.sum(member.fit.weight > 0)),
            chi2=member.chi2,
            dof=max(member.dof, 0),
        )
        for k, (read, member) in enumerate(zip(reads, pooled.members, strict=True))
    )


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
