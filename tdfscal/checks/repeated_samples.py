"""Samples that a log holds twice: copies under a shifted clock, in another file, stale readings.

Noise does not repeat itself. How improbable a repetition is follows from the readings themselves: a
window of them that recurs says at least `_BITS` for each new value in it (a constant or coarse
channel says little or nothing), and windows that recur at one distance add up. The log is read
once: of its windows those are kept whose own hash says so, the fewer the longer it is (Manber 1994,
Finding similar files; Schleimer, Wilkerson and Aiken 2003, Winnowing).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.records import BoolArray, Dwells, FloatArray, LeftOut, Log, Rig
from tdfscal.significance import REPEATED_BY_CHANCE

_Hashes = npt.NDArray[np.uint64]
#: Samples of a window, and windows that are kept of each sensor: while its log passes, so many that
#: four seconds of ten hours have eight; and after it, to be held against other logs.
_WINDOW, _KEPT, _AFTERWARDS = 8, 1 << 17, 1 << 13
#: Least information of a value that differs from the others of its window, bits: such a window has
#: more than four values to choose from.
_BITS = 2.0
#: One window in so many at last: what is still too much then is one reading all the time.
_RAREST = 1 << 20
#: s; what recurs within it is a vibration that the samples are in step with.
_VIBRATION = 1.0
#: Windows in a row that rounding to other digits may keep from recurring.
_MISSED = 8
#: Samples from which a channel's noise is taken, and the gain of fourth differences on it.
_ENOUGH, _FOURTH = 64, 70.0**0.5
#: What `Dwells` holds of each dwell, beside its temperature.
_OF_EACH = (
    "start", "end", "position", "position_cov", "force", "force_cov", "force_min", "force_max",
    "count", "effective",
)  # fmt: skip
#: A window of one sensor. time, place : when it begins, s, and at which sample. choice : hash by
#: which it is kept. key : hash of all of it. new : values that differ from the others, less one.
_WINDOW_TYPE = np.dtype(
    [("time", "f8"), ("place", "i8"), ("choice", "u8"), ("key", "u8"), ("new", "i8")]
)
_Windows = npt.NDArray[Any]
_MIX = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], dtype=np.uint64)


@record
class Repeat:
    """Samples of one sensor, in s of the log's clock, that are those of an earlier stretch."""

    sensor: int
    begin: float
    end: float
    original: float


class RepeatedSamples:
    """Looks for samples that a log holds twice, while its pieces pass."""

    def __init__(self, rig: Rig) -> None:
        self._sensors = [_Sensor(axes) for axes in rig.axes]

    def add(self, piece: Log) -> None:
        """Take note of a piece; the rows of averaged postures are compared as such elsewhere."""
        if piece.rows == "postures":
            return
        for sensor, series in zip(self._sensors, piece.force, strict=True):
            sensor.add(series.time, series.value)

    def found(self) -> tuple[Repeat, ...]:
        """Return the stretches that repeat earlier ones; fewer windows are kept from now on."""
        found = tuple(
            repeat
            for i, sensor in enumerate(self._sensors)
            for repeat in _runs(i, sensor.windows, sensor.passed)
        )
        for sensor in self._sensors:
            sensor.thin(_AFTERWARDS)
        return found

    def shared(self, other: RepeatedSamples) -> tuple[Repeat, ...]:
        """Return the stretches of another log, by its clock, that repeat some of this one."""
        pairs = enumerate(zip(self._sensors, other._sensors, strict=True))
        return tuple(repeat for i, (own, its) in pairs for repeat in own.shared(its, i))


