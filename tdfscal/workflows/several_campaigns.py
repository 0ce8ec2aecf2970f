"""Several campaigns of one rig, each in a folder with a rig.yaml of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.catalogue import sentence, told
from tdfscal.checks.same_rig import different_constants
from tdfscal.comparison.misfit import Misfit
from tdfscal.comparison.pooling import Pool, Recorded, pool
from tdfscal.errors import DataError, TdfscalError, UsageError
from tdfscal.files.calibration.assembled import Provenance
from tdfscal.files.calibration.statistics import campaign_document
from tdfscal.findings import Finding, Value
from tdfscal.model.parameters import layout
from tdfscal.records import Acceptance, InputFile, Measured, Rig, Rotations
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.preparation import usable_postures
from tdfscal.significance import MOST_REJECTED
from tdfscal.workflows.calibration import Calibration, as_calibration
from tdfscal.workflows.campaign import resolve
from tdfscal.workflows.log_pass import LogPass, Settings
from tdfscal.workflows.recordings import Recording, measured, refuse_repeated
from tdfscal.workflows.samples import Own, calibrate_motion
from tdfscal.workflows.survey import surveyed


@dataclass(frozen=True, slots=True, kw_only=True)
class Read(Recording):
    """A campaign that was read: its dwells, or its tracker's survey, and when it was measured."""

    measured: Measured
    rig: Rig
    log: LogPass
    survey: Rotations | None = None


def read_campaign(paths: Sequence[Path], settings: Settings, rig: Path | None = None) -> Read:
    """Read one campaign's log, or its tracker's survey where there is none.

    Raises TdfscalError by cause; it names the campaign.
    """
    log = LogPass(resolve(paths, rig), settings)
    name, dwells, survey = str(paths[0]), None, None
    inputs: Sequence[InputFile] = log.inputs
    if log.campaign.logs:
        with _naming(name), log.explaining():
            dwells = log.dwells()
    else:
        found, inputs, _ = surveyed(log.campaign, 0, np.random.default_rng(0))
        survey = found.rotations
    return Read(
        name=name,
        inputs=tuple(inputs),
        measured=measured(log),
        rig=log.rig,
        dwells=dwells,
        samples=log.samples,
        log=log,
        survey=survey,
    )


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
        return Recorded(read.name, month, rig, survey=read.survey)
    with _naming(read.name), read.log.explaining():
        moving = calibrate_motion(read.log, read.dwells, rig)
        if moving is not None:
            return Recorded(read.name, month, rig, estimate=moving.calibrated)
        return Recorded(read.name, month, rig, usable_postures(rig, read.dwells).postures)


def rejected_alone(read: Read) -> Finding | None:
    """Why `calibrate` rejects a campaign's dwells by themselves, however well they know the angles.

    None where it does not, or where they do not suffice to be judged alone.
    """
    if read.dwells is None or not len(read.dwells):
        return None
    limits = Acceptance(angle_std=np.inf, birge_max=read.rig.acceptance.birge_max)
    rig = replace(read.rig, acceptance=limits)
    try:
        alone = self_calibrate(rig, read.dwells, rng=np.random.default_rng(0), max_trials=0)
    except TdfscalError:
        return None
    return next(iter(alone.reasons), None)


def unsound(campaigns: Sequence[Read]) -> dict[str, Finding]:
    """Campaigns whose own data do not agree among themselves, by name, each with why."""
    return {read.name: why for read in campaigns if (why := rejected_alone(read)) is not None}


def left_out(campaigns: Mapping[str, Finding], *, rejects: bool = False) -> tuple[Finding, ...]:
    """Say that these campaigns say nothing of any turn; rejects : since too few others do."""
    code = "campaign-unsound" if rejects else "campaign-left-out"
    return tuple(
        Finding(code, (name,), values={"why": sentence(why)}, rejects=rejects)
        for name, why in campaigns.items()
    )


def require_one_rig(first: Rig, other: Rig, where: str, than: str) -> None:
    """Raise UsageError where two rigs state different constants."""
    found = different_constants(first, other)
    if found:
        raise UsageError(
            f"this is another rig than that of {than}: {'; '.join(found)}",
            where=where,
            hint="campaigns of one rig state the same supports, hinges and uncertainties; correct "
            "the rig file, or calibrate the rigs one by one",
        )


def calibrate_several(groups: Sequence[Sequence[Path]], settings: Settings) -> Calibration:
    """Calibrate from several campaigns: common angles, zeros and load of each campaign its own.

    The angles are those at the time of the last campaign with a log. One that the gate rejects by
    itself takes no part, as long as two others do.
    """
    rigs = [(str(group[0]), resolve(group).rig.rig) for group in groups]
    for name, rig in rigs[1:]:
        require_one_rig(rigs[0][1], rig, name, rigs[0][0])
    campaigns = [read_campaign(group, settings) for group in groups]
    refuse_repeated(campaigns)
    ordered = sorted(campaigns, key=lambda read: read.measured.month)
    if all(read.dwells is None for read in ordered):
        raise UsageError(
            "none of the campaigns has a log",
            where=", ".join(read.name for read in ordered),
            hint="calibrate surveys one by one, and compare them",
        )
    _require_dates(ordered)
    settings.progress.stage(f"pooling {len(ordered)} campaigns")
    rejected = unsound(ordered)
    sound = [read for read in ordered if read.name not in rejected]
    enough = len(sound) > 1 and any(read.dwells is not None for read in sound)
    said = left_out(rejected, rejects=not enough)
    ordered = sound if enough else ordered
    last = max(k for k, read in enumerate(ordered) if read.dwells is not None)
    return _result(ordered, last, pool([recorded(read) for read in ordered]), said)


