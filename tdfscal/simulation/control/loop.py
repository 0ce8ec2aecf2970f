"""The closed loop: sensors, wrench, impedance, servos, elastic rig, contact; all lanes at once."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig
from tdfscal.simulation import rotations
from tdfscal.simulation.control.contact import Bore, GearPair
from tdfscal.simulation.control.impedance import Impedance, require_stable, transition
from tdfscal.simulation.control.reference import Reference, follow
from tdfscal.simulation.control.sensors import Assumed, Sensing, Sensors, WrenchObserver
from tdfscal.simulation.control.servo import PositionErrors, Servo
from tdfscal.simulation.control.terminal import Terminal, moment
from tdfscal.simulation.truth import Truth

_CHUNK = 512
PHASES = ("approach", "first contact", "insertion", "seated")


@dataclass(frozen=True, slots=True)
class Controller:
    """Controller and machine.

    tare : s at rest before the start whose mean wrench is F_d; 0: not tared, F_d = 0.
    thresholds : N, |F| along x, y, z of the LCS at which the controller stops. step : s.
    trace_rate : Hz, at most, of records.
    """

    impedance: Impedance = field(default_factory=Impedance)
    servo: Servo = field(default_factory=Servo)
    sensing: Sensing = field(default_factory=Sensing)
    tare: float = 2.0
    thresholds: tuple[float, float, float] = (20.0, 20.0, 40.0)
    step: float = 4.0e-3
    trace_rate: float = 25.0

    @property
    def held(self) -> int:
        """Steps per force sample; UsageError where they do not fit."""
        ratio = 1.0 / (self.sensing.rate * self.step)
        if self.step <= 0.0 or round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6 * ratio:
            raise UsageError(
                f"a step of {1e3 * self.step:g} ms does not divide the force sensors' "
                f"{1e3 / self.sensing.rate:g} ms",
                hint="choose a whole number of steps per sample",
            )
        return round(ratio)


@dataclass(frozen=True, slots=True)
class Machines:
    """L machines. truth : (L,). errors : of the carriages. noise : seed of the sensors' noise,
    which goes by run: lane = calibration · runs + run, so that calibrations meet the same draws.
    """

    rig: Rig
    truth: Truth
    errors: PositionErrors
    assumed: Assumed
    runs: int
    noise: np.random.SeedSequence


@dataclass(frozen=True, slots=True)
class Docking:
    """A gear pair with its bore (L,), and the depth (m) at which the controller takes it as seated
    when a threshold is reached.
    """

    gears: GearPair
    bore: Bore
    complete: float


@dataclass(frozen=True, slots=True)
class Traces:
    """What was recorded at T times of L lanes; lanes that have stopped keep their last state.

    time : (T,), s, from the start of the motion. contact : (T, L, 6), true contact wrench on the
    terminal, measured : the controller's, smoothed and tared; N, N·m about the LCS origin, LCS.
    deviation : (T, L, 6), x − x_d, m and rad. depth : (T, L), m, true, NaN without gears.
    servo, reading : (T, L, n, 3), m, BCS, and N, sensor frames, as a recorder would see them.
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

    peak : (4, L, 6), largest |true contact wrench| per phase; peak_length : (4, L, 2), of force and
    moment. peak_measured : (4, L, 6). stopped : (L,), s, NaN where no threshold was reached.
    seated : (L,), stopped at depth. jammed : (L,), stopped before. phase_start : (4, L), s, NaN
    where a phase was not reached. servo : (L, n, 3), m, encoder values at the end. q : (L, 6), of
    the shaft in the bore at the end, NaN without gears. steps : simulated.
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
    steps: int


def simulate(
    machines: Machines, controller: Controller, reference: Reference, docking: Docking | None = None
) -> Result:
    """Run all lanes until the reference ends, or every lane has stopped at a threshold.

    Raises
    ------
    UsageError : the step does not fit, or the loop is unstable in contact.
    NotConvergedError : a terminal does not stand on its carriages.
    """
    loop = _Loop(machines, controller, reference, docking)
    return loop.run()