def counted_once(dwells: Dwells, repeats: Sequence[Repeat]) -> Dwells:
    """Leave out dwells of which half the samples, or more, are those of earlier ones."""
    covered = np.zeros((len(dwells), len(dwells.supports)))
    original, span = np.full(len(dwells), np.nan), dwells.end - dwells.start
    for repeat in repeats:
        overlap = np.minimum(dwells.end, repeat.end) - np.maximum(dwells.start, repeat.begin)
        covered[:, repeat.sensor] += np.maximum(overlap, 0)
        source = dwells.start - repeat.begin + repeat.original
        original = np.where(np.isnan(original) & (2 * overlap >= span), source, original)
    twice = (covered > 0) & (2 * covered >= span[:, None])
    lost = np.asarray(twice.any(axis=1))
    if not lost.any():
        return dwells
    out = [
        LeftOut(
            float(dwells.start[k]),
            float(dwells.end[k]),
            Finding(
                "stop-repeated",
                _named(dwells.supports, twice[k]),
                values={"original": float(original[k])},
            ),
        )
        for k in np.flatnonzero(lost)
    ]
    first: dict[str, Value] = {
        "dwells": len(dwells),
        "begin": out[0].start,
        "original": out[0].reason.values["original"],
    }
    said = Finding("samples-repeated", out[0].reason.subject, len(out), values=first)
    return replace(
        _taken(dwells, ~lost),
        left_out=tuple(sorted((*dwells.left_out, *out), key=lambda piece: piece.start)),
        findings=(*dwells.findings, said),
    )


def refuse(repeats: Sequence[Repeat], supports: Sequence[str]) -> None:
    """Raise DataError where samples of a moving log are there twice."""
    if not repeats:
        return
    first = min(repeats, key=lambda repeat: repeat.begin)
    alike = [r.begin < first.end and first.begin < r.end for r in repeats]
    sensors = {r.sensor for r, there in zip(repeats, alike, strict=True) if there}
    named = _named(supports, np.isin(np.arange(len(supports)), list(sensors)))
    facts: dict[str, Value] = {
        "begin": first.begin,
        "end": first.end,
        "original": first.original,
    }
    raise DataError(Finding("samples-twice", named, values=facts))


def _named(supports: Sequence[str], which: BoolArray) -> tuple[str, ...]:
    named = tuple(name for name, there in zip(supports, which, strict=True) if there)
    return ("all sensors",) if len(named) == len(supports) else named


def _taken(dwells: Dwells, keep: BoolArray) -> Dwells:
    """Some of the dwells."""
    return replace(
        dwells,
        **{name: getattr(dwells, name)[keep] for name in _OF_EACH},
        temperature=None if dwells.temperature is None else dwells.temperature[keep],
    )


