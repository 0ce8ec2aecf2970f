"""Readings that stand alone: one sample far off those before and after it, which agree.

No terminal of hundreds of kilograms moves so: the recorder, the bus or an edit has spoilt a cell.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tdfscal.findings import Finding, Value
from tdfscal.logs.common.clock import shown
from tdfscal.logs.common.request import Signal
from tdfscal.records import BoolArray, FloatArray, IntArray

_FEWEST = 32  # samples
_GLANCE, _ENOUGH = 16, 64  # of so many steps, one shows how large they are; so many at least
_UNUSUAL = 10.0  # a step / the usual one, from which on a reading is looked at
_FAR = 8.0  # a reading's distance / the largest step near it
_NEAR = 8  # steps looked at on either side
_EXACT = 1e-5  # of the largest reading: steps of a signal without noise


class LoneReadings:
    """Those of one signal, followed from piece to piece.

    count : how many. A piece's first and last samples have no neighbours and are kept.
    """

    def __init__(self, signal: Signal) -> None:
        self._signal = signal
        self._first: tuple[float, float, float] | None = None
        self._samples = 0
        self.count = 0

    def others(self, time: FloatArray, value: FloatArray) -> BoolArray | None:
        """Which of the samples, (N,) s and (N, 3), do not stand alone; None where none does."""
        self._samples += len(time)
        if len(time) < _FEWEST:
            return None
        step = np.diff(value, axis=0)
        usual = _usual(step)
        unusual = np.maximum(step.max(axis=0), -step.min(axis=0)) > _UNUSUAL * usual
        found = [(k, axis) for axis in np.flatnonzero(unusual) for k in _lone(value[:, axis])]
        if not found:
            return None
        if self._first is None:
            k, axis = min(found)
            self._first = float(time[k]), float(value[k, axis]), float(value[k - 1, axis])
        keep = np.ones(len(time), dtype=np.bool_)
        keep[[k for k, _ in found]] = False
        self.count += int(np.count_nonzero(~keep))
        return keep

    def findings(self) -> list[Finding]:
        """Say how many there were, and where the first one."""
        if self._first is None:
            return []
        at, lone, before = self._first
        values: dict[str, Value] = {
            "signal": self._signal.quantity,
            "samples": self._samples,
            "at": shown(at),
            "lone": lone,
            "before": before,
            "lone_unit": {"position": "m", "force": "N"}[self._signal.quantity],
        }
        return [Finding("readings-alone", (self._signal.support,), self.count, values=values)]


def _usual(step: FloatArray) -> FloatArray:
    """Mean size of some of the steps (N, ...)."""
    return np.asarray(np.abs(step[:: max(min(_GLANCE, len(step) // _ENOUGH), 1)]).mean(axis=0))


def _lone(value: FloatArray) -> Iterator[int]:
    """Samples of an axis (N,) that stand alone."""
    step = np.diff(value)
    size = np.abs(step)
    height = np.minimum(size[:-1], size[1:])
    back = (step[:-1] < 0.0) != (step[1:] < 0.0)
    candidates: IntArray = np.flatnonzero(back & (height > _UNUSUAL * _usual(step))) + 1
    if not candidates.size:
        return
    quiet = size.copy()
    quiet[candidates - 1] = quiet[candidates] = 0.0
    least = quiet.min(initial=np.inf, where=quiet > 0.0)
    if not np.isfinite(least):
        least = _EXACT * np.abs(value).max()
    for k in candidates.tolist():
        around = np.concatenate([size[max(k - 1 - _NEAR, 0) : k - 1], size[k + 1 : k + 1 + _NEAR]])
        across = abs(value[k + 1] - value[k - 1])
        if height[k - 1] > _FAR * max(around.max(initial=0.0), across, least):
            yield k