class _Loop:
    def __init__(
        self,
        machines: Machines,
        controller: Controller,
        reference: Reference,
        docking: Docking | None,
    ) -> None:
        self.c, self.docking, self.reference = controller, docking, reference
        self.held = controller.held
        impedance = controller.impedance
        if docking is not None:
            surroundings = docking.gears.stiffness_at_mouth_and_tip(impedance.centre)
            require_stable(
                impedance, surroundings, controller.servo.lag, controller.step, self.held
            )
            self.tip = np.asarray(docking.gears.tip)
        self.rig, self.errors, self.runs = machines.rig, machines.errors, machines.runs
        self.centre = np.asarray(impedance.centre)
        self.first, self.way, self.turn = follow(reference, self.centre)
        self.turns = bool(np.any(self.turn))
        self.start = reference.start.rotation
        self.lanes = L = len(self.first)
        self.transition = transition(impedance, controller.step)
        self.mass, self.damping = np.array(impedance.mass), np.array(impedance.damping)
        self.sensors = Sensors(machines.truth)
        self.observer = WrenchObserver(machines.assumed, self.centre)
        self.noise = np.random.default_rng(machines.noise)
        self.chunk, self.chunk_at = np.empty((0,)), _CHUNK
        self.deviation = np.zeros((L, 6, 2))
        self.share = controller.servo.share(controller.step)
        self.command(np.zeros(L), np.zeros(L))
        self.servo = self.target.copy()
        self.terminal = Terminal(machines.truth, self._stand(), reference.start)
        self.contact = np.zeros((L, 6))  # BCS, about the LCS origin
        self.touching = False
        self.q = np.full((L, 6), np.nan)
        self.last_q: FloatArray | None = None
        self.filtered: FloatArray | None = None
        self.offset = np.zeros((L, 6))
        self.seen = np.zeros((L, 6))
        self.smooth = np.zeros((L, 6))
        self.reading = np.zeros_like(self.servo)
        self.watch = -np.expm1(-1.0 / (controller.sensing.rate * controller.sensing.watch))
        self.depth_command = np.zeros(L)

    def _stand(self) -> FloatArray:
        return self.servo + self.errors.at(self.servo)

    def command(self, share: FloatArray, rate: FloatArray) -> None:
        """Carriages' targets for the reference at `share` plus the deviation; and R of both."""
        R = self.start
        if self.turns:
            R = R @ rotations.exp(share[:, None] * self.turn)
        self.planned = R
        self.R = R @ rotations.exp(self.deviation[:, 3:, 0])
        moved = (R @ self.deviation[:, :3, :1])[..., 0]
        point = self.first + share[:, None] * self.way + moved
        arm = (self.rig.hinge - self.centre) @ np.swapaxes(self.R, -1, -2)
        self.target = self.c.servo.command(arm + point[:, None, :])
        self.point = point

    def sample(self) -> FloatArray:
        """One reading of all sensors, filtered as the controller does."""
        if self.chunk_at >= _CHUNK:
            shape = (_CHUNK, self.runs, self.rig.n, 3)
            self.chunk = self.c.sensing.noise * self.noise.standard_normal(shape)
            self.chunk_at = 0
        noise = self.chunk[self.chunk_at]
        self.chunk_at += 1
        clean = self.sensors.read(self.terminal.force)
        self.reading = (clean.reshape(-1, *noise.shape) + noise).reshape(clean.shape)
        if self.filtered is None:
            self.filtered = self.reading
        else:
            self.filtered = self.filtered + self.c.sensing.gain * (self.reading - self.filtered)
        return self.filtered

    def sense(self) -> None:
        """Contact wrench about the centre, tared, and a smoothed copy of it."""
        self.seen = self.observer.wrench(self.sample(), self.R) - self.offset
        self.smooth = self.smooth + self.watch * (self.seen - self.smooth)

    def settle(self) -> None:
        """Stand still, and tare."""
        count = round(self.c.tare * self.c.sensing.rate)
        if count:
            total = np.zeros_like(self.offset)
            for _ in range(count):
                total += self.observer.wrench(self.sample(), self.R)
            self.offset = total / count

    def physics(self) -> None:
        """Servos go on, the terminal comes to rest, contact changes."""
        self.servo = self.servo + self.share * (self.target - self.servo)
        self.terminal.move(self._stand(), self.contact)
        if self.docking is None:
            return
        bore, R = self.docking.bore, self.terminal.rotation
        lever = R @ self.tip
        self.q = bore.coordinates(lever + self.terminal.translation, R)
        rate = None if self.last_q is None else (self.q - self.last_q) / self.c.step
        self.last_q = self.q
        local = self.docking.gears.wrench(self.q, rate)
        self.touching = bool(local.any())
        both = local.reshape(-1, 2, 3) @ np.swapaxes(bore.rotation, -1, -2)
        contact = both.reshape(-1, 6)
        if self.touching:
            contact[:, 3:] += moment(lever[:, None, :], both[:, :1])
            self.terminal.yield_to(contact - self.contact)
        self.contact = contact

    def run(self) -> Result:
        c, L = self.c, self.lanes
        self.settle()
        book = _Book(self)
        active = np.ones(L, dtype=np.bool_)
        at = np.zeros(L)
        rates = np.concatenate([self.way, self.turn], axis=1)
        steps = len(self.reference.share)
        every = max(1, round(1.0 / (c.trace_rate * c.step)))
        done = 0
        for k in range(steps):
            if k % self.held == 0:
                self.sense()
            live = active.astype(np.float64)
            at = np.where(active, self.reference.share[k], at)
            # M ẍ_d + B ẋ_d of the reference, in the axes of its LCS.
            speed, acceleration = self.reference.rate[k], self.reference.acceleration[k]
            drive = (self.mass * acceleration + self.damping * speed) * self._in_lcs(rates)
            new = self.transition.step(self.deviation, self.seen - drive)
            self.deviation = np.where(active[:, None, None], new, self.deviation)
            self.command(at, live)
            self.physics()
            done = k + 1
            book.note(k, active)
            if self.docking is not None:
                active = book.stop(k, active)
            if k % every == every - 1 or not active.any():
                book.record(k)
            if not active.any():
                break
        return book.result(done)

    def _in_lcs(self, rates: FloatArray) -> FloatArray:
        out = rates.copy()
        out[:, :3] = (np.swapaxes(self.planned, -1, -2) @ rates[:, :3, None])[..., 0]
        return out

    def about_origin(self, wrench: FloatArray) -> FloatArray:
        """Moments about the LCS origin instead of the centre; both LCS."""
        out = wrench.copy()
        lever = np.broadcast_to(self.centre, (self.lanes, 1, 3))
        out[:, 3:] += moment(lever, wrench[:, None, :3])
        return out

    def true_contact(self) -> FloatArray:
        """Contact wrench (L, 6) on the terminal, LCS, about its origin."""
        both = self.contact.reshape(-1, 2, 3) @ self.terminal.rotation
        return np.asarray(both.reshape(-1, 6))