class _Sensor:
    """One sensor's samples as they pass."""

    def __init__(self, axes: BoolArray) -> None:
        self._axes, self._quantum, self._liveliest = axes, np.empty(0), 0
        self._time, self._first = np.empty(0), np.empty((0, int(axes.sum())))
        self._steps = np.empty(self._first.shape, np.uint64)  # of windows that are not whole
        self.passed, self._every = 0, np.uint64(1)
        self._kept: list[_Windows] = [np.empty(0, _WINDOW_TYPE)]

    @property
    def windows(self) -> _Windows:
        """All that are kept."""
        self._kept = [np.concatenate(self._kept)]
        return self._kept[0]

    def add(self, time: FloatArray, value: FloatArray) -> None:
        """Keep some windows of what passes: all at first, of a long log one in 2, 4, 8 …"""
        value = value if self._axes.all() else value[:, self._axes]
        self._time = np.concatenate([self._time, time])
        if not self._quantum.size:
            self._first = value = np.concatenate([self._first, value])
            if not value.shape[1] or len(value) < _ENOUGH:
                return
            self._quantum = _quantum(value)
            changed = np.count_nonzero(np.diff(value, axis=0), axis=0)
            self._liveliest = int(np.argmax(changed))
        # Whole steps; off the ties that round numbers would make.
        steps = (value / self._quantum + 0.2360679).astype(np.int64).view(np.uint64)
        self._steps = np.concatenate([self._steps, steps])
        if len(self._steps) >= _WINDOW:
            self._take_whole()

    def shared(self, other: _Sensor, sensor: int) -> Iterator[Repeat]:
        """Return the stretches of another log that repeat some of this one."""
        w, later = self.windows, other.windows
        if not len(w) or not len(later):
            return
        apart = float(w["time"][-1] - later["time"][0]) + 2 * _VIBRATION
        both = np.concatenate([w, later])
        both["time"][len(w) :] += apart
        both["place"][len(w) :] += self.passed + _WINDOW
        for repeat in _runs(sensor, both, self.passed + other.passed):
            if repeat.original <= w["time"][-1] < repeat.begin:
                yield replace(repeat, begin=repeat.begin - apart, end=repeat.end - apart)

    def thin(self, most: int) -> None:
        """Keep at most so many windows."""
        while len(self.windows) > most and self._every < _RAREST:
            self._keep_half()

    def _keep_half(self) -> None:
        self._every *= np.uint64(2)
        self._kept = [part[self._chosen(part["choice"])] for part in self._kept]

    def _take_whole(self) -> None:
        """Keep some of the windows that are whole by now."""
        count = len(self._time) - _WINDOW + 1
        choice = self._steps[:, self._liveliest] * _MIX[0]
        choice ^= choice >> np.uint64(32)
        choice = (choice[:-1] + choice[1:] * np.uint64(3)) * _MIX[1]
        choice = choice[:-2] + (choice[2:] >> np.uint64(7))
        choice = choice[:count] * _MIX[2]
        here = np.flatnonzero(self._chosen(choice))
        while len(here) + sum(map(len, self._kept)) > _KEPT and self._every < _RAREST:
            self._keep_half()
            here = here[self._chosen(choice[here])]
        here = here[: max(0, _KEPT - sum(map(len, self._kept)))]
        row = np.zeros(len(self._steps), np.uint64)
        for channel, mix in zip(self._steps.T, _MIX, strict=False):
            row += channel * mix
        row = row[here + np.arange(_WINDOW)[:, None]]
        row ^= row >> np.uint64(29)
        key = _MIX[1] ** np.arange(1, _WINDOW + 1, dtype=np.uint64) @ row
        new = np.count_nonzero(np.diff(np.sort(row, axis=0), axis=0), axis=0)
        found = np.empty(len(here), _WINDOW_TYPE)
        columns = (self._time[here], self.passed + here, choice[here], key, new)
        for name, column in zip(_WINDOW_TYPE.names or (), columns, strict=True):
            found[name] = column
        self.passed += count
        self._time, self._steps = self._time[count:].copy(), self._steps[count:].copy()
        self._kept.append(found)

    def _chosen(self, choice: _Hashes) -> BoolArray:
        return np.asarray(choice >> np.uint64(40) & (self._every - np.uint64(1)) == 0)


def _quantum(value: FloatArray) -> FloatArray:
    """Steps to count each channel (N, C) in: the noise that no neighbouring sample foretells.

    Coarse enough for a copy with fewer digits; a power of two, the same from other begins.
    """
    fourth = np.abs(np.diff(value, 4, axis=0)) / _FOURTH
    noise = [np.median(c[c > 0]) if np.any(c > 0) else 1.0 for c in fourth.T]
    return np.asarray(2.0 ** np.floor(np.log2(noise)))


def _runs(sensor: int, windows: _Windows, count: int) -> Iterator[Repeat]:
    """Windows that recur one after the other at one distance, and could not by chance.

    count : windows that passed.
    """
    share = np.diff(windows["place"], append=np.iinfo(np.int64).max).clip(max=_WINDOW) / _WINDOW
    bits = _BITS * windows["new"] * share  # of each beside its neighbours
    order = np.lexsort((windows["place"], windows["key"]))
    a, b = order[:-1], order[1:]
    same = windows["key"][a] == windows["key"][b]
    near = same & (np.abs(windows["time"][b] - windows["time"][a]) <= _VIBRATION)
    in_step = np.zeros(len(order), dtype=np.bool_)
    in_step[a[near]] = in_step[b[near]] = True
    pair = same & ~in_step[a] & ~in_step[b]
    a, b = a[pair], b[pair]
    distance = windows["place"][b] - windows["place"][a]
    order = np.lexsort((b, distance))
    a, b, distance = a[order], b[order], distance[order]
    breaks = (np.diff(distance) != 0) | (np.diff(b) > _MISSED)
    needed = 2 * np.log2(max(count, 2)) - np.log2(REPEATED_BY_CHANCE)
    for run in np.split(np.arange(len(b)), np.flatnonzero(breaks) + 1):
        if len(run) and bits[b[run]].sum() >= needed:
            first, last = b[run[0]], b[run[-1]]
            yield Repeat(
                sensor,
                float(windows["time"][first]),
                float(windows["time"][last]),
                float(windows["time"][a[run[0]]]),
            )
