"""The parameters of the measurement model: their order, their priors, how a state is moved.

Everything that is not a rotation is a parameter with a prior: standard deviation 0 is known
exactly, ∞ unknown (theory, section 3). Rotations are perturbed on the left, in the BCS.

Shapes: n supports, P = 18 n + 6 parameters. State arrays may carry leading batch axes.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray, Rig

_VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Unit symmetric matrices, (6, 3, 3).
SYMMETRIC = np.zeros((6, 3, 3))
for _j, (_a, _b) in enumerate(_VOIGT):
    SYMMETRIC[_j, _a, _b] = SYMMETRIC[_j, _b, _a] = 1.0


#: Groups that are constants of the rig: one realisation in every campaign. The others (zeros,
#: load) are each campaign's own.
CONSTANTS = ("rotation", "sensitivity", "hinge", "datum", "tilt")


@dataclass(frozen=True, slots=True)
class State:
    """A value of every parameter; the order of the fields is the order in the parameter vector.

    rotation : (..., n, 3, 3), X_i, sensor frame → BCS. zero : (..., n, 3), N, sensor frames.
    sensitivity : (..., n, 6), S_i as xx, yy, zz, yz, xz, xy. mass : (...,), kg.
    barycentre : (..., 3), m, LCS. hinge : (..., n, 3), m, LCS.
    datum : (..., n, 3), m, BCS; servo coordinates minus hinge centre.
    tilt : (..., 2), rad, rotation of the gravity direction about the BCS's x and y axes.
    """

    rotation: FloatArray
    zero: FloatArray
    sensitivity: FloatArray
    mass: FloatArray
    barycentre: FloatArray
    hinge: FloatArray
    datum: FloatArray
    tilt: FloatArray

    @property
    def n(self) -> int:
        """Number of supports."""
        return int(self.rotation.shape[-3])


def layout(n: int) -> dict[str, slice]:
    """Place of each parameter group in the parameter vector (P,)."""
    sizes = {
        "rotation": 3 * n,
        "zero": 3 * n,
        "sensitivity": 6 * n,
        "mass": 1,
        "barycentre": 3,
        "hinge": 3 * n,
        "datum": 3 * n,
        "tilt": 2,
    }
    place, start = {}, 0
    for name, size in sizes.items():
        place[name] = slice(start, start + size)
        start += size
    return place


def constants(n: int) -> BoolArray:
    """Which parameters (P,) are constants of the rig."""
    place = layout(n)
    mask = np.zeros(place["tilt"].stop, dtype=np.bool_)
    for group in CONSTANTS:
        mask[place[group]] = True
    return mask


def retract(state: State, step: FloatArray) -> State:
    """Move the state by step (..., P): rotations by exp([δ]×) on the left, the rest by addition."""
    place, batch = layout(state.n), step.shape[:-1]
    moved = {}
    for field in fields(State):
        value: FloatArray = getattr(state, field.name)
        part = step[..., place[field.name]]
        if field.name == "rotation":
            moved[field.name] = so3.exp(part.reshape(*batch, state.n, 3)) @ value
        else:
            shape = {"mass": (), "barycentre": (3,), "tilt": (2,), "sensitivity": (state.n, 6)}
            moved[field.name] = value + part.reshape(batch + shape.get(field.name, (state.n, 3)))
    return State(**moved)


def vector(state: State) -> FloatArray:
    """Parameters (P,) of a state without batch axes; the rotations' entries are 0."""
    parts = [np.zeros(3 * state.n), state.zero, state.sensitivity, state.mass, state.barycentre]
    return np.concatenate([np.ravel(p) for p in [*parts, state.hinge, state.datum, state.tilt]])


def deviation(state: State, reference: State) -> FloatArray:
    """State minus reference as a parameter vector (P,); rotations as log(X X_refᵀ), BCS."""
    step = vector(state) - vector(reference)
    turn = so3.log(state.rotation @ np.swapaxes(reference.rotation, -1, -2))
    step[: 3 * state.n] = turn.ravel()
    return step


def nominal(rig: Rig) -> State:
    """Return the state that the rig file states: nominal mounting, prior values."""
    n = rig.n
    return State(
        rotation=so3.from_rpy(rig.nominal_rpy),
        zero=rig.zero.value,
        sensitivity=np.zeros((n, 6)),
        mass=rig.mass.value,
        barycentre=rig.barycentre.value,
        hinge=rig.hinge,
        datum=np.zeros((n, 3)),
        tilt=np.zeros(2),
    )


def starting_state(rig: Rig) -> State:
    """Return what is known before the postures: the constants by earlier campaigns, if any."""
    state = nominal(rig)
    if rig.earlier is None:
        return state
    known = np.where(constants(rig.n), rig.earlier.vector - vector(state), 0.0)
    known[: 3 * rig.n] = 0.0
    return replace(retract(state, known), rotation=rig.earlier.rotation)


def prior_std(rig: Rig) -> FloatArray:
    """Standard deviation of each parameter's own prior (P,): 0 exactly known, ∞ none.

    The rotations' own prior is a prior on roll, pitch and yaw; it does not stand here. Where
    earlier campaigns speak for the constants, those have no prior of their own.
    """
    n, declared, place = rig.n, rig.declared, layout(rig.n)
    s = declared.force_sensitivity
    std = np.empty(place["tilt"].stop)
    std[place["rotation"]] = np.inf
    std[place["zero"]] = rig.zero.std.ravel()
    # S = (E + Eᵀ)/2 with independent entries of E: s on the diagonal, s/√2 beside it.
    std[place["sensitivity"]] = np.tile(s * np.array([1, 1, 1, *[np.sqrt(0.5)] * 3]), n)
    std[place["mass"]] = rig.mass.std
    std[place["barycentre"]] = rig.barycentre.std
    std[place["hinge"]] = declared.hinge
    std[place["datum"]] = declared.datum
    std[place["tilt"]] = rig.gravity_tilt_std
    if rig.earlier is not None:
        std[constants(n) & (std > 0)] = np.inf
    return std


def symmetric(voigt: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 3, 3) of (..., 6) as xx, yy, zz, yz, xz, xy."""
    return np.asarray(np.tensordot(voigt, SYMMETRIC, axes=1))


def gravity(state: State, g: float) -> FloatArray:
    """Gravity (..., 3), m/s², BCS: −Z turned by the tilt."""
    turn = np.zeros((*state.tilt.shape[:-1], 3), dtype=state.tilt.dtype)
    turn[..., :2] = state.tilt
    return np.asarray(-g * so3.exp(turn)[..., :, 2])


def unmixing(voigt: FloatArray) -> FloatArray:
    """(I + S)⁻¹ (..., 3, 3) of S (..., 6)."""
    return np.asarray(np.linalg.inv(np.eye(3) + symmetric(voigt)), dtype=voigt.dtype)


def sensing(state: State) -> FloatArray:
    """M_i = X_i (I + S_i)⁻¹, shape (..., n, 3, 3)."""
    return np.asarray(state.rotation @ unmixing(state.sensitivity))
