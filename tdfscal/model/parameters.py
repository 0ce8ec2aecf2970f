"""The parameters of the measurement model: their order, their priors, how a state is moved.

Everything that is not a rotation is a parameter with a prior: standard deviation 0 is known
exactly, ∞ unknown (theory, section 3). Rotations are perturbed on the left, in the BCS.

Shapes: n supports, G functions by which zeros move (`zero_motion`), P = 18 n + 9 + 3 n G
parameters. State arrays may carry leading batch axes.
"""

from __future__ import annotations

from dataclasses import fields
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray, Rig

if TYPE_CHECKING:
    from tdfscal.model.postures import ZeroMotion

_VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Unit symmetric matrices, (6, 3, 3).
SYMMETRIC = np.zeros((6, 3, 3))
for _j, (_a, _b) in enumerate(_VOIGT):
    SYMMETRIC[_j, _a, _b] = SYMMETRIC[_j, _b, _a] = 1.0


#: Standard deviation of a turn spread evenly over the circle, rad: nothing is known of it.
EVEN_TURN = np.pi / np.sqrt(3)
#: Groups of the terminal: one realisation in all campaigns whose rig files state it alike.
LOAD = ("mass", "barycentre")
#: Groups that are constants of the rig: one realisation in every campaign. The others (zeros) are
#: each campaign's own.
CONSTANTS = ("rotation", "sensitivity", *LOAD, "hinge", "datum", "tilt", "compliance")


@record
class State:
    """A value of every parameter; the order of the fields is the order in the parameter vector.

    rotation : (..., n, 3, 3), X_i, sensor frame → BCS. zero : (..., n, 3), N, sensor frames.
    sensitivity : (..., n, 6), S_i as xx, yy, zz, yz, xz, xy. mass : (...,), kg.
    barycentre : (..., 3), m, LCS. hinge : (..., n, 3), m, LCS.
    datum : (..., n, 3), m, BCS; servo coordinates minus hinge centre.
    tilt : (..., 2), rad, rotation of the gravity direction about the BCS's x and y axes.
    compliance : (..., 2), m/N, sideways and along Z of the BCS, between encoder and hinge.
    friction : (...,), N·m, of each hinge, against the turn by which a posture was reached.
    drift : (..., G, n, 3), amplitudes of the functions by which zeros move, sensor frames.
    """

    rotation: FloatArray
    zero: FloatArray
    sensitivity: FloatArray
    mass: FloatArray
    barycentre: FloatArray
    hinge: FloatArray
    datum: FloatArray
    tilt: FloatArray
    compliance: FloatArray
    friction: FloatArray
    drift: FloatArray

    @property
    def n(self) -> int:
        """Number of supports."""
        return int(self.rotation.shape[-3])

    @property
    def motions(self) -> int:
        """Number of functions by which zeros move, G."""
        return int(self.drift.shape[-3])


def _shapes(n: int, motions: int) -> dict[str, tuple[int, ...]]:
    """Shape of each field of a state without batch axes; the rotations' as steps."""
    return {
        "rotation": (n, 3),
        "zero": (n, 3),
        "sensitivity": (n, 6),
        "mass": (),
        "barycentre": (3,),
        "hinge": (n, 3),
        "datum": (n, 3),
        "tilt": (2,),
        "compliance": (2,),
        "friction": (),
        "drift": (motions, n, 3),
    }


def layout(n: int, motions: int = 0) -> dict[str, slice]:
    """Place of each parameter group in the parameter vector (P,); motions : G."""
    place, start = {}, 0
    for name, shape in _shapes(n, motions).items():
        place[name] = slice(start, start + prod(shape))
        start = place[name].stop
    return place


def constants(n: int, motions: int = 0) -> BoolArray:
    """Which parameters (P,) are constants of the rig."""
    place = layout(n, motions)
    mask = np.zeros(place["drift"].stop, dtype=np.bool_)
    for group in CONSTANTS:
        mask[place[group]] = True
    return mask


def furthest(n: int) -> FloatArray:
    """How far off (P,) at most each parameter is of which nothing is known, SI.

    A rotation half a turn, by its spread over the circle; zeros and a load by more than any; others
    one unit.
    """
    place, out = layout(n), np.ones(parameter_count(n))
    out[place["rotation"]], out[place["mass"]], out[place["barycentre"]] = EVEN_TURN, 1e5, 1e2
    out[place["zero"]] = 1e5
    return out


def parameter_count(n: int, motions: int = 0) -> int:
    """P for n supports and G functions by which zeros move."""
    return int(layout(n, motions)["drift"].stop)


def with_motions(state: State, motions: int) -> State:
    """Return the state with G amplitudes per channel; zeros that did not move yet stay."""
    if state.motions == motions:
        return state
    return replace(state, drift=np.zeros((motions, state.n, 3)))


