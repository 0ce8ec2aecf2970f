"""Which samples of a log calibrate: static dwells, the motion, or all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tdfscal.dwells import find_dwells
from tdfscal.dwells.temperature import Thermometer
from tdfscal.errors import DataError, NotIdentifiableError, TdfscalError, UsageError
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.motioncal.pipeline import MotionCalibration, calibrate_moving
from tdfscal.motioncal.streams import Decimator, Slow
from tdfscal.records import Dwells, InputFile, Log, Rig, UncertainValue
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.workflows.log_pass import LogPass

Samples = Literal["static", "moving", "all"]
Own = SelfCalibration | MotionCalibration

#: Dwells from which a log is taken for a campaign of dwells: five determine the angles at all.
_ENOUGH = 5


@dataclass(frozen=True, slots=True)
class Trials:
    """Monte Carlo: generator, and trials at most; None for the default, 0 for none."""

    rng: np.random.Generator
    most: int | None


def calibrate_samples(
    log: LogPass,
    samples: Samples | None,
    static: Callable[[Dwells], SelfCalibration],
    trials: Trials | None = None,
) -> Own:
    """Calibrate from the samples that are asked for, or from those that serve.

    samples : None takes the dwells where there are enough, else the motion.
    static : calibrates from dwells. trials : of the Monte Carlo in motion.

    Raises DataError, NotIdentifiableError, NotConvergedError, UsageError.
    """
    if samples == "static":
        return _static(log, log.dwells(), static)
    if samples == "moving":
        return _moving(log, moving_samples(log), trials=trials)
    dwells, slow = read_samples(log)
    if samples == "all":
        return _all(log, dwells, slow, static, trials)
    if len(dwells) >= _ENOUGH or slow is None:
        return _static(log, dwells, static)
    try:
        return _moving(log, slow, trials=trials)
    except TdfscalError as error:
        if len(dwells) and not isinstance(error, NotIdentifiableError):
            return _static(log, dwells, static)
        raise neither(dwells, error) from error


def calibrate_motion(
    log: LogPass, dwells: Dwells, rig: Rig, inputs: tuple[InputFile, ...] = ()
) -> MotionCalibration | None:
    """Calibrate from a log's motion, by what a rig states; None where its dwells are to be taken.

    dwells : of the log, which is read once more where they are too few to calibrate from.
    inputs : files of other campaigns behind the rig's knowledge.
    Raises DataError, NotIdentifiableError, NotConvergedError where it has no dwell either.
    """
    if len(dwells) >= _ENOUGH:
        return None
    again = LogPass(log.campaign, log.progress, log.salvage, log.window)
    try:
        return _moving(again, moving_samples(again), rig=rig, inputs=inputs)
    except TdfscalError as error:
        if len(dwells):
            return None
        raise neither(dwells, error) from error


def neither(dwells: Dwells, error: TdfscalError) -> TdfscalError:
    """The error of a log that serves neither at rest nor in motion."""
    few = f"{len(dwells)} static dwells are too few" if len(dwells) else "there is no dwell"
    return error.restated(what=f"{few}, and in motion: {error.what}")


def read_samples(log: LogPass) -> tuple[Dwells, Slow | None]:
    """Read the logs once, for the dwells and for the slow streams, None where there are none."""
    log.progress.stage("reading the log")
    decimator, thermometer = _decimator(log), Thermometer()
    averaged = False

    def pieces() -> Iterator[Log]:
        nonlocal averaged
        for piece in thermometer.passing(log.pieces()):
            averaged |= piece.rows == "postures"
            if not averaged:
                decimator.add(piece)
            yield piece

    dwells = log.noted(find_dwells(pieces()))
    try:
        return dwells, None if averaged else _warm(decimator.finish(), thermometer)
    except DataError:
        return dwells, None


def moving_samples(log: LogPass) -> Slow:
    """Read the logs once, for the slow streams alone. Raises DataError where there are none."""
    log.progress.stage("reading the log")
    decimator, thermometer = _decimator(log), Thermometer()
    for piece in thermometer.passing(log.pieces()):
        if piece.rows == "postures":
            raise DataError(
                "the log holds averaged postures and no motion",
                where="log",
                hint="use --samples static, or give the recording itself",
            )
        decimator.add(piece)
    return _warm(decimator.finish(), thermometer)


def _decimator(log: LogPass) -> Decimator:
    """What makes slow streams of the log; an axis that is not measured has no full scale."""
    rig = log.campaign.rig.rig
    return Decimator(np.where(rig.axes, rig.capacity, np.inf))


def _warm(slow: Slow, thermometer: Thermometer) -> Slow:
    """The streams with the temperatures of the log, where it has any."""
    return replace(slow, temperature=thermometer.at(slow.time, slow.time, len(slow.supports)))


def _static(
    log: LogPass, dwells: Dwells, static: Callable[[Dwells], SelfCalibration]
) -> SelfCalibration:
    log.progress.stage(f"calibrating from {len(dwells)} dwells")
    return static(dwells)


def _moving(
    log: LogPass,
    slow: Slow,
    dwells: int = 0,
    *,
    rig: Rig | None = None,
    inputs: tuple[InputFile, ...] = (),
    trials: Trials | None = None,
) -> MotionCalibration:
    log.progress.stage("calibrating from the motion")
    return calibrate_moving(
        rig or log.campaign.rig.rig,
        slow,
        stated_delay(log),
        dwells=dwells,
        inputs=(*inputs, *log.inputs),
        rng=None if trials is None else trials.rng,
        max_trials=None if trials is None else trials.most,
        progress=log.progress.stage,
    )


def stated_delay(log: LogPass) -> UncertainValue:
    """Delay of the force stamps, s, as the rig file states it; unknown where it does not."""
    return delay_of(log.campaign.rig)


def delay_of(rig: LoadedRig) -> UncertainValue:
    """Delay of the force stamps, s, as a rig file states it; unknown where it does not."""
    mapping = rig.log
    stated = mapping.delay if mapping is not None else None
    return stated or UncertainValue(np.array(0.0), np.array(np.inf))


def _all(
    log: LogPass,
    dwells: Dwells,
    slow: Slow | None,
    static: Callable[[Dwells], SelfCalibration],
    trials: Trials | None,
) -> Own:
    """The whole log, its rests and its moves, in one estimate with one spectrum of the noise.

    A dwell is a motion at rest (theory, section 8). Where the moves hold what the model does not
    know, or make an angle less certain, the dwells' own result stands, with a word about it.
    """
    own = None
    if len(dwells):
        try:
            own = _static(log, dwells, static)
        except NotIdentifiableError:
            if slow is None:
                raise
    if slow is None:
        return own if own is not None else _static(log, dwells, static)
    if own is None:
        return _moving(log, slow, len(dwells), trials=trials)
    try:
        both = _moving(log, slow, len(dwells), trials=trials)
    except TdfscalError as error:
        return _with_word(own, f"the moves add nothing to the dwells: {error.what}")
    if both.reasons and not own.reasons:
        return _with_word(own, f"the moves add nothing to the dwells: {both.reasons[0]}")
    if np.any(both.uncertainty.turns.rpy_std > own.uncertainty.rpy_std):
        return _with_word(own, "the moves add nothing to the dwells: they are no more certain")
    return both


def _with_word(own: SelfCalibration, word: str) -> SelfCalibration:
    return replace(own, warnings=(*own.warnings, word))


def check_samples(samples: Samples | None, method: str | None, estimator: str) -> None:
    """Raise UsageError where other options need dwells."""
    if samples not in ("moving", "all"):
        return
    if method in ("tracker", "joint") or estimator == "linear":
        other = f"--method {method}" if method in ("tracker", "joint") else "--estimator linear"
        raise UsageError(
            f"{other} does not go with --samples {samples}: it needs static dwells alone",
            hint="leave one of the two out",
        )
