"""Why a log holds no static dwell: what was seen, and what would do.

The search itself only knows that no stretch passed. Here the log is looked at once more, and only
coarsely: where the NCPs are slow, do positions and forces decay towards a level?
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tdfscal.dwells.bins import Bins, zeros
from tdfscal.dwells.field import SHORTEST
from tdfscal.dwells.noise_level import runs, signals
from tdfscal.errors import DataError
from tdfscal.records import Absence, BoolArray, Dwells, FloatArray, IntArray

_SLOW = 0.2  # of the usual speed of a move: below it a stop, or what looks like one
_THIRDS = 6  # bins at least that are parted in three
_ALIKE = 0.9  # correlation of the changes in successive parts of a decay
_FALLS = (0.02, 0.8)  # ratio of those changes
_SAMPLES = 20  # per stop: ten for the shortest dwell, as many for what is kept clear of moves
_STOP = 2.0  # s, that a stop should last at least
_DECAYED = 0.1  # standard errors of a mean that may be left of a decay


def no_dwell(dwells: Dwells) -> DataError:
    """The error for a log without any dwell."""
    absence = dwells.absence or Absence(
        "the NCPs never rest with settled forces", "hold each posture for at least two seconds"
    )
    return DataError(f"no static dwell was found: {absence.seen}", where="log", hint=absence.advice)


def explain(bins: Bins, moving: BoolArray, shortest: float) -> Absence:
    """Say why no stretch of the log passes.

    moving : (B,), where the search sees the NCPs move. shortest : s, of a dwell.
    """
    n = len(bins.supports)
    position, force = np.split(signals(bins).value, [3 * n])
    first, last = _slow(position)
    return (
        _zeros(bins)
        or _too_slow(bins, first, last)
        or _too_short(bins, moving, shortest)
        or _smoothed("positions", position, first, last, bins.width)
        or _restless(moving)
        or _smoothed("forces", force, first, last, bins.width)
        or Absence(
            "the NCPs rest, and the forces never settle meanwhile",
            "hold each posture for longer, and look whether something moves or touches the "
            "terminal",
        )
    )


def _zeros(bins: Bins) -> Absence | None:
    found = zeros(bins)
    if found is None:
        return None
    return Absence(
        f"the {found.values['signal']} of {found.subject[0]} drops to 0, 0, 0 and returns, at "
        f"{100 * (found.size or 0.0):.2g} % of the samples, as if the recorder wrote zeros where "
        "it had no reading",
        "let the recorder leave such cells empty, or repeat the last reading",
    )


def _too_slow(bins: Bins, first: IntArray, last: IntArray) -> Absence | None:
    """A clock too slow for the stops [first, last)."""
    period = float(bins.period.max())
    rest = float((last - first).max(initial=0) * bins.width)
    if _SAMPLES / 2 * period < max(rest, SHORTEST):
        return None
    stop, rate = _rounded_up(_SAMPLES * period), _rounded_up(_SAMPLES / max(rest, _STOP))
    return Absence(
        f"sampled too slowly: there is a sample every {period:.3g} s, a dwell takes "
        f"{_SAMPLES / 2:.0f} of them, and the NCPs rest for {rest:.2g} s at most",
        f"record at {rate:g} Hz or more, or hold each posture for at least {stop:g} s",
        stop,
    )


def _too_short(bins: Bins, moving: BoolArray, shortest: float) -> Absence | None:
    """Stops that end before a dwell is long enough."""
    begin, end = runs(~moving)
    rest = float((end - begin).max(initial=0) * bins.width)
    if not len(begin) or rest >= shortest:
        return None
    return Absence(
        f"the stops are too short: the NCPs rest {len(begin)} times, for {rest:.2g} s at most, and "
        f"a dwell takes {shortest:.2g} s of settled forces",
        f"hold each posture for at least {_STOP:g} s",
        _STOP,
    )


def _restless(moving: BoolArray) -> Absence | None:
    """NCPs that move all the time."""
    if not moving.all():
        return None
    return Absence(
        "the NCPs never rest: their positions change from the first sample to the last",
        f"hold each posture for at least {_STOP:g} s, and check that the position fields are those "
        "of the NCPs, unfiltered",
    )


def _slow(position: FloatArray) -> tuple[IntArray, IntArray]:
    """Stretches of bins between the moves, as far as can be seen without knowing the noise."""
    step = np.abs(np.diff(position, axis=1))
    usual = np.quantile(step, 0.98, axis=1, keepdims=True) if step.shape[1] else step
    speed = np.divide(step, usual, out=np.zeros_like(step), where=usual > 0).max(axis=0, initial=0)
    return runs(np.concatenate([speed, [0.0]]) <= _SLOW)


def _decay(
    value: FloatArray, first: IntArray, last: IntArray, width: float
) -> tuple[float, FloatArray] | None:
    """A decay common to the stops: changes from third to third go the same way and fall alike.

    Its time constant, s, and the change over the first third of the stops, rms, (A,).
    """
    third = (last - first) // 3
    total = np.cumsum(np.pad(value, ((0, 0), (1, 0))), axis=1)
    ends = [total[:, first + k * third] for k in range(4)]
    earlier, later = np.diff([(b - a).T / third[:, None] for a, b in pairwise(ends)], axis=0)
    size = np.sqrt(np.mean(earlier**2, axis=0))
    scale = np.where(size > 0, size, np.inf)
    earlier, later = earlier / scale, later / scale
    across, own = float(np.sum(earlier * later)), float(np.sum(earlier**2))
    alike = across / max(np.sqrt(own * float(np.sum(later**2))), np.finfo(float).tiny)
    ratio = across / max(own, np.finfo(float).tiny)
    if alike < _ALIKE or not _FALLS[0] < ratio < _FALLS[1]:
        return None
    return float(np.median(last - first)) / 3 * width / -float(np.log(ratio)), size


def _smoothed(
    what: str, value: FloatArray, first: IntArray, last: IntArray, width: float
) -> Absence | None:
    """A decay through the stops, and the stop that outlasts it."""
    long = last - first >= _THIRDS
    first, last = first[long], last[long]
    decay = _decay(value, first, last, width) if len(first) else None
    if decay is None:
        return None
    tau, change = decay
    bend = np.abs(np.diff(value, n=2, axis=1))
    noise = 1.4826 * np.median(bend, axis=1) / np.sqrt(6.0)
    left = _DECAYED * noise * np.sqrt(width / _STOP)
    size = np.divide(change, left, out=np.ones_like(left), where=left > 0).max()
    rest = float(np.median(last - first)) * width
    seen = (
        f"the {what} creep on after each move with a time constant of {tau:.2g} s, through "
        f"stops of {rest:.2g} s: a smoothing filter, or slow settling"
    )
    unfiltered = "switch the smoothing of sensor, amplifier or recorder off"
    if what == "positions":
        return Absence(seen, unfiltered)
    stop = _rounded_up(tau * np.log(max(size, np.e)) + _STOP)
    return Absence(seen, f"{unfiltered}, or hold each posture for at least {stop:g} s", stop)


def _rounded_up(value: float) -> float:
    """To two digits, never less."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(np.ceil(value / digit - 1e-9) * digit)