def _require_dates(ordered: Sequence[Read]) -> None:
    """Where angles walk the order of the campaigns and their distances matter."""
    if ordered[-1].rig.drift.angle == 0:
        return
    for read in ordered:
        if read.measured.source == "file":
            raise DataError(
                "drift.angle is declared, but nothing says when this was recorded",
                where=read.name,
                hint="state campaign.date in its rig.yaml, or record with a wall clock",
            )


def _result(
    ordered: Sequence[Read], last: int, pooled: Pool, said: tuple[Finding, ...]
) -> Calibration:
    read = ordered[last]
    settings = read.log.settings
    inputs = tuple(entry for item in ordered for entry in item.inputs)
    informed = replace(read.rig, earlier=pooled.others(read.rig, last))
    with read.log.explaining():
        own = calibrate_informed(read, informed, settings.trials, inputs)
    reasons = [*map(misfit_finding, pooled.misfits), *_lost(ordered, pooled, last)]
    origin = Provenance(
        read.log.campaign.rig,
        inputs,
        settings.command,
        settings.seed,
        measured=Measured(
            min(item.measured.begin for item in ordered),
            max(item.measured.end for item in ordered),
            read.measured.source,
        ),
        campaigns=_campaigns(ordered, pooled),
    )
    own = replace(own, findings=(*own.findings, *reasons, *said))
    return as_calibration(own, origin, _notes(ordered, last))


def calibrate_informed(
    read: Read, informed: Rig, trials: int | None, inputs: tuple[InputFile, ...]
) -> Own:
    """Calibrate from a campaign's dwells or motion, by a rig with earlier knowledge.

    Of a log with few dwells that which determines the zeros better.
    """
    assert read.dwells is not None
    moving = calibrate_motion(read.log, read.dwells, informed, inputs)
    if moving is not None and not len(read.dwells):
        return moving
    still = self_calibrate(
        informed,
        read.dwells,
        rng=np.random.default_rng(read.log.settings.seed).spawn(2)[0],
        max_trials=trials,
        inputs=inputs,
        progress=read.log.progress.stage,
    )
    if moving is None:
        return still
    zero = layout(informed.n)["zero"]
    spread = still.uncertainty.parameter_std[zero]
    surer = np.sum(moving.uncertainty.turns.parameter_std[zero] ** 2) < np.sum(spread**2)
    return moving if surer else still


def _campaigns(ordered: Sequence[Read], pooled: Pool) -> tuple[Mapping[str, Any], ...]:
    described = []
    for k, (read, member) in enumerate(zip(ordered, pooled.members, strict=True)):
        described.append(
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
        )
    return tuple(described)


def misfit_finding(misfit: Misfit, *, since: str | None = None) -> Finding:
    """A campaign that does not fit the others, or an earlier calibration (since)."""
    code, size = "misfit-unexplained", None
    values: dict[str, Value] = {
        "campaign": misfit.campaign,
        "than": since or "the other campaigns",
        "updating": since is not None,
    }
    if misfit.sensor is not None:
        code, size = "misfit-turned", float(np.linalg.norm(misfit.turn))
    elif misfit.cause is not None:
        code = f"misfit-{misfit.cause}"
    subject = (misfit.campaign,) if misfit.sensor is None else (misfit.sensor,)
    unit = "" if size is None else "rad"
    return Finding(code, subject, size, unit, misfit.p_value, values=values, rejects=True)


def _lost(ordered: Sequence[Read], pooled: Pool, last: int) -> list[Finding]:
    """Campaigns of which more postures had to be left out than a faultless one loses."""
    found = []
    for k, (read, member) in enumerate(zip(ordered, pooled.members, strict=True)):
        count = 0 if member.fit is None else len(member.fit.weight)
        if k != last and len(member.rejected) > MOST_REJECTED * count:
            values: dict[str, Value] = {"postures": count, "limit": MOST_REJECTED}
            lost = len(member.rejected)
            found.append(
                Finding(
                    "campaign-postures-rejected", (read.name,), lost, values=values, rejects=True
                )
            )
    return found


def _notes(ordered: Sequence[Read], last: int) -> tuple[Finding, ...]:
    """What the logs of the other campaigns say."""
    return tuple(
        Finding("campaign-remark", (read.name,), values={"said": told(found)})
        for k, read in enumerate(ordered)
        if k != last
        for found in read.log.messages
    )
