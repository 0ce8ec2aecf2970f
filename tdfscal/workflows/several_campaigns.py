"""Several campaigns of one rig, each in a folder with a rig.yaml of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.checks.same_rig import different_constants
from tdfscal.comparison.misfit import Misfit
from tdfscal.comparison.pooling import Pool, Recorded, pool
from tdfscal.errors import DataError, TdfscalError, UsageError
from tdfscal.files.calibration.assembled import Provenance
from tdfscal.files.calibration.from_results import from_motion, from_self
from tdfscal.files.calibration.statistics import campaign_document
from tdfscal.logs import TimeWindow
from tdfscal.model.parameters import layout
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.numerics.distributions import p_text
from tdfscal.records import Dwells, InputFile, Measured, Rig, Rotations
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.preparation import usable_postures
from tdfscal.significance import MOST_REJECTED
from tdfscal.workflows.calibration import Calibration, Records
from tdfscal.workflows.campaign import Campaign, resolve
from tdfscal.workflows.log_pass import LogPass
from tdfscal.workflows.measured import measured
from tdfscal.workflows.progress import Progress
from tdfscal.workflows.recorded_once import Recording, refuse_repeated
from tdfscal.workflows.samples import Own, calibrate_motion
from tdfscal.workflows.survey import surveyed


@dataclass(frozen=True, slots=True)
class Read:
    """A campaign that was read: its dwells, or its tracker's survey, and when it was measured."""

    name: str
    campaign: Campaign
    log: LogPass
    dwells: Dwells | None
    survey: Rotations | None
    measured: Measured
    inputs: tuple[InputFile, ...]


def read_campaign(
    paths: Sequence[Path],
    progress: Progress,
    *,
    salvage: bool = False,
    part: TimeWindow | None = None,
    rig: Path | None = None,
) -> Read:
    """Read one campaign's log, or its tracker's survey where there is none.

    Raises TdfscalError by cause; it names the campaign.
    """
    campaign = resolve(paths, rig)
    log = LogPass(campaign, progress, salvage, part)
    name = str(paths[0])
    if not campaign.logs:
        survey, files, _ = surveyed(campaign, 0, np.random.default_rng(0))
        return Read(name, campaign, log, None, survey.rotations, measured(log), tuple(files))
    with _naming(name), log.explaining():
        dwells = log.dwells()
    return Read(name, campaign, log, dwells, None, measured(log), tuple(log.inputs))


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
    rig, month = read.campaign.rig.rig, read.measured.month
    if read.dwells is None:
        return Recorded(read.name, month, rig, survey=read.survey)
    with _naming(read.name), read.log.explaining():
        moving = calibrate_motion(read.log, read.dwells, rig)
        if moving is not None:
            return Recorded(read.name, month, rig, estimate=moving.calibrated)
        return Recorded(read.name, month, rig, usable_postures(rig, read.dwells).postures)


def recording(read: Read) -> Recording:
    """What tells a campaign's recording from another."""
    return Recording(read.name, read.inputs, read.measured, read.campaign.rig.rig, read.dwells)


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


def calibrate_several(
    groups: Sequence[Sequence[Path]],
    *,
    trials: int | None,
    seed: int,
    salvage: bool,
    part: TimeWindow | None,
    command: str,
    progress: Progress,
) -> Calibration:
    """Calibrate from several campaigns: common angles, zeros and load of each campaign its own.

    The angles are those at the time of the last campaign with a log.
    """
    rigs = [(str(group[0]), resolve(group).rig.rig) for group in groups]
    for name, rig in rigs[1:]:
        require_one_rig(rigs[0][1], rig, name, rigs[0][0])
    campaigns = [read_campaign(group, progress, salvage=salvage, part=part) for group in groups]
    refuse_repeated([recording(read) for read in campaigns])
    ordered = sorted(campaigns, key=lambda read: read.measured.month)
    if all(read.dwells is None for read in ordered):
        raise UsageError(
            "none of the campaigns has a log",
            where=", ".join(read.name for read in ordered),
            hint="calibrate surveys one by one, and compare them",
        )
    last = max(k for k, read in enumerate(ordered) if read.dwells is not None)
    _require_dates(ordered)
    progress.stage(f"pooling {len(ordered)} campaigns")
    pooled = pool([recorded(read) for read in ordered])
    return _result(ordered, last, pooled, trials, seed, command, progress)


