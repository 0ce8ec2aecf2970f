"""The whole way from files to a calibration: one small function between the door and the house."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from tdfscal.acceptance.conformity import assess_stated
from tdfscal.acceptance.gate import judge
from tdfscal.checks import faulty_sensors
from tdfscal.comparison.joint import Joint, combine
from tdfscal.dwells import find_dwells
from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError, UsageError
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.from_results import Provenance, from_joint, from_self, from_tracker
from tdfscal.files.hashing import input_file
from tdfscal.files.points import read_tracker_session
from tdfscal.logs import iter_log
from tdfscal.model.calibrated import independent
from tdfscal.records import Dwells, InputFile, Log, Rig, Rotations
from tdfscal.selfcal.joint_posterior import from_fit
from tdfscal.selfcal.pipeline import Estimator, SelfCalibration, self_calibrate
from tdfscal.trackercal import TrackerCalibration, calibrate_tracker
from tdfscal.workflows.campaign import Campaign, resolve

Method = Literal["self", "tracker", "joint"]
Progress = Callable[[str], None]

#: Warnings of a log that an error repeats at most; those of its clocks come first.
_TOLD = 3
_CLOCK = re.compile(r"clock|header time|step back|repeat the time")


@dataclass(frozen=True, slots=True)
class Outcome:
    """A calibration file's content, with the records behind it for reports."""

    calibration: Calibration
    own: SelfCalibration | None = None
    tracker: TrackerCalibration | None = None
    joint: Joint | None = None


@dataclass(slots=True)
class _Passing:
    """Lets pieces of a log pass and keeps what they say of their files.

    heard : warnings of the log, which the dwells carry too. warnings : those of other files.
    """

    inputs: list[InputFile] = field(default_factory=list)
    heard: dict[str, None] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    extremes: faulty_sensors.Extremes | None = None

    def watch(self, pieces: Iterator[Log]) -> Iterator[Log]:
        for piece in pieces:
            self.inputs += piece.inputs
            self.heard |= dict.fromkeys(piece.warnings)
            self.extremes = faulty_sensors.extremes(piece, self.extremes)
            yield piece

    @contextmanager
    def explaining(self) -> Iterator[None]:
        """Let an error say what the log's warnings told before it."""
        try:
            yield
        except (DataError, NotIdentifiableError, NotConvergedError) as error:
            told = sorted(self.heard, key=lambda text: _CLOCK.search(text) is None)
            if not told:
                raise
            more = f"; and {len(told) - _TOLD} more" if len(told) > _TOLD else ""
            look = f"look first at the log: {'; '.join(told[:_TOLD])}{more}"
            advice = f"{look}. {error.hint[0].upper()}{error.hint[1:]}" if error.hint else look
            raise type(error)(error.what, where=error.where, hint=advice) from error


