"""What goes into a control simulation, what is kept of it, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from studies.control.contact import GearPair
from studies.control.machine import Impedance, PositionErrors, Sensing, Servo
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig
from tdfscal.simulation.truth import Truth

PHASES = ("approach", "first contact", "insertion", "seated")


@dataclass(frozen=True, slots=True)
class Controller:
    """Controller and machine.

    damping : ratio, of what gives between servo and terminal, as in `terminal.body`. tare : s at
    rest before the start whose mean wrench is F_d of the lanes that are tared. thresholds : N, |F|
    along x, y, z of the LCS at which the controller stops. step : s. trace_rate : Hz, at most, of
    records.
    """

    impedance: Impedance = field(default_factory=Impedance)
    servo: Servo = field(default_factory=Servo)
    sensing: Sensing = field(default_factory=Sensing)
    damping: float = 0.05
    tare: float = 2.0
    thresholds: tuple[float, float, float] = (20.0, 20.0, 40.0)
    step: float = 4.0e-3
    trace_rate: float = 10.0

    @property
    def held(self) -> int:
        """Steps per force sample, whole."""
        return round(1.0 / (self.sensing.rate * self.step))


@dataclass(frozen=True, slots=True)
class Machines:
    """L machines. truth, assumed : (L,), what is, and what the controller takes for true. errors :
    of the carriages. tared : (L,), which of them tare. noise : one seed of the sensors' noise per
    run; lane = calibration · runs + run, so that calibrations meet the same draws.
    """

    rig: Rig
    truth: Truth
    errors: PositionErrors
    assumed: Truth
    tared: BoolArray
    noise: tuple[np.random.SeedSequence, ...]


@dataclass(frozen=True, slots=True)
class Docking:
    """Gears. mouth : (3,), m, BCS, middle of the bore's, whose axes are the BCS's. complete : m,
    depth at which the controller takes them as seated when a threshold is reached.
    """

    gears: GearPair
    mouth: FloatArray
    complete: float


@dataclass(frozen=True, slots=True)
class Traces:
    """What was recorded at T times of L lanes; lanes that have stopped keep their last state.

    time : (T,), s, from the start of the motion. contact : (T, L, 6), true contact wrench on the
    terminal, measured : the controller's, smoothed and tared; N, N·m about the LCS origin, LCS.
    deviation : (T, L, 6), x − x_d, m and rad.
    """

    time: FloatArray
    contact: FloatArray
    measured: FloatArray
    deviation: FloatArray


@dataclass(frozen=True, slots=True)
class Result:
    """How L lanes went.

    peak : (L, 4, 6), largest |true contact wrench| per phase. peak_measured : (L, 4, 6), of the
    controller's. stopped : (L,), s, NaN where no threshold was reached. seated : (L,), at depth.
    phase_start : (L, 4), s, NaN where a phase was not reached. servo : (L, n, 3), m, encoder values
    at the end. q : (L, 6), of the shaft in the bore at the end, NaN without gears.
    """

    traces: Traces
    peak: FloatArray
    peak_measured: FloatArray
    stopped: FloatArray
    seated: BoolArray
    phase_start: FloatArray
    servo: FloatArray
    q: FloatArray

    @property
    def jammed(self) -> BoolArray:
        """(L,): stopped before it was deep enough."""
        return np.isfinite(self.stopped) & ~self.seated


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
        self._peak = np.zeros((L, len(PHASES), 12))
        # Of the phase under way: |true wrench|, |measured wrench|.
        self._now = np.zeros((L, 12))
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
        self._note(active, slice(0, 6), np.abs(wrench))

    def measured(self, active: BoolArray, wrench: FloatArray) -> None:
        """Note the controller's wrench (L, 6)."""
        self._note(active, slice(6, 12), np.abs(wrench))

    def _note(self, active: BoolArray, columns: slice, size: FloatArray) -> None:
        size[~active] = 0.0
        np.maximum(self._now[:, columns], size, out=self._now[:, columns])

    def stop(self, k: int, reached: BoolArray, deep: BoolArray) -> None:
        """Note lanes that stop at a threshold, and which of all are deep enough to be seated."""
        self.stopped[reached] = (k + 1) * self.step
        self.seated |= reached & deep

    def record(self, k: int, *row: FloatArray) -> None:
        """One row of the traces, in their order after the time."""
        self._rows.append(((k + 1) * self.step, *row))

    def result(self, servo: FloatArray, q: FloatArray) -> Result:
        """Everything noted; servo (L, n, 3) and q (L, 6) at the end."""
        self._close(np.ones(len(self.phase), dtype=np.bool_))
        return Result(
            traces=Traces(*(np.array(column) for column in zip(*self._rows, strict=True))),
            peak=self._peak[..., :6],
            peak_measured=self._peak[..., 6:],
            stopped=self.stopped,
            seated=self.seated,
            phase_start=self.phase_start,
            servo=servo,
            q=q,
        )

    def _close(self, lanes: BoolArray) -> None:
        """Put the maxima of these lanes down to their phase."""
        at = np.flatnonzero(lanes), self.phase[lanes]
        self._peak[at] = np.maximum(self._peak[at], self._now[lanes])
        self._now[lanes] = 0.0
