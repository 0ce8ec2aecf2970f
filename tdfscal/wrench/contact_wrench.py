"""A calibration at work: the contact wrench in the LCS, and how well it is known (theory, 7).

With F_i = X_i (I + S_i)⁻¹ (f_i − z_i) in the BCS and G = m g:

    f_e = m a_m − Rᵀ Σ F_i − Rᵀ G
    M_e = I_O ω̇ + ω × I_O ω + m r_m × a_O − Σ r_i × Rᵀ F_i − r_m × Rᵀ G

It is what the surroundings exert on the terminal; force in N, moment about the LCS origin in N·m,
components in the LCS. At rest the terms in ω and a vanish.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from tdfscal.frozen import record
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import State, gravity, layout, nominal, sensing
from tdfscal.model.postures import Postures, alike
from tdfscal.model.samples_in_motion import Motion, Samples, motion, poses, rotations
from tdfscal.model.statics import Balance, balance, features_jacobian, free, to_origin
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")

#: Samples that share one standard uncertainty at most, and the time they span at most, s.
_BLOCK = 512
_SPAN = 0.25
#: Half the window in which a local cubic gives velocity and acceleration, s.
WINDOW = 0.1
_LEAST = 2
#: A step this many times the usual one ends a stretch of even sampling.
_UNEVEN = 3.0
#: Share of a variance below which an open parameter does not matter.
_ROUNDING = 1.0e-9
#: Share of an unmeasured force below which a component of the wrench does not depend on it.
_REACHED = 1.0e-6


@record
class Wrenches:
    """Contact wrenches (N, 6): fx, fy, fz in N, mx, my, mz in N·m about the LCS origin, LCS.

    time : (N,), s.
    std : standard uncertainty of each component: the calibration's, and what a sample adds by the
    declarations of the rig file per posture (positioner, force_noise, hinge_moment, friction with a
    direction); its noise is added by `sample_noise`. ∞ where a constant is open.
    calibration_std : the part of the calibration and the rig's constants (rotations, zeros,
    sensitivities, mass, barycentre, hinges, datums, gravity's direction) with their correlations,
    common to all samples.
    raw : without the calibration: nominal mounting, the rig's stated zeros, mass and barycentre.
    """

    time: FloatArray
    value: FloatArray
    std: FloatArray
    calibration_std: FloatArray
    raw: FloatArray


def contact_wrench(
    state: State,
    g: float,
    rotation: FloatArray,
    force: FloatArray,
) -> FloatArray:
    """Contact wrench (N, 6) at rest from readings (N, n, 3) in N, sensor frames.

    rotation : (N, 3, 3), LCS → BCS, of the terminal. What moves has `inertial` besides.
    """
    N, n = force.shape[:2]
    M, weight = sensing(state), state.mass * gravity(state, g)
    # S = Σ F_i + G and Y = Σ r_i F_iᵀ + r_m Gᵀ are linear in the readings: one product for all.
    # Rows of [S; Y] times R are LCS components, and r × L is twice the skew part of L rᵀ.
    lever = np.concatenate([np.ones((n, 1)), state.hinge], axis=1)
    lever_m = np.concatenate([[1.0], state.barycentre])
    mix = np.einsum("na,nbc->ncab", lever, M).reshape(3 * n, 12)
    constant = np.outer(lever_m, weight).ravel() - state.zero.ravel() @ mix
    here = (force.reshape(N, 3 * n) @ mix + constant).reshape(N, 4, 3) @ rotation
    return np.concatenate([-here[:, 0], -so3.axial(here[:, 1:])], axis=1)


def inertial(state: State, inertia: FloatArray, moving: Motion) -> FloatArray:
    """Inertial terms (N, 6) of the wrench; inertia (3, 3) about the LCS origin, kg m²."""
    w, dw, a0 = moving.turning, moving.turning_rate, moving.acceleration
    r = state.barycentre
    am = a0 + np.cross(dw, r) + np.cross(w, np.cross(w, r))
    turning = dw @ inertia.T + np.cross(w, w @ inertia.T)
    return np.concatenate([state.mass * am, turning + state.mass * np.cross(r, a0)], axis=1)


def to_lcs(at: Balance) -> FloatArray:
    """T (K, 6, 6) with the contact wrench in the LCS about its origin = T e of a balance."""
    halves = to_origin(at).reshape(-1, 2, 3, 6)
    return np.asarray(-np.swapaxes(at.rotation, 1, 2)[:, None] @ halves).reshape(-1, 6, 6)


def jacobian(given: Calibrated, at: Balance) -> FloatArray:
    """Derivative (K, 6, P) of the contact wrench (LCS) by the calibrated parameters."""
    by_state = features_jacobian(given.state, at, given.rig.gravity)
    return np.asarray(to_lcs(at) @ (at.design @ by_state))


def single(given: Calibrated, position: FloatArray, force: FloatArray) -> Postures:
    """Single samples (K, n, 3) as postures that only scatter by what the rig file declares.

    What a sensor does not measure counts as a force of zero here.
    """
    declared = given.rig.declared
    return alike(
        position,
        force,
        np.ones(given.rig.axes.shape, dtype=np.bool_),
        place=declared.positioner,
        noise=declared.force_noise,
        moment_var=declared.hinge_moment**2 + _friction_variance(given),
    )


def _friction_variance(given: Calibrated) -> float:
    """Variance per axis, (N·m)², of friction n τ against a turn whose direction is any."""
    n, place = given.rig.n, layout(given.rig.n)["friction"].start
    tau, variance = float(given.state.friction), float(given.covariance[place, place])
    return n**2 * (tau**2 + variance) / 3.0


@record
class Linear:
    """Contact wrenches at K places at rest as they follow their errors, LCS.

    jacobian : (K, 6, P), by the calibrated parameters. declared : (K, 6, 6), covariance by what is
    declared per posture. open : (K, 6), components that nothing bounds.
    """

    jacobian: FloatArray
    declared: FloatArray
    open: BoolArray


def linearised(given: Calibrated, position: FloatArray, force: FloatArray) -> Linear:
    """Linearise at positions (K, n, 3), m, BCS, and readings (K, n, 3), N."""
    posture = single(given, position, measured(given, force))
    at = balance(posture, given.state, given.state.barycentre, given.rig.gravity)
    T, J = to_lcs(at), jacobian(given, at)
    unknown = (np.abs(J[:, :, given.open]) > _ROUNDING).any(axis=2)
    unknown |= reached(T @ free(at.noise_force, given.rig.axes))
    return Linear(J, np.asarray(T @ at.cov @ np.swapaxes(T, 1, 2)), unknown)


def covariance(given: Calibrated, position: FloatArray, force: FloatArray) -> FloatArray:
    """Covariance (K, 6, 6) of contact wrenches at rest from the calibration, LCS; ∞ where open.

    position (K, n, 3) in m, BCS; force (K, n, 3), N, readings.
    """
    linear = linearised(given, position, force)
    half = linear.jacobian @ given.root
    out = half @ np.swapaxes(half, 1, 2)
    out[:, range(6), range(6)] += np.where(linear.open, np.inf, 0.0)
    return np.asarray(out)


def reached(columns: FloatArray) -> BoolArray:
    """Components (K, 6) of the wrench that unit forces along unmeasured axes (K, 6, m) reach."""
    reach = np.linalg.norm(columns, axis=2)
    return np.asarray(reach > _REACHED * reach.max(axis=1, keepdims=True))


def measured(given: Calibrated, force: FloatArray) -> FloatArray:
    """Readings (K, n, 3) with those of axes that no sensor measures at their zeros, N."""
    return np.where(given.rig.axes, force, given.state.zero)


def unknown_components(given: Calibrated) -> tuple[str, ...]:
    """Components that axes without a sensor leave unknown, the terminal level and at rest."""
    state = given.state
    share = np.array([0.0, 0.0, given.rig.gravity * float(state.mass) / given.rig.n])
    reading = np.einsum("nba,b->na", state.rotation, share) + state.zero
    at = linearised(given, (state.hinge + state.datum)[None], reading[None])
    return tuple(name for name, open_ in zip(COMPONENTS, at.open[0], strict=True) if open_)


def wrenches(
    given: Calibrated,
    time: FloatArray,
    position: FloatArray,
    force: FloatArray,
    rotation: FloatArray | None = None,
    moving: Motion | None = None,
) -> Wrenches:
    """Contact wrenches at N samples.

    time : (N,), s. position : (N, n, 3), m, BCS. force : (N, n, 3), N, readings.
    rotation : (N, 3, 3), of the terminal, where it is known already. moving : its motion, for the
    inertial terms with the rig's inertia; None: at rest.
    """
    state, force = given.state, measured(given, force)
    if rotation is None:
        rotation = rotations(state.hinge, position - state.datum)
    inertia, g = given.rig.inertia, given.rig.gravity
    value, raw = (contact_wrench(s, g, rotation, force) for s in (state, nominal(given.rig)))
    if moving is not None and inertia is not None:
        value = value + inertial(state, inertia.value, moving)
        raw = raw + inertial(nominal(given.rig), inertia.value, moving)
    own, common = _std(given, time, position, force)
    return Wrenches(time=time, value=value, std=own, calibration_std=common, raw=raw)


def _std(
    given: Calibrated, time: FloatArray, position: FloatArray, force: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Standard uncertainties (N, 6) with what samples add and without, by short blocks' means."""
    by_time = np.floor((time - time[0]) / _SPAN)
    new = np.append(True, np.diff(by_time) > 0)
    new[::_BLOCK] = True
    start = np.flatnonzero(new)
    count = np.diff(np.append(start, len(time)))
    position, force = (
        np.add.reduceat(v, start, axis=0) / count[:, None, None] for v in (position, force)
    )
    linear = linearised(given, position, force)
    common = np.sum((linear.jacobian @ given.root) ** 2, axis=2)
    common = np.where(linear.open, np.inf, common)
    own = np.diagonal(linear.declared, axis1=1, axis2=2)
    both = np.sqrt(np.concatenate([common + own, common], axis=1))
    std, calibration_std = np.split(np.repeat(both, count, axis=0), 2, axis=1)
    return std, calibration_std


