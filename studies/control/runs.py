"""What goes into a control simulation, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from studies.control.contact import GearPair
from studies.control.impedance import Impedance
from studies.control.sensors import Sensing
from studies.control.servo import PositionErrors, Servo
from tdfscal.errors import UsageError
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.simulation.truth import Truth

PHASES = ("approach", "first contact", "insertion", "seated")


@dataclass(frozen=True, slots=True)
class Controller:
    """Controller and machine.

    damping : ratio, of what gives between servo and terminal, as in `terminal.body`. tare : s at
    rest before the start whose mean wrench is F_d of the lanes that are tared. thresholds : N, |F|
    along x, y, z of the LCS at which the controller stops. step : s. trace_rate : Hz, at most, of
    records; readings : servos and sensors are recorded too.
    """

    impedance: Impedance = field(default_factory=Impedance)
    servo: Servo = field(default_factory=Servo)
    sensing: Sensing = field(default_factory=Sensing)
    damping: float = 0.05
    tare: float = 2.0
    thresholds: tuple[float, float, float] = (20.0, 20.0, 40.0)
    step: float = 4.0e-3
    trace_rate: float = 10.0
    readings: bool = False

    @property
    def held(self) -> int:
        """Steps per force sample; UsageError where they do not fit."""
        ratio = 1.0 / (self.sensing.rate * self.step) if self.step > 0.0 else 0.0
        if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6 * ratio:
            raise UsageError(
                f"a step of {1e3 * self.step:g} ms does not divide the force sensors' "
                f"{1e3 / self.sensing.rate:g} ms",
                hint="choose a whole number of steps per sample",
            )
        return round(ratio)


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
    deviation : (T, L, 6), x − x_d, m and rad. depth : (T, L), m, true, NaN without gears.
    servo, reading : (T, L, n, 3), m, BCS, and N, sensor frames, as a recorder would see them; of
    no lanes where they were not asked for.
    """

    time: FloatArray
    contact: FloatArray
    measured: FloatArray
    deviation: FloatArray
    depth: FloatArray
    servo: FloatArray
    reading: FloatArray


@dataclass(frozen=True, slots=True)
class Result:
    """How L lanes went.

    peak : (L, 4, 6), largest |true contact wrench| per phase; peak_length : (L, 4, 2), of force and
    moment. peak_measured : (L, 4, 6), of the controller's. stopped : (L,), s, NaN where no
    threshold was reached. seated : (L,), stopped at depth. jammed : (L,), stopped before.
    phase_start : (L, 4), s, NaN where a phase was not reached. servo : (L, n, 3), m, encoder values
    at the end. q : (L, 6), of the shaft in the bore at the end, NaN without gears.
    """

    traces: Traces
    peak: FloatArray
    peak_length: FloatArray
    peak_measured: FloatArray
    stopped: FloatArray
    seated: BoolArray
    jammed: BoolArray
    phase_start: FloatArray
    servo: FloatArray
    q: FloatArray
