"""`update`: the last calibration, as what is known before, its walk since, and a new campaign."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Annotated

import numpy as np

from tdfscal.commands import options
from tdfscal.commands.calibrate import Own, origin_of
from tdfscal.commands.campaign import PathLike, campaign_folders
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.options import silent, window
from tdfscal.commands.recordings import Read, Recording, day, read_campaigns, refuse_repeated
from tdfscal.commands.result import Calibration, CalibrationSource, read_source
from tdfscal.commands.several_campaigns import (
    PRECISION,
    calibrate_informed,
    judged,
    misfit_finding,
    wanted,
)
from tdfscal.comparison.misfit import EarlierCalibration, Misfit, misfit_of
from tdfscal.errors import UsageError
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import eliminate, of_estimate, stated
from tdfscal.files.calibration.compared import readings_of
from tdfscal.files.calibration.document import (
    CALIBRATION_SUFFIXES,
    defects,
    dump_calibration,
)
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.calibration.evidence import CampaignResult
from tdfscal.files.calibration.from_results import from_self, published_std
from tdfscal.files.calibration.parameters import calibrated, exact_moves_from, parameter_rows
from tdfscal.files.calibration.parts import HistoryEntry
from tdfscal.files.calibration.statistics import campaign
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import (
    Calibrated,
    constants_known,
    free_constants,
    information_of,
    with_rotations,
)
from tdfscal.model.parameters import placed, starting_state
from tdfscal.numerics.information import contrast
from tdfscal.records import BoolArray, ExactMoves, FloatArray, Rig
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.significance import alarm_level

_TOUCHED = "stretch-touched"


@record(kw_only=True)
class Earlier(EarlierCalibration):
    """A calibration file as what is known before another campaign."""

    file: Calibration

    @property
    def campaigns(self) -> tuple[CampaignResult, ...]:
        """The campaigns that it stands on, as a file lists them."""
        return self.file.campaigns or (_alone(self),)

    def recordings(self) -> list[Recording]:
        """The recordings that it stands on."""
        known = readings_of(self.file, self.rig.supports)
        return [
            Recording(one.name, [f.record() for f in one.inputs], one.measured.record(), means)
            for one, means in zip(self.campaigns, known, strict=True)
        ]

    def own_recordings(self) -> list[Recording]:
        """Those of them on which no calibration stands that this one updates."""
        return self.recordings()[-1:] if self.file.history else self.recordings()

    def history(self) -> tuple[HistoryEntry, ...]:
        """The calibrations that one which stands on this one stands on."""
        own = {"created": self.file.created, "method": self.file.method, "sha256": self.sha256}
        last = HistoryEntry.model_validate({**own, "measured": self.measured})
        return (*self.file.history, last)


def read_earlier(source: CalibrationSource) -> Earlier:
    """Read a calibration as what is known before another campaign.

    Raises DataError, UsageError where it is none, or cannot be read.
    """
    name, file = read_source(source)
    known = calibrated(file)
    covariance = known.covariance
    if file.parameters is not None and file.parameters.unscaled is not None:
        covariance = _unscaled(covariance, file.determined, np.array(file.parameters.unscaled))
    # In motion the noise is estimated with the fit: its χ² tells nothing of what was stated.
    alone = () if file.fit is None or file.motion is not None else (file.fit,)
    fits = file.campaigns or alone
    in_memory = isinstance(source, CalibrationFile) or str(source) == "-"
    content = dump_calibration(file, "yaml").encode() if in_memory else Path(name).read_bytes()
    last = file.history[-1] if file.history else None
    return Earlier(
        name=name,
        file=file,
        rig=known.rig,
        state=known.state,
        information=constants_known(known.rig, covariance),
        determined=file.determined,
        measured=file.measured.record(),
        sha256=sha256(content).hexdigest(),
        chi2=sum(fit.chi2 for fit in fits),
        dof=sum(fit.dof for fit in fits),
        base=None if last is None else (last.sha256, last.created),
        pooled=bool(file.campaigns),
        exact=_exact(file, known.rig),
        sources=_sources(file),
    )


def _sources(file: CalibrationFile) -> dict[str, FloatArray]:
    """Shares (n, 3) of the sources in the variance of roll, pitch, yaw; none where not told."""
    if file.budget is None:
        return {}
    shares = np.zeros((len(file.determined), 3, len(file.budget.sources)))
    shares[file.determined] = file.budget.shares.reshape(-1, *shares.shape[1:])
    return dict(zip(file.budget.sources, np.moveaxis(shares, 2, 0), strict=True))


def _exact(file: CalibrationFile, rig: Rig) -> tuple[ExactMoves, ...]:
    """How the constants (C,) move with errors of what the calibration took as exact."""
    free = free_constants(rig)
    rows = parameter_rows((file.parameters or file.covariance).parameters, rig.supports)
    moves = exact_moves_from(file.taken_as_exact, rows, len(free))
    return tuple(one.by(np.eye(len(free))[free]) for one in moves)


def _unscaled(covariance: FloatArray, determined: BoolArray, own: FloatArray) -> FloatArray:
    """Covariance (P, P) with that of the determined sensors' turns replaced by their own."""
    stand = np.zeros(len(covariance), dtype=np.bool_)
    stand[: 3 * len(determined)] = np.repeat(determined, 3)
    order = np.argsort(~stand, kind="stable")  # with_rotations replaces the first block
    back = np.argsort(order)
    moved = with_rotations(covariance[np.ix_(order, order)], int(stand.sum()), own)
    return np.asarray(moved[np.ix_(back, back)])


