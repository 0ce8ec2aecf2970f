"""Small machines under control."""

from dataclasses import replace

import numpy as np

from studies.control.contact import GearPair
from studies.control.loop import simulate
from studies.control.machine import PositionErrors, Sensing, Servo, draw_errors
from studies.control.reference import advance
from studies.control.runs import Controller, Docking, Machines, Result
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import Options, Pose, Truth, draw_truths
from tests.simulation.rigs import exact_rig, loose_rig

HOME = np.array([0.05, -0.03, 1.2])
SHORT = GearPair(length=0.0025, chamfer=1.0e-3)
GAP = 5.0e-4
IDEAL = Controller(
    servo=Servo(resolution=0.0),
    sensing=Sensing(noise=0.0),
    tare=0.1,
    trace_rate=250.0,
)


def truths(lanes: int, *, loose: bool = True, seed: int = 0) -> Truth:
    rig = loose_rig() if loose else exact_rig()
    return draw_truths(rig, Options(), np.random.default_rng(seed), lanes)


def poses(lanes: int, shift: FloatArray | None = None, turn: FloatArray | None = None) -> Pose:
    R = np.eye(3) if turn is None else turn
    T = HOME + (np.zeros(3) if shift is None else shift)
    return Pose(
        np.array(np.broadcast_to(R, (lanes, 3, 3))), np.array(np.broadcast_to(T, (lanes, 3)))
    )


def fleet(
    truth: Truth,
    assumed: Truth | None = None,
    *,
    rig: Rig | None = None,
    errors: PositionErrors | None = None,
    tared: bool = True,
    noise: int = 0,
) -> Machines:
    """One machine per lane, each with noise of its own; controllers that know the truth."""
    lanes, n = truth.zero.shape[:2]
    exact = draw_errors(Servo(), 0.0, lanes, n, np.random.default_rng(0))
    return Machines(
        rig or loose_rig(), truth, errors or exact, assumed or truth,
        np.full(lanes, tared), tuple(np.random.SeedSequence(noise).spawn(lanes)),
    )  # fmt: skip


def dock(
    truth: Truth,
    controller: Controller,
    *,
    gears: GearPair = SHORT,
    shift: tuple[float, float] = (0.0, 0.0),
    assumed: Truth | None = None,
    repeat: float = 0.0,
    noise: int = 0,
    beyond: float = 0.01,
) -> Result:
    """Dock all lanes, the plan `shift` (m) beside the bore."""
    lanes = len(truth.mass)
    # The impedance lags by B v / K behind its reference.
    lag = 1.5e-3 * controller.impedance.damping[2] / controller.impedance.stiffness[2]
    way = GAP + gears.length + beyond + lag
    start = poses(lanes, np.array([*shift, 0.0]))
    reference = advance(
        start,
        replace(start, translation=start.translation + np.array([0.0, 0.0, way])),
        way=way,
        speed=1.5e-3,
        ramp=0.5,
        step=controller.step,
    )
    mouth = HOME + np.array([0.0, 0.0, gears.tip[2] + GAP])
    rig = loose_rig()
    errors = draw_errors(controller.servo, repeat, lanes, rig.n, np.random.default_rng(7))
    machines = fleet(truth, assumed, errors=errors, noise=noise)
    docking = Docking(gears, mouth, GAP + gears.length - 5.0e-4)
    return simulate(machines, controller, reference, docking)
