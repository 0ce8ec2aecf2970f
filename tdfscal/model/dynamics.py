"""The measurement model in motion: what Newton and Euler add to the balance at rest.

With the fixed point c of the terminal near its barycentre, a its acceleration, ρ_m = R (r_m − c)
and I_c the inertia about c (theory, section 8; the paper's Eq. 4 about another point):

    e_F += − m a − m R̈ (r_m − c)                                          N
    e_M += − m ρ_m × a − d/dt (R I_c Rᵀ ω) − τ n ω/|ω|                       N·m

Linear in the features (m, m (r_m − c), entries of I_c, τ); the delay d + ρ t of the force stamps
(ρ : the rate at which two clocks run apart, t : from the middle of the log) moves the positions
against the forces and enters by its derivatives. Inertia is a parameter about the
LCS origin, as drawings give it: I_c = I_O − m S(r_m) + m S(r_m − c), S(r) = |r|² 1 − r rᵀ.
"""

from __future__ import annotations

import numpy as np

from tdfscal.frozen import record
from tdfscal.model.parameters import SYMMETRIC, State, layout
from tdfscal.records import FloatArray, Rig

#: Features that motion adds: m, m (r_m − c), I_c (xx, yy, zz, yz, xz, xy), τ, d, ρ.
FEATURES = 13
#: Parameters that motion adds: I_O (6), τ, d, ρ.
PARAMETERS = 9
INERTIA, FRICTION, DELAY, RATE = slice(0, 6), 6, 7, 8

#: Standard deviation of a delay of which nothing is stated, s: recorders lag by milliseconds.
UNSTATED_DELAY = 0.1
#: Relative rate at which two clocks of one log run apart, standard deviation: uncompensated quartz
#: oscillators hold 20 to 50 ppm.
CLOCK_RATE = 3.0e-5
#: Lever of the friction of which nothing is stated, m: a ball of 20 mm radius with μ = 0.25.
UNSTATED_FRICTION_LEVER = 5.0e-3
#: Unstated inertia: 0 ± this many times m L², L the hinges' root mean square distance.
_INERTIA_SHARE = 3.0


@record
class Moving:
    """Parameters of the motion.

    inertia : (6,), kg m² about the LCS origin, as xx, yy, zz, yz, xz, xy. friction : N·m, of
    each hinge. delay : s, force stamps minus position stamps, in the middle of the log.
    rate : how fast that grows with time.
    """

    inertia: FloatArray
    friction: float
    delay: float
    rate: float = 0.0

    @property
    def vector(self) -> FloatArray:
        """Parameters (9,)."""
        return np.array([*self.inertia, self.friction, self.delay, self.rate])

    def lag(self, after: FloatArray) -> FloatArray:
        """Delay (N,), s, at times `after` the middle of the log (N,), s."""
        return np.asarray(self.delay + self.rate * after)

    @classmethod
    def of(cls, vector: FloatArray) -> Moving:
        """Parameters from their vector (9,)."""
        return cls(vector[INERTIA], *map(float, vector[FRICTION:]))


def voigt(matrix: FloatArray) -> FloatArray:
    """Entries (6,) xx, yy, zz, yz, xz, xy of a symmetric matrix (3, 3)."""
    return np.asarray(matrix[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]])


def spread_matrix(r: FloatArray) -> FloatArray:
    """S(r) = |r|² 1 − r rᵀ as entries (6,): inertia of a unit mass at r (3,)."""
    return voigt(r @ r * np.eye(3) - np.outer(r, r))


def prior(
    rig: Rig, delay_value: float, delay_std: float, rate_std: float = CLOCK_RATE
) -> tuple[Moving, FloatArray]:
    """Prior value and standard deviation (9,) of the motion's parameters.

    What the rig file leaves open gets a prior far wider than any machine, which keeps the
    iteration within physics where a motion tells nothing: a short log must not answer with an
    inertia of tons or a delay of minutes. A delay that is known exactly is one of a single clock.
    """
    size = float(rig.mass.value) * float(np.mean(np.sum(rig.hinge**2, axis=1)))
    value, std = np.zeros(PARAMETERS), np.empty(PARAMETERS)
    std[INERTIA] = _INERTIA_SHARE * size
    if rig.inertia is not None:
        stated = voigt(rig.inertia.std)
        value[INERTIA] = voigt(rig.inertia.value)
        std[INERTIA] = np.where(np.isfinite(stated), stated, _INERTIA_SHARE * size)
    std[FRICTION] = UNSTATED_FRICTION_LEVER * float(rig.mass.value) * rig.gravity / rig.n
    value[DELAY] = delay_value
    std[DELAY] = delay_std if np.isfinite(delay_std) else UNSTATED_DELAY
    std[RATE] = rate_std if delay_std > 0 else 0.0
    return Moving.of(value), std


def features(state: State, moving: Moving, centre: FloatArray, shift: Moving) -> FloatArray:
    """Features (13,) of a state; delay and rate count from those that the poses are shifted by."""
    m, lever = float(state.mass), state.barycentre - centre
    own = moving.inertia - m * spread_matrix(state.barycentre) + m * spread_matrix(lever)
    clock = moving.delay - shift.delay, moving.rate - shift.rate
    return np.array([m, *(m * lever), *own, moving.friction, *clock])


def features_jacobian(state: State, centre: FloatArray) -> FloatArray:
    """∂ features / ∂(static parameters, motion's parameters), (13, P + 9)."""
    place = layout(state.n, state.motions)
    P = place["drift"].stop
    jac = np.zeros((FEATURES, P + PARAMETERS))
    m, r = float(state.mass), state.barycentre
    lever = r - centre
    mass = place["mass"].start
    bary = place["barycentre"]
    jac[0, mass] = 1.0
    jac[1:4, mass], jac[1:4, bary] = lever, m * np.eye(3)
    jac[4:10, mass] = spread_matrix(lever) - spread_matrix(r)
    # S(r) is quadratic: the difference S(r − c) − S(r) changes by −(2 c·dr 1 − c drᵀ − dr cᵀ).
    for a, axis in enumerate(np.eye(3)):
        change = 2 * centre[a] * np.eye(3) - np.outer(centre, axis) - np.outer(axis, centre)
        jac[4:10, bary.start + a] = -m * voigt(change)
    jac[4:, P:] = np.eye(PARAMETERS)
    return jac


def spin_momentum(rotation: FloatArray, turning: FloatArray) -> FloatArray:
    """R E_j Rᵀ ω for the unit inertias E_j, (N, 3, 6), BCS; rotation (N, 3, 3), ω (N, 3) BCS."""
    in_lcs = np.einsum("kba,kb->ka", rotation, turning)
    columns = np.einsum("jab,kb->kaj", SYMMETRIC, in_lcs)
    return np.asarray(rotation @ columns)
