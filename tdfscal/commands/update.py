"""`update`: the last calibration, its walk since, and a new campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from tdfscal.commands import options
from tdfscal.commands.arguments import SILENT, PathLike, check_trials, listed, one, window
from tdfscal.commands.calibrate import origin_of
from tdfscal.commands.calibration import Calibration, as_calibration, paths_of
from tdfscal.commands.campaign import campaign_folders, inputs_read
from tdfscal.commands.earlier import Earlier, read_earlier
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.recordings import day, refuse_repeated
from tdfscal.commands.samples import Own
from tdfscal.commands.several_campaigns import (
    Read,
    calibrate_informed,
    left_out,
    misfit_finding,
    read_campaigns,
    unsound,
)
from tdfscal.comparison.misfit import Misfit, misfit_of
from tdfscal.errors import UsageError
from tdfscal.estimation.observation import eliminate, of_estimate
from tdfscal.files.calibration.document import CALIBRATION_SUFFIXES, save_calibration
from tdfscal.files.calibration.from_results import published_std
from tdfscal.files.calibration.statistics import campaign_document
from tdfscal.files.outputs import PAGE_SUFFIXES, check_outputs
from tdfscal.findings import Finding, Value
from tdfscal.model.earlier import information_of
from tdfscal.model.parameters import placed, starting_state
from tdfscal.numerics.information import contrast
from tdfscal.records import Rig
from tdfscal.selfcal.covariance import joint_posterior
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.significance import DETECTION_POWER, alarm_level


@options.command("update calibration.yaml this-month -o updated.yaml", output="content")
def update(
    calibration: options.OneCalibration,
    paths: options.Paths,
    *,
    rig: options.RigFile = None,
    from_: options.Begin = None,
    to: options.End = None,
    trials: options.Trials = None,
    output: Annotated[
        PathLike | None, options.written("file to write, .yaml or .json; - for stdout")
    ] = None,
    html: options.Page = None,
    allow_rejected: options.AllowRejected = False,
    command: options.CommandLine = "tdfscal.update",
    progress: options.Telling = SILENT,
) -> Calibration:
    """Bring a calibration up to date with a new campaign: zeros, load, angles.

    The last calibration with its full covariance, widened by the random walk `drift.angle` since,
    is what is known before; one posture is enough to find new zeros.

    Raises
    ------
    TdfscalError
        By cause: UsageError (another rig, a campaign older than the calibration), RigError,
        DataError, NotIdentifiableError, NotConvergedError.
    """
    target, page, rig_file, files = one(output), one(html), one(rig), listed(paths)
    check_trials(trials)
    check_outputs(
        {"--output": (target, CALIBRATION_SUFFIXES), "--html": (page, PAGE_SUFFIXES)},
        inputs_read(files, rig_file, files=paths_of([calibration])),
    )
    settings = Settings(progress, window(from_, to), trials=trials, command=command)
    earlier = read_earlier(calibration)
    groups = campaign_folders(files, rig_file)
    reads = read_campaigns(groups, settings, rig_file, like=(earlier.name, earlier.rig))
    _check(earlier, reads)
    for read in reads[:-1]:
        earlier = read_earlier(_updated(earlier, read, 0))
    result = _updated(earlier, reads[-1], trials)
    if target is not None and (result.accepted or allow_rejected):
        save_calibration(result, target)
    result.save_page(page, progress)  # whatever the verdict
    return result


def _check(earlier: Earlier, reads: Sequence[Read]) -> None:
    """Refuse what cannot follow the calibration."""
    refuse_repeated([*earlier.recordings(), *reads])
    for read in reads:
        if read.dwells is None:
            raise UsageError(
                "there is no log to update from",
                where=read.name,
                hint="calibrate the survey on its own, and compare",
            )
        dated = "file" not in (read.measured.source, earlier.measured.source)
        if dated and read.measured.end < earlier.measured.begin:
            raise UsageError(
                f"was recorded on {day(read.measured.end)}, before the calibration "
                f"({day(earlier.measured.end)})",
                where=read.name,
                hint="update in the order of time, or give all campaigns to calibrate",
            )


def _updated(earlier: Earlier, read: Read, trials: int | None) -> Calibration:
    """Calibrate from a campaign with all that was known, and hold the two against each other."""
    month, since = read.measured.month, earlier.measured.month
    informed = replace(read.rig, earlier=earlier.prior(read.rig, month))
    own = calibrate_informed(read, informed, trials, tuple(read.inputs))
    level = float(alarm_level(month - since))
    misfit, this = _contribution(informed, own, read, level)
    if misfit.p_value <= level:
        found = left_out(unsound([read]), rejects=True)
        found = found or (misfit_finding(misfit, since=earlier.name),)
        own = replace(own, findings=(*own.findings, *found))
    notes = [_could_have_missed(misfit, read.rig, earlier)]
    if not earlier.file.accepted:
        notes.append(Finding("calibration-rejected", (earlier.name,)))
    campaigns, history = (*earlier.campaigns(), this), earlier.history()
    origin = origin_of(read.log, read.inputs, read.measured, campaigns=campaigns, history=history)
    return as_calibration(own, origin, notes)


def _could_have_missed(misfit: Misfit, rig: Rig, earlier: Earlier) -> Finding:
    """Smallest turns that would have been seen, per sensor by its least visible angle."""
    assert misfit.detectable is not None
    least = zip(rig.supports, misfit.detectable.max(axis=1), strict=True)
    seen = [f"{n} {1e3 * x:.2g} mrad" if np.isfinite(x) else f"{n} none" for n, x in least]
    values: dict[str, Value] = {"power": DETECTION_POWER, "turns": seen}
    return Finding("turns-visible", (earlier.name,), values=values)


def _contribution(rig: Rig, own: Own, read: Read, level: float) -> tuple[Misfit, dict[str, Any]]:
    """The new campaign against all that was known before it; and its place in the file's list."""
    assert rig.earlier is not None
    reference = starting_state(rig)
    if isinstance(own, SelfCalibration):
        part = eliminate(own.fit, reference)
        chi2, dof = own.quality.chi2, max(own.quality.dof, 0)
        given, found = joint_posterior(own.fit, own.uncertainty.covariance), own.uncertainty
        postures = int(sum(own.fit.weight > 0))
    else:
        known = information_of(rig, rig.earlier)
        part = of_estimate(own.calibrated, known, reference)
        chi2, dof = contrast(known, part.information).chi2()
        given, found = own.calibrated, own.uncertainty
        postures = own.dwells
    this = campaign_document(
        read.name,
        read.measured,
        read.inputs,
        given.state,
        placed(given.state, published_std(given, found.parameter_std)),
        rig.axes,
        postures=postures,
        chi2=chi2,
        dof=dof,
    )
    return misfit_of(rig, read.name, part, level), this
