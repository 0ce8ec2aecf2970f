"""The contact wrench against closed forms and the simulator's truth."""

from dataclasses import replace

import numpy as np

from tdfscal.model.calibrated import independent
from tdfscal.model.parameters import gravity
from tdfscal.model.postures import register
from tdfscal.model.samples_in_motion import Tally, aligned
from tdfscal.records import UncertainValue
from tdfscal.wrench.contact_wrench import at_rest, covariance, in_motion, wrenches
from tests.motioncal.campaigns import perfect_rig, played, quiet, true_state

from .held_out import HELD, RIG, world


def test_wrench_is_newtons_law_written_out() -> None:
    """Readings by which a gain and crosstalk went, too, which are undone before the rotation."""
    given, dwells = world(1).given[0], world(1).held(0)
    voigt = np.array([[0.01, -0.02, 0.015, 0.003, -0.004, 0.005]] * 3)
    given = replace(given, state=replace(given.state, sensitivity=voigt))
    xx, yy, zz, yz, xz, xy = voigt[0]
    gain = np.eye(3) + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    s = given.state
    found = wrenches(given, dwells.start, dwells.position, dwells.force).value
    R, _ = register(s.hinge, dwells.position - s.datum)
    G = float(s.mass) * gravity(s, RIG.gravity)
    for k in range(HELD):
        load = np.linalg.solve(gain, (dwells.force[k] - s.zero).T).T
        L = [R[k].T @ s.rotation[i] @ load[i] for i in range(3)]
        weight = R[k].T @ G
        force = -np.sum(L, axis=0) - weight
        moment = -sum(np.cross(s.hinge[i], L[i]) for i in range(3)) - np.cross(s.barycentre, weight)
        # Poses are good to 1e-10 rad, and 5 kN turn with them.
        assert np.abs(found[k] - [*force, *moment]).max() < 5e-7


def test_open_zeros_leave_the_uncertainty_open() -> None:
    given, dwells = world(100).given[0], world(100).held(0)
    unknown = np.zeros_like(given.open)
    unknown[9:12] = True
    cov = covariance(replace(given, open=unknown), dwells.position, dwells.force)
    assert np.all(np.isinf(np.diagonal(cov, axis1=1, axis2=2)[:, :3]))


def test_in_motion_no_contact_is_left_of_what_the_mass_needs() -> None:
    """A terminal that swings, all of it known: taken as at rest it is touched by newtons."""
    options = quiet(duration=20.0, frequency=0.25, friction=0.0, delay=0.0)
    campaign, *_ = played(options, rig=perfect_rig())
    rig = replace(campaign.rig, inertia=UncertainValue.exact(campaign.inertia))
    given = replace(
        independent(rig, campaign.truth.rotation, 1e-12 * np.eye(9)),
        state=true_state(campaign).still,
    )
    rms = []
    for stage in (at_rest, in_motion):
        pieces = list(stage(given, aligned([campaign.log], Tally())))
        value = np.concatenate([piece.value for piece in pieces])
        rms.append(np.sqrt(np.mean(value[200:-200] ** 2, axis=0)))
    assert (rms[0] > [20.0, 20.0, 20.0, 5.0, 5.0, 5.0]).all()
    assert (rms[1] < 0.01 * rms[0]).all()