def _alone(earlier: Earlier) -> CampaignResult:
    """The one campaign of a calibration, as a file with several lists it."""
    file = earlier.file
    return CampaignResult.model_validate(
        {
            "name": earlier.name,
            "measured": earlier.measured,
            "inputs": file.inputs,
            "zero": [support.zero for support in file.supports],
            "zero_std": [support.zero_std for support in file.supports],
            "terminal": file.terminal,
            "postures": 0 if file.fit is None else file.fit.postures,
            "chi2": earlier.chi2,
            "dof": earlier.dof,
            "readings": file.dwells,
        }
    )


@options.command("update calibration.yaml this-month -o updated.yaml")
def update(
    calibration: options.OneCalibration,
    paths: options.Paths,
    *,
    rig: options.RigFile = None,
    from_: options.Begin = None,
    to: options.End = None,
    trials: options.Trials = None,
    output: Annotated[
        PathLike | None,
        options.written(
            "file to write, .yaml or .json", *CALIBRATION_SUFFIXES, shell="- for stdout"
        ),
    ] = None,
    html: options.Page = None,
    allow_rejected: options.AllowRejected = False,
    progress: options.Telling = silent,
    command: str = "",
) -> Calibration:
    """Bring a calibration up to date with a new campaign: zeros, load, angles.

    The last calibration with its full covariance, widened by the random walk `drift.angle` since,
    is what is known before; one posture is enough to find new zeros. Of several campaigns one that
    `calibrate` rejects by itself takes no part, unless it is the last.

    Raises
    ------
    TdfscalError
        By cause: UsageError (another rig, a campaign older than the calibration), RigError,
        DataError, NotIdentifiableError, NotConvergedError.
    """
    settings = Settings(progress, window(from_, to), trials=trials, command=command)
    earlier = read_earlier(calibration)
    groups = campaign_folders(paths, rig)
    reads, unusable = read_campaigns(groups, settings, rig, like=(earlier.name, earlier.rig))
    _check(earlier, reads)
    if not reads:
        raise unusable.first
    standing, beside = earlier, list[Finding]()
    for read in reads[:-1]:
        with unusable.noting(read.name):
            own = judged(read)
            if own.rejected is None:
                updated = _updated(standing, read, 0)
                if any(reason.code not in PRECISION for reason in updated.reasons):
                    # It fits in itself, and what follows would fit no better.
                    return _updated(standing, read, trials, [*unusable.findings, *beside])
                standing = read_earlier(updated)
            beside += [said for said in (own.rejected or own.remark,) if said]
    return _updated(standing, reads[-1], trials, [*unusable.findings, *beside])


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


def _updated(
    earlier: Earlier, read: Read, trials: int | None, beside: Sequence[Finding] = ()
) -> Calibration:
    """Calibrate from a campaign with all that was known, and hold the two against each other.

    beside : of other campaigns, those that had to be left out.
    """
    month, since = read.measured.month, earlier.measured.month
    informed = replace(read.rig, earlier=earlier.prior(read.rig, month))
    own = calibrate_informed(read, informed, trials)
    level = float(alarm_level(month - since))
    misfit, this = _contribution(informed, own, read, level)
    if misfit.p_value <= level:
        alone = judged(read)
        rejected, estimate = alone.rejected, alone.recorded.estimate
        if estimate is not None:  # by the earlier angles a turned sensor's motion looks touched
            itself = _by_itself(informed, read, estimate, level)
            misfit = itself if itself.p_value <= level else misfit
            own = replace(own, findings=tuple(f for f in own.findings if f.code != _TOUCHED))
        found, said = [misfit_finding(misfit, since=earlier.name)], own.findings
        if rejected is not None:
            found = [*wanted([rejected])]
        else:  # what else rejects it stands on what it does not fit
            said = tuple(f for f in said if not f.rejects or f.code in PRECISION)
        own = replace(own, findings=(*found, *said))
    own = replace(own, findings=(*own.findings, *beside))
    notes = list(defects(earlier.name, earlier.file))
    notes += [said for said in read.log.messages if said not in own.findings]
    campaigns, history = (*earlier.campaigns, this), earlier.history()
    origin = origin_of(read.log, measured=read.measured, campaigns=campaigns, history=history)
    return Calibration.of(from_self(own, origin, notes))


def _by_itself(rig: Rig, read: Read, estimate: Calibrated, level: float) -> Misfit:
    """A motion that was calibrated by itself against all that was known before it."""
    reference = starting_state(rig)
    part = of_estimate(estimate, stated(Priors(read.rig), reference), reference)
    return misfit_of(rig, read.name, part, level)


def _contribution(rig: Rig, own: Own, read: Read, level: float) -> tuple[Misfit, CampaignResult]:
    """The new campaign against all that was known before it; and its place in the file's list."""
    assert rig.earlier is not None
    reference = starting_state(rig)
    if isinstance(own, SelfCalibration):
        part = eliminate(own.fit, reference)
        chi2, dof = own.quality.chi2, max(own.quality.dof, 0)
        postures = int(sum(own.fit.weight > 0))
    else:
        known = information_of(rig.earlier)
        part = of_estimate(own.calibrated, known, reference)
        chi2, dof = contrast(known, part.information).chi2()
        postures = own.dwells
    given, found = own.calibrated, own.uncertainty
    this = campaign(
        given.state,
        placed(given.state, published_std(given, found.parameter_std)),
        rig.axes,
        read.means if isinstance(own, SelfCalibration) else None,
        name=read.name,
        measured=read.measured,
        inputs=read.inputs,
        postures=postures,
        chi2=chi2,
        dof=dof,
    )
    return misfit_of(rig, read.name, part, level), this