def calibrate(
    paths: Sequence[Path | str],
    *,
    rig: Path | str | None = None,
    method: Method | None = None,
    estimator: Estimator = "ml",
    trials: int | None = None,
    seed: int = 0,
    salvage: bool = False,
    command: str = "tdfscal.calibrate",
    progress: Progress = lambda stage: None,
    reading: Callable[[float], None] | None = None,
) -> Outcome:
    """Calibrate from a campaign folder, or from logs and a rig file.

    Parameters
    ----------
    paths : campaign folders, logs. rig : rig.yaml, where no folder holds one.
    method : self where there is a log, else tracker.
    estimator : of the self-calibration; ml, or the paper's linear method.
    trials : Monte Carlo trials at most; None for the default, 0 for none.
    salvage : read what is sound of damaged logs; the result is then never accepted.
    progress : told the name of each stage. reading : told the share of the logs that is read.

    Raises
    ------
    TdfscalError
        By cause: UsageError, RigError, DataError, NotIdentifiableError, NotConvergedError.
    """
    campaign = resolve([Path(p) for p in paths], Path(rig) if rig else None)
    chosen: Method = method or ("self" if campaign.logs else "tracker")
    if trials is not None and trials < 0:
        raise UsageError(f"the number of trials is {trials}", hint="give 0 or more")
    own_rng, tracker_rng = np.random.default_rng(seed).spawn(2)
    # A joint result has intervals of its own; trials of its parts would be thrown away.
    trials = 0 if chosen == "joint" else trials
    passing = _Passing()
    own = tracker = None
    if chosen in ("self", "joint"):
        progress("reading the log and finding the dwells")
        with passing.explaining():
            dwells = _dwells(campaign, passing, reading, salvage=salvage)
            progress(f"calibrating from {len(dwells)} dwells")
            own = self_calibrate(
                campaign.rig.rig,
                dwells,
                rng=own_rng,
                estimator=estimator,
                max_trials=trials,
                inputs=tuple(passing.inputs),
                extremes=passing.extremes,
                progress=progress,
            )
    if chosen in ("tracker", "joint"):
        progress("calibrating from the tracker's survey")
        tracker, files, notes = _survey(campaign, trials, tracker_rng)
        passing.inputs += files
        passing.warnings += notes

    origin = Provenance(campaign.rig, tuple(passing.inputs), command, seed)
    if own is not None and tracker is not None:
        return _both(campaign.rig.rig, own, tracker, origin, passing.warnings)
    if tracker is not None:
        given = independent(
            campaign.rig.rig, tracker.rotations.rotation, tracker.rotations.covariance
        )
        reasons = judge(
            campaign.rig.rig, tracker.rpy_std, tracker.birge, conformity=assess_stated(given)
        )
        return Outcome(from_tracker(tracker, origin, reasons, passing.warnings), tracker=tracker)
    assert own is not None
    return Outcome(from_self(own, origin, passing.warnings), own=own)


def _both(
    rig: Rig,
    own: SelfCalibration,
    tracker: TrackerCalibration,
    origin: Provenance,
    notes: Sequence[str],
) -> Outcome:
    """Combine two calibrations; the contact wrench is judged with both, not with either."""
    mine = Rotations(rig.supports, own.fit.state.rotation, own.uncertainty.covariance)
    both = combine(mine, tracker.rotations)
    given = from_fit(own.fit, both.rotations.covariance, both.rotations.rotation)
    alone = own.conformity.reasons if own.conformity else ()
    reasons = [reason for reason in own.reasons if reason not in alone]
    reasons += judge(rig, tracker.rpy_std, tracker.birge, conformity=assess_stated(given))
    if not both.consistent:
        reasons.append(both.test.verdict)
    return Outcome(from_joint(both, own, tracker, origin, reasons, notes), own, tracker, both)


def _dwells(
    campaign: Campaign,
    passing: _Passing,
    reading: Callable[[float], None] | None,
    *,
    salvage: bool,
) -> Dwells:
    if not campaign.logs:
        raise UsageError(
            "there is no log for a self-calibration",
            where=str(campaign.rig.path.parent),
            hint="name a log, or use --method tracker",
        )
    supports = campaign.rig.rig.supports
    pieces = iter_log(campaign.logs, campaign.rig.log, supports, salvage=salvage, progress=reading)
    found = find_dwells(passing.watch(pieces))
    passing.heard |= dict.fromkeys(found.warnings)
    return found


def _survey(
    campaign: Campaign, trials: int | None, rng: np.random.Generator
) -> tuple[TrackerCalibration, list[InputFile], tuple[str, ...]]:
    files = campaign.rig.tracker
    if files is None:
        raise UsageError(
            "the rig file declares no tracker survey",
            where=str(campaign.rig.path),
            hint="add its tracker block, or use --method self",
        )
    for path in files.paths:
        if not path.is_file():
            raise DataError(
                "the point file is not there",
                where=str(path),
                hint="correct the paths of the tracker block in rig.yaml",
            )
    session, notes = read_tracker_session(
        instrument=files.instrument,
        drawing=files.drawing,
        length_unit=files.length_unit,
        nominal=files.nominal,
        targets=files.targets,
        servo=files.servo,
        moves=files.moves,
    )
    options = {} if trials is None else {"trials": trials}
    result = calibrate_tracker(
        campaign.rig.rig, session, misalignment=files.misalignment, rng=rng, **options
    )
    return result, [input_file(path, "verified") for path in files.paths], notes
