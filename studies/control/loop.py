"""The closed loop: sensors, wrench, impedance, servos, terminal, contact; all lanes at once."""

from __future__ import annotations

import numpy as np

from studies.control.contact import coordinates
from studies.control.machine import Sensors, WrenchObserver, transition
from studies.control.reference import Reference
from studies.control.runs import Book, Controller, Docking, Machines, Result
from studies.control.terminal import Terminal, inertia_of, moment
from tdfscal.records import BoolArray, FloatArray
from tdfscal.simulation import rotations

_CHUNK = 512


def simulate(
    machines: Machines,
    controller: Controller,
    reference: Reference,
    docking: Docking | None = None,
) -> Result:
    """Run all lanes until the reference ends, or every lane has stopped at a threshold.

    controller : with a damping by `stability.designed`, or the loop may shake itself up.

    Raises NotConvergedError where a terminal does not stand on its carriages.
    """
    return Loop(machines, controller, reference, docking).run()


class Loop:
    """L lanes under way; `simulate` runs them."""

    def __init__(
        self,
        machines: Machines,
        controller: Controller,
        reference: Reference,
        docking: Docking | None = None,
    ) -> None:
        self.c, self.docking, self.reference = controller, docking, reference
        self.held = controller.held
        impedance = controller.impedance
        if docking is not None:
            self.tip = np.asarray(docking.gears.tip)
        self.errors, self.tared = machines.errors, machines.tared[:, None]
        self.centre = np.asarray(impedance.centre)
        self.shift = np.eye(6)
        self.shift[:3, 3:] = -rotations.hat(self.centre)
        self.hinge = machines.rig.hinge - self.centre
        begin, end = reference.start, reference.goal
        self.first = begin.rotation @ self.centre + begin.translation
        self.way = end.rotation @ self.centre + end.translation - self.first
        self.turn = rotations.log(np.swapaxes(begin.rotation, -1, -2) @ end.rotation)
        self.turns = bool(np.any(self.turn))
        self.start = reference.start.rotation
        self.lanes = L = len(self.first)
        self.transition = transition(impedance, controller.step)
        self.mass, self.dragging = np.array(impedance.mass), np.array(impedance.damping)
        if impedance.relative:
            self.dragging = np.zeros(6)
        self.sensors = Sensors(machines.truth)
        self.observer = WrenchObserver(machines.assumed, self.centre)
        self.noise = [np.random.default_rng(seed) for seed in machines.noise]
        self.chunk, self.chunk_at = np.empty((0,)), _CHUNK
        self.deviation = np.zeros((L, 6, 2))
        self.share = controller.servo.share(controller.step)
        self.planned = self.start
        self.rates = self._rates()
        self.command(np.zeros(L))
        self.servo = self.target.copy()
        inertia = np.broadcast_to(inertia_of(machines.rig), (L, 3, 3))
        self.terminal = Terminal(
            machines.truth, inertia, controller.damping, self._stand(), reference.start,
            controller.step,
        )  # fmt: skip
        self.contact = np.zeros((L, 6))  # BCS, about the LCS origin
        self.touching = False
        self.q = np.full((L, 6), np.nan)
        self.filtered: FloatArray | None = None
        self.offset = np.zeros((L, 6))
        self.seen = np.zeros((L, 6))
        self.smooth = np.zeros((L, 6))
        self.watch = -np.expm1(-1.0 / (controller.sensing.rate * controller.sensing.watch))

    def _stand(self) -> FloatArray:
        return self.servo + self.errors.at(self.servo)

    def _rates(self) -> FloatArray:
        """Rate (L, 6) of the reference by its share, in the axes of its LCS."""
        way = (np.swapaxes(self.planned, -1, -2) @ self.way[..., None])[..., 0]
        return np.concatenate([way, self.turn], axis=1)

    def command(self, share: FloatArray) -> None:
        """Carriages' targets for the reference at `share` (L,) plus the deviation."""
        if self.turns:
            self.planned = self.start @ rotations.exp(share[:, None] * self.turn)
            self.rates = self._rates()
        self.R = self.planned @ rotations.exp(self.deviation[:, 3:, 0])
        moved = (self.planned @ self.deviation[:, :3, :1])[..., 0]
        self.point = self.first + share[:, None] * self.way + moved
        arm = self.hinge @ np.swapaxes(self.R, -1, -2)
        self.target = self.c.servo.command(arm + self.point[:, None, :])

    def sample(self) -> FloatArray:
        """One reading of all sensors, filtered as the controller does."""
        if self.chunk_at >= _CHUNK:
            shape = (_CHUNK, *self.servo.shape[1:])
            draws = np.stack([rng.standard_normal(shape) for rng in self.noise], axis=1)
            self.chunk, self.chunk_at = self.c.sensing.noise * draws, 0
        noise = self.chunk[self.chunk_at]
        self.chunk_at += 1
        clean = self.sensors.read(self.terminal.force)
        reading = (clean.reshape(-1, *noise.shape) + noise).reshape(clean.shape)
        if self.filtered is None:
            self.filtered = reading
        else:
            self.filtered = self.filtered + self.c.sensing.gain * (reading - self.filtered)
        return self.filtered

    def sense(self) -> None:
        """Contact wrench about the centre, tared, and a smoothed copy of it."""
        self.seen = self.observer.wrench(self.sample(), self.R) - self.offset
        self.smooth = self.smooth + self.watch * (self.seen - self.smooth)

    def settle(self) -> None:
        """Stand still, and tare where that is done."""
        count = round(self.c.tare * self.c.sensing.rate)
        if count and self.tared.any():
            total = np.zeros_like(self.offset)
            for _ in range(count):
                total += self.observer.wrench(self.sample(), self.R)
            self.offset = np.where(self.tared, total / count, 0.0)

    def physics(self) -> None:
        """Servos go on, and the terminal with them, under the contact of the middle of the step."""
        self.servo = self.servo + self.share * (self.target - self.servo)
        if self.docking is not None:
            self._touch(self.docking)
        self.terminal.move(self._stand(), self.contact)

    def _touch(self, docking: Docking) -> None:
        """Contact at the place half a step ahead: so held over the step, it does no net work."""
        terminal = self.terminal
        lever = terminal.rotation @ self.tip
        self.q = coordinates(docking.mouth, lever + terminal.translation, terminal.rotation)
        rate = terminal.rate.copy()
        rate[:, :3] += (rotations.hat(rate[:, 3:]) @ lever[..., None])[..., 0]
        local = docking.gears.wrench(self.q + 0.5 * self.c.step * rate, rate)
        was, self.touching = self.touching, bool(local.any())
        if self.touching or was:
            self.contact = local
            self.contact[:, 3:] += moment(lever[:, None, :], local[:, None, :3])

    def run(self) -> Result:
        """Go the whole way."""
        c, L = self.c, self.lanes
        self.settle()
        book = Book(L, c.step)
        active = np.ones(L, dtype=np.bool_)
        at = np.zeros(L)
        every = max(1, round(1.0 / (c.trace_rate * c.step)))
        for k, share in enumerate(self.reference.share):
            sampled = k % self.held == 0
            if sampled:
                self.sense()
            at = np.where(active, share, at)
            # M ẍ_d + B ẋ_d of the reference; B (ẋ − ẋ_d) leaves the second out.
            speed, acceleration = self.reference.rate[k], self.reference.acceleration[k]
            drive = (self.mass * acceleration + self.dragging * speed) * self.rates
            own, driven = self.transition
            new = (own @ self.deviation[..., None])[..., 0] + driven * (self.seen - drive)[
                ..., None
            ]
            self.deviation = np.where(active[:, None, None], new, self.deviation)
            self.command(at)
            self.physics()
            if self.docking is not None:
                self._note(k, book, active, sampled=sampled)
                active = self._going_on(k, book, active)
            if (k + 1) % every == 0 or not active.any():
                self._record(k, book)
            if not active.any():
                break
        return book.result(c.servo.command(self.servo), self.q)

    def _note(self, k: int, book: Book, active: BoolArray, *, sampled: bool) -> None:
        assert self.docking is not None
        if self.q[:, 2].max() > 0.0 or self.touching:
            touching = np.any(self.contact, axis=1)
            book.progress(k, active, self.docking.gears, self.q, touching)
        if self.touching:
            book.contact(active, self._true_contact())
        if sampled:
            book.measured(active, self._about_origin(self.smooth))

    def _going_on(self, k: int, book: Book, active: BoolArray) -> BoolArray:
        """Lanes still under way after the controller looked at its thresholds."""
        assert self.docking is not None
        reached = active & np.any(np.abs(self.smooth[:, :3]) >= self.c.thresholds, axis=1)
        if not reached.any():
            return active
        # The controller knows the depth from its servos and the surveyed place of the bore.
        gone = np.einsum("li,li->l", self.point - self.first, self.way)
        deep = gone / np.linalg.norm(self.way, axis=1) >= self.docking.complete
        book.stop(k, reached, deep)
        return np.asarray(active & ~reached)

    def _about_origin(self, wrench: FloatArray) -> FloatArray:
        """Moments about the LCS origin instead of the centre; both LCS."""
        return np.asarray(wrench @ self.shift)

    def _true_contact(self) -> FloatArray:
        """Contact wrench (L, 6) on the terminal, LCS, about its origin."""
        both = self.contact.reshape(-1, 2, 3) @ self.terminal.rotation
        return np.asarray(both.reshape(-1, 6))

    def _record(self, k: int, book: Book) -> None:
        seen = self._about_origin(self.smooth)
        book.record(k, self._true_contact(), seen, self.deviation[..., 0])