class _Book:
    """Keeps what a result is made of."""

    def __init__(self, loop: _Loop) -> None:
        L = loop.lanes
        self.loop = loop
        self.peak = np.zeros((4, L, 6))
        self.peak_length = np.zeros((4, L, 2))
        self.peak_measured = np.zeros((4, L, 6))
        self.phase: IntArray = np.zeros(L, dtype=np.int64)
        self.phase_start = np.full((4, L), np.nan)
        self.phase_start[0] = 0.0
        self.stopped = np.full(L, np.nan)
        self.seated = np.zeros(L, dtype=np.bool_)
        self.jammed = np.zeros(L, dtype=np.bool_)
        self.lane = np.arange(L)
        self.rows: list[tuple[float | FloatArray, ...]] = []
        self.limits = np.array(loop.c.thresholds)

    def note(self, k: int, active: BoolArray) -> None:
        """Phase and peaks of the lanes that are under way."""
        loop = self.loop
        if loop.docking is None or (not loop.touching and not self.phase.any()):
            return
        if loop.touching:
            gears, depth = loop.docking.gears, loop.q[:, 2]
            touching = np.any(loop.contact, axis=1)
            phase = np.where(touching, 1, 0)
            phase = np.where(depth > gears.chamfer, 2, phase)
            tilt = gears.radius * np.abs(loop.q[:, 3:5]).max(axis=1)
            phase = np.where(depth + tilt > gears.length, 3, phase)
            phase = np.where(active, np.maximum(self.phase, phase), self.phase)
            for p in range(1, 4):
                new = (phase >= p) & (self.phase < p)
                self.phase_start[p, new] = (k + 1) * loop.c.step
            self.phase = phase
        size = np.where(active[:, None], np.abs(loop.true_contact()), 0.0)
        length = np.sqrt(np.sum((size * size).reshape(-1, 2, 3), axis=2))
        here = (self.phase, self.lane)
        self.peak[here] = np.maximum(self.peak[here], size)
        self.peak_length[here] = np.maximum(self.peak_length[here], length)
        if k % loop.held:
            return
        seen = np.where(active[:, None], np.abs(loop.about_origin(loop.smooth)), 0.0)
        self.peak_measured[here] = np.maximum(self.peak_measured[here], seen)

    def stop(self, k: int, active: BoolArray) -> BoolArray:
        """Lanes still under way after the controller looked at its thresholds."""
        loop = self.loop
        assert loop.docking is not None
        reached = active & np.any(np.abs(loop.smooth[:, :3]) >= self.limits, axis=1)
        if not reached.any():
            return active
        # The controller knows the depth from its servos and the surveyed place of the bore.
        gone = np.einsum("li,li->l", loop.point - loop.first, loop.way)
        deep = gone / np.linalg.norm(loop.way, axis=1) >= loop.docking.complete
        self.stopped[reached] = (k + 1) * loop.c.step
        self.seated |= reached & deep
        self.jammed |= reached & ~deep
        return np.asarray(active & ~reached)

    def record(self, k: int) -> None:
        """One row of the traces."""
        loop = self.loop
        depth = loop.q[:, 2] if loop.docking is not None else np.full(loop.lanes, np.nan)
        self.rows.append(
            (
                (k + 1) * loop.c.step,
                loop.true_contact(),
                loop.about_origin(loop.smooth),
                loop.deviation[..., 0],
                depth,
                loop.c.servo.command(loop.servo),
                loop.reading,
            )
        )

    def result(self, steps: int) -> Result:
        loop = self.loop
        return Result(
            traces=Traces(*(np.array(column) for column in zip(*self.rows, strict=True))),
            peak=self.peak,
            peak_length=self.peak_length,
            peak_measured=self.peak_measured,
            stopped=self.stopped,
            seated=self.seated,
            jammed=self.jammed,
            phase_start=self.phase_start,
            servo=loop.c.servo.command(loop.servo),
            q=loop.q,
            steps=steps,
        )
