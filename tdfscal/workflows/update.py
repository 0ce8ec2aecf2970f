"""`update`: the last calibration, its walk since, and a new campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime

import numpy as np

from tdfscal.comparison.eliminated import eliminate, of_estimate
from tdfscal.comparison.misfit import Misfit, misfit_of
from tdfscal.errors import UsageError
from tdfscal.files.calibration.assembled import Provenance
from tdfscal.files.calibration.document import CALIBRATION_SUFFIXES, save_calibration
from tdfscal.files.calibration.from_results import published_std
from tdfscal.files.calibration.statistics import campaign_document
from tdfscal.files.output_places import PAGE_SUFFIXES, check_outputs
from tdfscal.files.outputs import together
from tdfscal.model.earlier import information_of
from tdfscal.model.parameters import State, retract, starting_state
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.numerics.distributions import p_text
from tdfscal.numerics.information import contrast
from tdfscal.records import FloatArray, Measured, Rig
from tdfscal.selfcal.joint_posterior import from_fit
from tdfscal.significance import CAMPAIGN_MISFIT
from tdfscal.workflows.arguments import Instant, PathLike, PathLikes, at_least, listed, one, window
from tdfscal.workflows.calibration import Calibration, CalibrationSource, paths_of
from tdfscal.workflows.campaign import campaign_folders, resolve
from tdfscal.workflows.earlier import Earlier, read_earlier
from tdfscal.workflows.inputs_read import inputs_read
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.recorded_once import refuse_repeated
from tdfscal.workflows.samples import Own
from tdfscal.workflows.several_campaigns import (
    Read,
    as_calibration,
    calibrate_informed,
    read_campaign,
    recording,
    require_one_rig,
)


@together()
def update(
    calibration: CalibrationSource,
    paths: PathLikes,
    *,
    rig: PathLike | None = None,
    from_: Instant | None = None,
    to: Instant | None = None,
    trials: int | None = None,
    seed: int = 0,
    output: PathLike | None = None,
    html: PathLike | None = None,
    allow_rejected: bool = False,
    salvage: bool = False,
    command: str = "tdfscal.update",
    progress: Progress = SILENT,
) -> Calibration:
    """Bring a calibration up to date with a new campaign: angles, zeros and load.

    The last calibration with its full covariance, widened by the random walk `drift.angle` since,
    is what is known before; one posture is enough to find new zeros.

    Parameters
    ----------
    calibration : the last one, a file or in memory.
    paths : campaign folder or logs; several folders with a rig.yaml each are taken in the order
        of their dates.
    rig : rig.yaml, where no folder holds one.
    from_, to : the part of the log that is used: s of its clock, "1.5min", "2h"; "+90" is after its
        begin; or a date with a time.
    trials : Monte Carlo trials at most; None for the default, 0 for none.
    seed : of all random numbers.
    output : file to write, .yaml or .json. html : report page to write.
    allow_rejected : write them although the quality gate rejects the result.
    salvage : read what is sound of damaged logs; the result is then never accepted.
    command : kept in the file, as what was asked for.
    progress : called as the work goes on.

    Raises
    ------
    TdfscalError
        By cause: UsageError (another rig, a campaign older than the calibration), RigError,
        DataError, NotIdentifiableError, NotConvergedError.
    """
    target, page, rig_file, files = one(output), one(html), one(rig), listed(paths)
    at_least("--trials", trials or 0, 0)
    at_least("--seed", seed, 0)
    check_outputs(
        {"--output": target, "--html": page},
        inputs_read(files, rigs=[rig_file], files=paths_of([calibration])),
        {"--output": CALIBRATION_SUFFIXES, "--html": PAGE_SUFFIXES},
    )
    part = window(from_, to)
    earlier = read_earlier(calibration)
    groups = campaign_folders(files, rig_file)
    for group in groups:
        new = resolve(group, rig_file).rig.rig
        require_one_rig(earlier.rig, new, str(group[0]), earlier.name)
    campaigns = [
        read_campaign(group, progress, salvage=salvage, part=part, rig=rig_file) for group in groups
    ]
    campaigns.sort(key=lambda read: read.measured.month)
    _check(earlier, campaigns)
    for k, read in enumerate(campaigns):
        last = k == len(campaigns) - 1
        result = _updated(earlier, read, trials if last else 0, seed, command, progress)
        if not last:
            earlier = read_earlier(result)
    if target is not None and (result.accepted or allow_rejected):
        save_calibration(result, target)
    result.save_figures(None, progress, page)  # whatever the verdict
    return result


def _check(earlier: Earlier, campaigns: Sequence[Read]) -> None:
    """Refuse what cannot follow the calibration."""
    refuse_repeated([*earlier.recordings(), *(recording(read) for read in campaigns)])
    for read in campaigns:
        if read.dwells is None:
            raise UsageError(
                "there is no log to update from",
                where=read.name,
                hint="calibrate the survey on its own, and compare",
            )
        told = "file" not in (read.measured.source, earlier.measured.source)
        if told and read.measured.end < earlier.measured.begin:
            raise UsageError(
                f"was recorded on {_day(read.measured)}, before the calibration "
                f"({_day(earlier.measured)})",
                where=read.name,
                hint="update in the order of time, or give all campaigns to calibrate",
            )


def _updated(
    earlier: Earlier, read: Read, trials: int | None, seed: int, command: str, progress: Progress
) -> Calibration:
    rig = read.campaign.rig.rig
    assert read.dwells is not None
    informed = replace(rig, earlier=earlier.prior(rig, read.measured.month))
    with read.log.explaining():
        own = calibrate_informed(read, informed, trials, seed, read.inputs, progress)
    found, chi2, dof = _departure(informed, own, read.name)
    reasons = own.reasons
    if found.p_value <= CAMPAIGN_MISFIT:
        reasons += (_text(found, earlier),)
    state, std = _place(own)
    this = campaign_document(
        read.name,
        read.measured,
        read.inputs,
        state,
        _as_state(state, std),
        rig.axes,
        postures=own.dwells if isinstance(own, MotionCalibration) else int(sum(own.fit.weight > 0)),
        chi2=chi2,
        dof=dof,
    )
    origin = Provenance(
        read.campaign.rig,
        read.inputs,
        command,
        seed,
        measured=read.measured,
        campaigns=(*earlier.campaigns(), this),
        history=earlier.history(),
    )
    notes = () if earlier.file.accepted else (f"{earlier.name} is a rejected calibration",)
    return as_calibration(own, reasons, origin, notes)


def _departure(rig: Rig, own: Own, name: str) -> tuple[Misfit, float, int]:
    """The new campaign against all that was known before it; χ² and dof that it adds."""
    assert rig.earlier is not None
    reference = starting_state(rig)
    if isinstance(own, MotionCalibration):
        part = of_estimate(own.calibrated, information_of(rig, rig.earlier), reference)
        departure = contrast(information_of(rig, rig.earlier), part.information)
        return misfit_of(rig, name, part), *departure.chi2()
    part = eliminate(own.fit, reference)
    return misfit_of(rig, name, part), own.quality.chi2, max(own.quality.dof, 0)


def _place(own: Own) -> tuple[State, FloatArray]:
    """Estimate and standard uncertainties (P,), as the file publishes them."""
    if isinstance(own, MotionCalibration):
        given, std = own.calibrated, own.uncertainty.turns.parameter_std
    else:
        given = from_fit(own.fit, own.uncertainty.covariance)
        std = own.uncertainty.parameter_std
    return given.state, published_std(given, std)


def _text(found: Misfit, earlier: Earlier) -> str:
    size = 1e3 * float(np.linalg.norm(found.turn))
    return (
        f"{found.sensor} seems turned by {size:.2g} mrad since {earlier.name} "
        f"({p_text(found.p_value)}): calibrate anew instead of updating; or declare drift.angle, "
        "where its angles walk"
    )


def _as_state(state: State, std: FloatArray) -> State:
    """Standard uncertainties (P,) in the places of the parameters they are of."""
    empty = {f.name: np.zeros_like(getattr(state, f.name)) for f in fields(State)}
    step = std.copy()
    step[: 3 * state.n] = 0.0
    return retract(State(**empty), step)


def _day(measured: Measured) -> str:
    return f"{datetime.fromtimestamp(measured.end, UTC):%Y-%m-%d}"