def retract(state: State, step: FloatArray) -> State:
    """Move the state by step (..., P): rotations by exp([δ]×) on the left, the rest by addition."""
    n, motions = state.n, state.motions
    place, batch = layout(n, motions), step.shape[:-1]
    moved = {}
    for name, shape in _shapes(n, motions).items():
        value: FloatArray = getattr(state, name)
        part = step[..., place[name]].reshape(batch + shape)
        moved[name] = so3.exp(part) @ value if name == "rotation" else value + part
    return State(**moved)


def placed(state: State, std: FloatArray) -> State:
    """Standard uncertainties (P,) in the places of the parameters they are of; no rotations."""
    empty = State(**{f.name: np.zeros_like(getattr(state, f.name)) for f in fields(State)})
    step = np.zeros(layout(state.n, state.motions)["drift"].stop)
    step[3 * state.n : len(std)] = std[3 * state.n :]  # zeros that move are not always among them
    return retract(empty, step)


def vector(state: State) -> FloatArray:
    """Parameters (P,) of a state without batch axes; the rotations' entries are 0."""
    names = list(_shapes(state.n, state.motions))
    parts = [np.zeros(3 * state.n), *(getattr(state, name) for name in names[1:])]
    return np.concatenate([np.ravel(part) for part in parts])


def deviation(state: State, reference: State) -> FloatArray:
    """State minus reference as a parameter vector (P,); rotations as log(X X_refᵀ), BCS."""
    step = vector(state) - vector(reference)
    turn = so3.log(state.rotation @ np.swapaxes(reference.rotation, -1, -2))
    step[: 3 * state.n] = turn.ravel()
    return step


def nominal(rig: Rig, motions: int = 0) -> State:
    """Return the state that the rig file states: nominal mounting, prior values; motions : G."""
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
        compliance=np.zeros(2),
        friction=np.zeros(()),
        drift=np.zeros((motions, n, 3)),
    )


def starting_state(rig: Rig, motions: int = 0) -> State:
    """Return what is known before the postures: the constants by earlier campaigns, if any."""
    state = nominal(rig)
    if rig.earlier is not None:
        known = np.where(rig.earlier.places, rig.earlier.vector - vector(state), 0.0)
        state = replace(retract(state, known), rotation=rig.earlier.rotation)
    return with_motions(state, motions)


def prior_std(rig: Rig, motion: ZeroMotion | None = None) -> FloatArray:
    """Standard deviation of each parameter's own prior (P,): 0 exactly known, ∞ none.

    motion : of the zeros over the postures. The rotations' own prior is a prior on roll, pitch
    and yaw; it does not stand here. What a sensor does not measure has no zero to be estimated.
    Where earlier campaigns speak for the constants, those have no prior of their own.
    """
    motions = 0 if motion is None else len(motion.std)
    n, declared, place = rig.n, rig.declared, layout(rig.n, motions)
    s = declared.force_sensitivity
    std = np.empty(place["drift"].stop)
    std[place["rotation"]] = np.inf
    std[place["zero"]] = np.where(rig.axes, rig.zero.std, 0.0).ravel()
    # S = (E + Eᵀ)/2 with independent entries of E: s on the diagonal, s/√2 beside it.
    std[place["sensitivity"]] = np.tile(s * np.array([1, 1, 1, *[np.sqrt(0.5)] * 3]), n)
    std[place["mass"]] = rig.mass.std
    std[place["barycentre"]] = rig.barycentre.std
    std[place["hinge"]] = declared.hinge
    std[place["datum"]] = declared.datum
    std[place["tilt"]] = rig.gravity_tilt_std
    std[place["compliance"]] = declared.compliance_lateral, declared.compliance_vertical
    # A moment along the turn, as long as independent moments of `hinge_moment` per axis are.
    std[place["friction"]] = np.sqrt(3.0) / n * declared.hinge_moment
    if motion is not None:
        std[place["drift"]] = np.where(rig.axes, motion.std[:, None, None], 0.0).ravel()
    if rig.earlier is not None:
        std[np.flatnonzero(rig.earlier.places)] = np.inf
    return std


def rpy_prior_std(rig: Rig) -> FloatArray:
    """Standard deviation (n, 3), rad, of the prior on roll, pitch, yaw; ∞ none.

    A sensor that lacks axes may have turns that no posture shows, down to rounding. It gets a
    turn spread evenly over the circle, which outweighs nothing that is measured.
    """
    lacking = np.repeat(~np.all(rig.axes, axis=1, keepdims=True), 3, axis=1)
    return np.where(lacking & np.isinf(rig.rpy_std), EVEN_TURN, rig.rpy_std)


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
