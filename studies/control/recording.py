"""What a control simulation keeps: phases, maxima, traces."""

from __future__ import annotations

import numpy as np

from studies.control.contact import GearPair
from studies.control.runs import PHASES, Result, Traces
from tdfscal.records import BoolArray, FloatArray, IntArray

#: Sums squares of a wrench to squared lengths of force and moment, (6, 2).
_HALVES = np.repeat(np.eye(2), 3, axis=0)


class Book:
    """Maxima by phase and traces of L lanes."""

    def __init__(self, lanes: int, step: float) -> None:
        """Step : s."""
        L = lanes
        self.step = step
        self.phase: IntArray = np.zeros(L, dtype=np.int64)
        self.phase_start = np.full((L, len(PHASES)), np.nan)
        self.phase_start[:, 0] = 0.0
        self.stopped = np.full(L, np.nan)
        self.seated = np.zeros(L, dtype=np.bool_)
        self.jammed = np.zeros(L, dtype=np.bool_)
        self._peak = np.zeros((L, len(PHASES), 14))
        # Of the phase under way: |true wrench|, its squared lengths, |measured wrench|.
        self._now = np.zeros((L, 14))
        self._rows: list[tuple[float | FloatArray, ...]] = []

    def progress(
        self, k: int, active: BoolArray, gears: GearPair, q: FloatArray, touching: BoolArray
    ) -> None:
        """Note the phase of each lane that is under way; q (L, 6), touching (L,)."""
        depth = q[:, 2]
        tilt = gears.radius * np.abs(q[:, 3:5]).max(axis=1)
        phase = touching.astype(np.int64)
        phase[depth > gears.chamfer] = 2
        phase[depth + tilt > gears.length] = 3
        new = active & (phase > self.phase)
        if not new.any():
            return
        for p in range(1, len(PHASES)):
            self.phase_start[new & (phase >= p) & (self.phase < p), p] = (k + 1) * self.step
        self._close(new)
        self.phase[new] = phase[new]

    def contact(self, active: BoolArray, wrench: FloatArray) -> None:
        """Note the true contact wrench (L, 6)."""
        size = np.abs(wrench)
        self._note(active, slice(0, 8), np.hstack([size, (size * size) @ _HALVES]))

    def measured(self, active: BoolArray, wrench: FloatArray) -> None:
        """Note the controller's wrench (L, 6)."""
        self._note(active, slice(8, 14), np.abs(wrench))

    def _note(self, active: BoolArray, columns: slice, size: FloatArray) -> None:
        size[~active] = 0.0
        np.maximum(self._now[:, columns], size, out=self._now[:, columns])

    def stop(self, k: int, reached: BoolArray, deep: BoolArray) -> None:
        """Note lanes that stop at a threshold, and which of all are deep enough to be seated."""
        self.stopped[reached] = (k + 1) * self.step
        self.seated |= reached & deep
        self.jammed |= reached & ~deep

    def record(self, k: int, *row: FloatArray) -> None:
        """One row of the traces, in their order after the time."""
        self._rows.append(((k + 1) * self.step, *row))

    def result(self, servo: FloatArray, q: FloatArray) -> Result:
        """Everything noted; servo (L, n, 3) and q (L, 6) at the end."""
        self._close(np.ones(len(self.phase), dtype=np.bool_))
        return Result(
            traces=Traces(*(np.array(column) for column in zip(*self._rows, strict=True))),
            peak=self._peak[..., :6],
            peak_length=np.sqrt(self._peak[..., 6:8]),
            peak_measured=self._peak[..., 8:],
            stopped=self.stopped,
            seated=self.seated,
            jammed=self.jammed,
            phase_start=self.phase_start,
            servo=servo,
            q=q,
        )

    def _close(self, lanes: BoolArray) -> None:
        """Put the maxima of these lanes down to their phase."""
        at = np.flatnonzero(lanes), self.phase[lanes]
        self._peak[at] = np.maximum(self._peak[at], self._now[lanes])
        self._now[lanes] = 0.0