def _require_dates(ordered: Sequence[Read]) -> None:
    """Where angles walk the order of the campaigns and their distances matter."""
    if ordered[-1].campaign.rig.rig.drift.angle == 0:
        return
    for read in ordered:
        if read.measured.source == "file":
            raise DataError(
                "drift.angle is declared, but nothing says when this was recorded",
                where=read.name,
                hint="state campaign.date in its rig.yaml, or record with a wall clock",
            )


def _result(
    ordered: Sequence[Read],
    last: int,
    pooled: Pool,
    trials: int | None,
    seed: int,
    command: str,
    progress: Progress,
) -> Calibration:
    read = ordered[last]
    assert read.dwells is not None
    rig = read.campaign.rig.rig
    informed = replace(rig, earlier=pooled.others(rig, last))
    inputs = tuple(entry for item in ordered for entry in item.inputs)
    with read.log.explaining():
        own = calibrate_informed(read, informed, trials, seed, inputs, progress)
    reasons = [*own.reasons, *map(misfit_text, pooled.misfits), *_lost(ordered, pooled, last)]
    origin = Provenance(
        read.campaign.rig,
        inputs,
        command,
        seed,
        measured=Measured(
            min(item.measured.begin for item in ordered),
            max(item.measured.end for item in ordered),
            read.measured.source,
        ),
        campaigns=_campaigns(ordered, pooled),
    )
    return as_calibration(own, tuple(dict.fromkeys(reasons)), origin, _notes(ordered, last))


def calibrate_informed(
    read: Read,
    informed: Rig,
    trials: int | None,
    seed: int,
    inputs: tuple[InputFile, ...],
    progress: Progress,
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
        rng=np.random.default_rng(seed).spawn(2)[0],
        max_trials=trials,
        inputs=inputs,
        progress=progress.stage,
    )
    if moving is None:
        return still
    zero = layout(informed.n)["zero"]
    spread = still.uncertainty.parameter_std[zero]
    surer = np.sum(moving.uncertainty.turns.parameter_std[zero] ** 2) < np.sum(spread**2)
    return moving if surer else still


def as_calibration(
    own: Own, reasons: tuple[str, ...], origin: Provenance, notes: Sequence[str]
) -> Calibration:
    """Return the result whose file lists several campaigns."""
    if isinstance(own, MotionCalibration):
        own = replace(own, reasons=reasons)
        return Calibration.of(from_motion(own, origin, notes), Records(motion=own))
    own = replace(own, reasons=reasons)
    return Calibration.of(from_self(own, origin, notes), Records(own))


def _campaigns(ordered: Sequence[Read], pooled: Pool) -> tuple[Mapping[str, Any], ...]:
    described = []
    for k, read in enumerate(ordered):
        state, std = pooled.own_state(read.campaign.rig.rig, k)
        member = pooled.members[k]
        used = 0 if member.fit is None else int(np.sum(member.fit.weight > 0))
        described.append(
            campaign_document(
                read.name,
                read.measured,
                read.inputs,
                state,
                std,
                read.campaign.rig.rig.axes,
                postures=used,
                chi2=member.chi2,
                dof=max(member.dof, 0),
            )
        )
    return tuple(described)


def misfit_text(misfit: Misfit) -> str:
    """A campaign that does not fit the others, in words."""
    size = 1e3 * float(np.linalg.norm(misfit.turn))
    return (
        f"{misfit.campaign} does not fit the other campaigns ({p_text(misfit.p_value)}): "
        f"{misfit.sensor} seems turned by {size:.2g} mrad there; leave it out, or calibrate the "
        "campaigns before and after apart"
    )


def _lost(ordered: Sequence[Read], pooled: Pool, last: int) -> list[str]:
    """Campaigns of which more postures had to be left out than a faultless one loses."""
    found = []
    for k, (read, member) in enumerate(zip(ordered, pooled.members, strict=True)):
        count = 0 if member.fit is None else len(member.fit.weight)
        if k != last and len(member.rejected) > MOST_REJECTED * count:
            found.append(
                f"{len(member.rejected)} of {count} postures of {read.name} had to be rejected, "
                f"above the limit of {MOST_REJECTED:.0%}"
            )
    return found


def _notes(ordered: Sequence[Read], last: int) -> tuple[str, ...]:
    """What the logs of the other campaigns say."""
    return tuple(
        f"{read.name}: {text}"
        for k, read in enumerate(ordered)
        if k != last
        for text in read.log.messages
    )
