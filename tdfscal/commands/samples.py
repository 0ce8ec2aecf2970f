"""Which samples of a log calibrate: static dwells, the motion, or all of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from tdfscal.catalogue import sentence
from tdfscal.commands.log_pass import LogPass
from tdfscal.dwells import find_dwells
from tdfscal.dwells.clock_offset import forces_behind
from tdfscal.dwells.dwell_means import Thermometer
from tdfscal.errors import DataError, NotIdentifiableError, TdfscalError
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.findings import Finding
from tdfscal.model.dynamics import DELAY, RATE
from tdfscal.motioncal.preparation import with_moves
from tdfscal.motioncal.streams import Decimator, Slow
from tdfscal.records import Dwells, Log, RecorderClock, Rig, UncertainValue
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import Estimator, SelfCalibration

if TYPE_CHECKING:
    from tdfscal.motioncal.pipeline import MotionCalibration

Samples = Literal["static", "moving", "all"]
Own: TypeAlias = "SelfCalibration | MotionCalibration"

#: Dwells from which a log is taken for a campaign of dwells: five determine the angles at all.
_ENOUGH = 5


def calibrate_samples(
    log: LogPass, samples: Samples | None, estimator: Estimator, rng: np.random.Generator
) -> Own:
    """Calibrate from the samples that are asked for, or from those that serve.

    samples : None takes the dwells where there are enough, else the motion.
    rng : of the Monte Carlo.

    Raises DataError, NotIdentifiableError, NotConvergedError, UsageError.
    """
    if samples == "static":
        return _static(log, log.dwells(), estimator, rng)
    if samples == "moving":
        return _moving(log, moving_samples(log), rng=rng)
    dwells, slow = read_samples(log)
    if slow is None:
        return _static(log, dwells, estimator, rng)
    if samples is None and len(dwells) >= _ENOUGH:
        own = _static(log, dwells, estimator, rng)
        if own.reasons or estimator == "linear":
            return own
        expected = with_moves(log.rig, slow, delay_of(log.campaign.rig), own.fit.state)
        return replace(own, with_moves=expected)
    if samples == "all":
        return _all(log, dwells, slow, estimator, rng)
    try:
        return _for_want_of(dwells, _moving(log, slow, rng=rng))
    except TdfscalError as error:
        if len(dwells) and not isinstance(error, NotIdentifiableError):
            return _static(log, dwells, estimator, rng)
        raise neither(dwells, error) from error


def calibrate_motion(log: LogPass, dwells: Dwells, rig: Rig) -> MotionCalibration | None:
    """Calibrate from a log's motion, by what a rig states; None where its dwells are to be taken.

    dwells : of the log, which is read once more where they are too few to calibrate from.
    Raises DataError, NotIdentifiableError, NotConvergedError where it has no dwell either.
    """
    if len(dwells) >= _ENOUGH:
        return None
    again = LogPass(log.campaign, log.settings)
    try:
        return _for_want_of(dwells, _moving(again, moving_samples(again), rig=rig))
    except TdfscalError as error:
        if len(dwells):
            return None
        raise neither(dwells, error) from error


def _for_want_of(dwells: Dwells, found: MotionCalibration) -> MotionCalibration:
    """Say so where a motion stands for dwells that are too few; one dwell begins any motion."""
    if len(dwells) < 2:
        return found
    few = Finding("dwells-few", size=len(dwells))
    return replace(found, findings=(*found.findings, few))


def neither(dwells: Dwells, error: TdfscalError) -> TdfscalError:
    """The error of a log that serves neither at rest nor in motion."""
    few = f"{len(dwells)} static dwells are too few" if len(dwells) else "there is no dwell"
    return error.restated(what=f"{few}, and in motion: {error.what}")


def read_samples(log: LogPass) -> tuple[Dwells, Slow | None]:
    """Read the logs once, for the dwells and for the slow streams, None where there are none."""
    streams = _Streams(log)
    dwells = log.noted(find_dwells(streams.pieces()))
    with suppress(DataError):
        return dwells, streams.slow()
    return dwells, None


def moving_samples(log: LogPass) -> Slow:
    """Read the logs once, for the slow streams alone.

    Raises DataError where there are none, or their forces are seconds behind the positions.
    """
    streams = _Streams(log)
    for _ in streams.pieces():
        pass
    slow = streams.slow()
    if late := forces_behind(slow.time, slow.position, slow.force):
        raise DataError(late)
    return slow


class _Streams:
    """The slow streams of a log while it passes, with its temperatures where it has any."""

    def __init__(self, log: LogPass) -> None:
        log.progress("reading the log")
        # An axis that is not measured has no full scale.
        self._decimator = Decimator(np.where(log.rig.axes, log.rig.capacity, np.inf))
        self._log, self._averaged, self._thermometer = log, False, Thermometer()

    def pieces(self) -> Iterator[Log]:
        for piece in self._thermometer.passing(self._log.pieces()):
            self._averaged |= piece.rows == "postures"
            if not self._averaged:
                self._decimator.add(piece)
            yield piece

    def slow(self) -> Slow:
        if self._averaged:
            raise DataError(
                "the log holds averaged postures and no motion",
                where="log",
                hint="use --samples static, or give the recording itself",
            )
        slow = self._decimator.finish()
        return replace(
            slow, temperature=self._thermometer.at(slow.time, slow.time, len(slow.supports))
        )


def _static(
    log: LogPass, dwells: Dwells, estimator: Estimator, rng: np.random.Generator
) -> SelfCalibration:
    """Calibrate from dwells."""
    stage, trials = log.progress, log.settings.trials
    stage(f"calibrating from {len(dwells)} dwells")
    return self_calibrate(
        log.rig, dwells, rng=rng, estimator=estimator, max_trials=trials, progress=stage
    )


def _moving(
    log: LogPass,
    slow: Slow,
    dwells: int = 0,
    *,
    rig: Rig | None = None,
    rng: np.random.Generator | None = None,
) -> MotionCalibration:
    """Calibrate from the motion; rng : of the Monte Carlo, None for none."""
    from tdfscal.motioncal.pipeline import calibrate_moving

    log.progress("calibrating from the motion")
    found = calibrate_moving(
        rig or log.rig,
        slow,
        delay_of(log.campaign.rig),
        dwells=dwells,
        rng=rng,
        max_trials=log.settings.trials,
        progress=log.progress,
    )
    log.clocks = _with_delay(log, found, 0.5 * float(slow.time[0] + slow.time[-1]))
    # At rest the dwells bring along what the log says of itself.
    told = [finding for finding in log.messages if finding not in found.findings]
    return replace(found, findings=(*found.findings, *told))


def _with_delay(log: LogPass, found: MotionCalibration, middle: float) -> tuple[RecorderClock, ...]:
    """The second recorder's clock with the delay and rate that the motion has shown, at its middle.

    Of more than two recorders nothing says whose delay it is.
    """
    if len(log.clocks) != 1:
        return log.clocks
    clock, moving, std = log.clocks[0], found.fit.state.moving, found.estimate.moving_std
    late = any(log.campaign.rig.log[1].force)  # the forces are the second recorder's
    delay, rate = (moving.delay, moving.rate) if late else (-moving.delay, -moving.rate)
    since = middle - clock.reference
    offset_std = float(np.hypot(std[DELAY], since * std[RATE]))
    offset = clock.offset + delay - since * rate
    return (replace(clock, offset=offset, offset_std=offset_std, rate=clock.rate + rate,
                    rate_std=float(std[RATE])),)  # fmt: skip


def delay_of(rig: LoadedRig) -> UncertainValue:
    """Delay of the force stamps, s, as a rig file states it; unknown where it does not."""
    if len(rig.log) > 1:  # their clocks are apart by as much as the moves leave open
        rate_std = max(recorder.clock.rate_std for recorder in rig.log[1:])
        return UncertainValue(np.zeros(2), np.array([np.inf, rate_std]))
    stated = rig.log[0].delay if rig.log else None
    return stated or UncertainValue(np.array(0.0), np.array(np.inf))


def _all(
    log: LogPass, dwells: Dwells, slow: Slow, estimator: Estimator, rng: np.random.Generator
) -> Own:
    """The whole log, its rests and its moves, in one estimate with one spectrum of the noise.

    A dwell is a motion at rest (theory, section 8). Where the moves hold what the model does not
    know, or make an angle less certain, the dwells' own result stands, with a word about it.
    """
    own = None
    with suppress(NotIdentifiableError):
        if len(dwells):
            own = _static(log, dwells, estimator, rng)
    if own is None:
        return _moving(log, slow, len(dwells), rng=rng)
    try:
        both = _moving(log, slow, len(dwells), rng=rng)
    except TdfscalError as error:
        why = error.what
    else:
        if both.reasons and not own.reasons:
            why = sentence(both.reasons[0])
        elif np.any(both.uncertainty.rpy_std > own.uncertainty.rpy_std):
            why = "they are no more certain"
        else:
            return both
    nothing = Finding("moves-add-nothing", values={"why": why})
    return replace(own, findings=(*own.findings, nothing))