def at_rest(given: Calibrated, samples: Iterable[Samples]) -> Iterator[Wrenches]:
    """Quasi-static contact wrenches: inertia plays no part."""
    for piece in samples:
        yield wrenches(given, piece.time, piece.position, piece.force)


def in_motion(given: Calibrated, samples: Iterable[Samples]) -> Iterator[Wrenches]:
    """Contact wrenches with the terminal's inertial terms.

    Velocities and accelerations come from the servo positions in a symmetric window, without
    delay; a piece is therefore held back by half a window. A stretch too short for one window is
    taken as at rest.
    """
    held: Samples | None = None
    done = 0
    for piece in samples:
        joined = piece if held is None else Samples.joined([held, piece])
        usual = np.median(np.diff(joined.time)) if joined.time.size > 1 else np.inf
        *closed, last = joined.stretches(_UNEVEN * float(usual))
        for stretch in closed:
            yield from _emit(given, stretch, done, stretch.time.size)
            done = 0
        half = _half(last)
        keep = last.time.size - 2 * half
        if keep > half:
            yield from _emit(given, last, done, last.time.size - half)
            held, done = last.rows(slice(keep, None)), half
        else:
            held = last
    if held is not None:
        yield from _emit(given, held, done, held.time.size)


def _half(stretch: Samples) -> int:
    """Instants on either side of the window."""
    return max(_LEAST, round(WINDOW / _step(stretch))) if stretch.time.size > 1 else _LEAST


def _step(stretch: Samples) -> float:
    return float((stretch.time[-1] - stretch.time[0]) / (stretch.time.size - 1))


def _emit(given: Calibrated, stretch: Samples, first: int, end: int) -> Iterator[Wrenches]:
    """Wrenches of the rows first … end − 1; the others are there for the window."""
    if end <= first:
        return
    R, T = poses(given.state.hinge, stretch.position - given.state.datum)
    half = _half(stretch)
    moving = motion(R, T, _step(stretch), half) if stretch.time.size > 2 * half else None
    rows, part = slice(first, end), stretch.rows(slice(first, end))
    yield wrenches(
        given,
        part.time,
        part.position,
        part.force,
        rotation=R[rows],
        moving=None if moving is None else moving.rows(rows),
    )
