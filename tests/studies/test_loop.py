"""The closed loop against closed forms and the static simulator."""

import numpy as np

from studies.control.machine import Impedance, transition
from studies.control.reference import Reference
from studies.control.terminal import Terminal, inertia_of
from tdfscal.simulation import Load, Pose, rotations, settle
from tests.simulation.rigs import loose_rig
from tests.studies.benches import HOME, poses, truths


def still(seconds: float, lanes: int, step: float) -> Reference:
    zero = np.zeros(round(seconds / step))
    return Reference(poses(lanes), poses(lanes), zero, zero, zero)


def test_transition_is_exact() -> None:
    """Against the oscillator's closed form, over- and underdamped."""
    impedance = Impedance(damping=(3e4, 100.0, 2 * np.sqrt(500 * 1e4), 2400.0, 2400.0, 2400.0))
    t = 0.03
    state, drive = transition(impedance, t)
    M, B, K = (np.array(v)[:2] for v in (impedance.mass, impedance.damping, impedance.stiffness))
    root = np.sqrt(((B / M) ** 2 - 4 * K / M).astype(complex))
    a, b = (-B / M + root) / 2, (-B / M - root) / 2
    to_rest = (a * np.exp(b * t) - b * np.exp(a * t)) / (a - b)
    np.testing.assert_allclose(state[:2, 0, 0], to_rest.real, rtol=1e-12)
    np.testing.assert_allclose(drive[:2, 0], ((1 - to_rest) / K).real, rtol=1e-9)
    # The same from many small steps, also at critical damping.
    fine, push = transition(impedance, t / 64)
    d = np.tile([1.0, 0.2], (6, 1))
    whole = (state @ d[..., None])[..., 0] + drive
    for _ in range(64):
        d = (fine @ d[..., None])[..., 0] + push
    np.testing.assert_allclose(d, whole, rtol=1e-10)


def test_rest_is_the_static_simulators() -> None:
    """Carriages wander and a contact pushes: the terminal ends where `settle` puts it."""
    lanes, rng = 4, np.random.default_rng(1)
    truth = truths(lanes)
    start = poses(lanes)
    stand = start.place(truth.hinge)
    inertia = np.broadcast_to(inertia_of(loose_rig()), (lanes, 3, 3))
    terminal = Terminal(truth, inertia, 0.05, stand, start, 4e-3)
    goal = Pose(
        rotations.exp(rng.normal(0, 0.02, (lanes, 3))), HOME + rng.normal(0, 0.01, (lanes, 3))
    ).place(truth.hinge) + rng.normal(0, 1e-5, stand.shape)
    wrench = np.concatenate([rng.normal(0, 20, (lanes, 3)), rng.normal(0, 5, (lanes, 3))], axis=1)
    for share in np.linspace(0.0, 1.0, 400):
        terminal.move(stand + share * (goal - stand), share * wrench)
    for _ in range(800):
        terminal.move(goal, wrench)
    R = terminal.rotation
    lcs = (wrench.reshape(lanes, 2, 3) @ R)[:, None]
    rest = settle(
        truth,
        goal[:, None],
        Load(lcs, np.zeros((lanes, 1, 3))),
        Pose(start.rotation[:, None], start.translation[:, None]),
    )
    np.testing.assert_allclose(terminal.force, rest.force[:, 0], atol=1e-4)
    np.testing.assert_allclose(terminal.translation, rest.pose.translation[:, 0], atol=1e-11)
    np.testing.assert_allclose(R, rest.pose.rotation[:, 0], atol=1e-11)
