"""Is the loop stable that the sensors close: impedance, servos, inertia, structure, contact?

One sample of the linearised loop as a matrix, in the order of `loop`: the sensors feel contact and
inertia, m·a; the impedance answers with a displacement, the servos follow, the body swings on its
NCPs, and that is felt again. Its largest eigenvalue is what an oscillation grows by per sample.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from studies.control.contact import GearPair
from studies.control.machine import transition
from studies.control.runs import Controller
from studies.control.terminal import Body, body, inertia_of, stated
from tdfscal.errors import UsageError
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import rotations

#: Factor by which a contact may be stiffer than stated before a designed loop shakes: 6 dB.
GAIN_MARGIN = 2.0
#: Damping of turns over that of translations, m²: the squared radius of the hinges, about.
_TURNS = 0.3
_BLOCK = 6


def nominal_body(rig: Rig, controller: Controller) -> Body:
    """The rig as its file states it, aligned with the BCS; matrices (6, 6)."""
    one = body(stated(rig, 1), inertia_of(rig)[None], controller.damping, np.eye(3)[None])
    return Body(one.mass[0], one.stiffness[0], one.decay[0])


def sample_map(at: Body, controller: Controller, surroundings: FloatArray) -> FloatArray:
    """State of the loop (42, 42) a sample later: q, q̇ of the body, servos s, ṡ, deviation d, ḋ and
    filtered wrench. surroundings : (6, 6), stiffness of the contact about the LCS origin.
    """
    c, h = controller, controller.step
    (state, drive), grow = transition(c.impedance, h), at.step(h)
    T = np.eye(_BLOCK)  # displacement of the LCS origin by that of the centre of compliance
    T[:3, 3:] = rotations.hat(np.asarray(c.impedance.centre))
    share = c.servo.share(h)
    q, v, s, speed, d, rate, felt = np.eye(7 * _BLOCK).reshape(7, _BLOCK, 7 * _BLOCK)

    def pull(speed: FloatArray) -> FloatArray:
        return np.asarray(-at.stiffness @ (q - s + at.decay * (v - speed)))

    felt = felt + c.sensing.gain * (-T.T @ pull(speed) - felt)
    for _ in range(c.held):
        moved = np.stack([d, rate], axis=1)  # (6, 2, ·)
        d, rate = np.swapaxes(state @ moved + drive[:, :, None] * felt[:, None], 0, 1)
        speed = share * (T @ d - s) / h
        net = pull(speed) - surroundings @ (q + 0.5 * h * v)
        change = grow @ np.concatenate([v, net, at.stiffness @ speed])
        q, v, s = q + change[:_BLOCK], v + change[_BLOCK:], s + h * speed
    return np.concatenate([q, v, s, speed, d, rate, felt])


def growth(at: Body, controller: Controller, surroundings: FloatArray) -> float:
    """Largest factor by which an oscillation changes per sample; below 1 it dies out."""
    return float(np.abs(np.linalg.eigvals(sample_map(at, controller, surroundings))).max())


def real_mass(rig: Rig, controller: Controller) -> tuple[float, ...]:
    """Mass (3), kg, and mean moment of inertia (3), kg m², of the terminal about the centre of
    compliance.
    """
    m, r = float(rig.mass.value), rig.barycentre.value
    off = np.asarray(controller.impedance.centre) - r
    trace = float(np.trace(inertia_of(rig))) + 2.0 * m * float(off @ off - r @ r)
    return (m,) * 3 + (trace / 3.0,) * 3


def designed(rig: Rig, controller: Controller, gears: GearPair) -> Controller:
    """Find the least damping, critical or more, that is stable, free and in a contact up to
    `GAIN_MARGIN` times as stiff as the gears', at the step and at half of it.

    Raises UsageError where no damping is.
    """
    impedance = controller.impedance
    at = nominal_body(rig, controller)
    critical = 2.0 * np.sqrt(impedance.mass[0] * impedance.stiffness[0])
    for b in critical * np.geomspace(1.0, 300.0, 41):
        damping = float(f"{b:.1e}")
        value = (damping,) * 3 + (_TURNS * damping,) * 3
        one = replace(controller, impedance=replace(impedance, damping=value))
        halved = replace(one, step=0.5 * one.step)
        cases = ((c, k) for c in (one, halved) for k in (0.0, 0.5, 1.0, GAIN_MARGIN))
        if all(growth(at, c, k * gears.stiffest) < 1.0 for c, k in cases):
            return one
    raise UsageError(
        f"no damping makes a loop with a virtual mass of {impedance.mass[0]:g} kg on "
        f"{float(rig.mass.value):g} kg stable",
        hint="filter more, raise the virtual mass, or make servos faster",
    )
