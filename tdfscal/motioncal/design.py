"""The balance of every block in the frequency domain, linear in the features of the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tdfscal.estimation.score_tests import undeclared_zeros
from tdfscal.frozen import record, replace
from tdfscal.model import dynamics, statics
from tdfscal.model.dynamics import Moving
from tdfscal.model.parameters import State, symmetric
from tdfscal.model.postures import Postures, ZeroMotion, alike, zero_motion
from tdfscal.model.samples_in_motion import derivatives, motion, rotations
from tdfscal.model.statics import Balance
from tdfscal.motioncal.blocks import Across, Block, ComplexArray, across, filled, nearness
from tdfscal.motioncal.rows import UNSTATED, Bins, NoiseModel, Rows
from tdfscal.motioncal.streams import Slow, after_middle, course_of
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import covariance_root
from tdfscal.records import FloatArray, Rig

#: Below this angular speed, rad/s, a hinge sticks and its friction is whatever it has to be.
_STICK = 5.0e-4
#: Instants on either side that a local cubic takes in for angular speeds.
_HALF = 3
#: And for accelerations that only a lever or a figure is made of.
_WIDE = 6
#: One of so many instants is enough for mean covariances: they change as the loads do.
_EVERY = 4
#: Largest shift of the poses for the derivatives by delay and rate, s.
_SHIFT = 5.0e-3
#: Rows of the force and of the moment.
_FORCE, _MOMENT = slice(0, 3), slice(3, 6)


@record
class BlockDesign:
    """One block at one linearisation.

    design : (F, 6, q + 13 + s) complex, e = design · (statics' and motion's features, s zeros);
    its first three rows in N/√Hz, the others in N·m/√Hz. The last s columns are suspects: zeros
    that move, where none are declared to.
    mix : (r, 6), brings e to r components of independent noise; r = 6 less what no sensor measures.
    bins : frequencies and weights of its real rows, component by component within a frequency.
    turned : (N, 6, 3), e at every instant by three independent turns of its pose, as servo errors
    of 1 m make them.
    lever : (n, 6, 3, 6, 3), mean of B_i ⊗ B_i, B_i the wrench of a unit force.
    arm, force : (N, n, 3), m and N, BCS, of every instant. across : what unmeasured forces leave.
    rests : (F, 6, u R), wrench of the u unknowns of each of the block's rests, in their priors'
    standard uncertainties; place : these among the unknowns of all rests of the log.
    """

    block: Block
    design: ComplexArray
    mix: FloatArray
    bins: Bins
    lever: FloatArray
    turned: FloatArray
    arm: FloatArray
    force: FloatArray
    across: Across
    rests: ComplexArray
    place: slice

    def wrench(self, psi: FloatArray) -> ComplexArray:
        """Coefficients (F, 6) at features (q + 13 + s + all rests,), or (F, 6, c) of c of them."""
        cut = self.design.shape[2]
        own = psi[cut:][self.place]
        # One product of all rows, not one of six rows for every frequency.
        return np.tensordot(self.design, psi[:cut], axes=1) + np.tensordot(self.rests, own, axes=1)

    def weight(self, model: NoiseModel) -> FloatArray:
        """How much the components (F, r) count under a spectrum."""
        once = self.bins.some(np.arange(len(self.block.frequency) * len(self.mix)))
        weight = (once.count / model.variance(once)).reshape(-1, len(self.mix))
        weight[1:] *= 2  # a complex coefficient holds two values; the mean, which is real, one
        return np.asarray(weight)

    def white(self, columns: ComplexArray, model: NoiseModel) -> FloatArray:
        """Rows (M, c) of columns (F, 6, c), of unit variance by a spectrum."""
        factor = np.sqrt(self.bins.count / model.variance(self.bins))
        return np.asarray(self.real(columns) * factor[:, None])

    def real(self, columns: ComplexArray) -> FloatArray:
        """Rows (M, c) of columns (F, 6, c): real parts, then imaginary ones but of the mean.

        Of unit power each where the coefficient is.
        """
        F, c, r = len(columns), columns.shape[2], len(self.mix)
        both = self.mix @ np.ascontiguousarray(columns).view(np.float64)
        both[1:] *= np.sqrt(2.0)
        parts = both.reshape(F, r, c, 2)
        real, imaginary = parts[..., 0].reshape(F * r, c), parts[1:, ..., 1].reshape((F - 1) * r, c)
        return np.concatenate([real, imaginary])

    def back_in_time(self, columns: ComplexArray, model: NoiseModel) -> FloatArray:
        """Columns (F, 6, …) weighted by a spectrum, as they count at every instant, (N, 6, …)."""
        block, N = self.block, len(self.block)
        flat = columns.reshape(*columns.shape[:2], -1)
        weighted = (self.mix.T * self.weight(model)[:, None]) @ self.mix @ flat
        weighted[1:] /= 2  # of a real transform all coefficients but the mean count twice
        counts = (block.scale * N * block.taper[0])[:, None, None]
        return np.asarray(counts * np.fft.irfft(weighted, N, axis=0)).reshape(N, *columns.shape[1:])

    def rows(self, all_rests: int) -> Rows:
        """Its real rows; all_rests : turns at all rests of the log."""
        cut = self.design.shape[2]
        design = np.zeros((len(self.bins.count), cut + all_rests))
        design[:, :cut] = self.real(self.design)
        design[:, cut:][:, self.place] = self.real(self.rests)
        return Rows(design, self.bins)

    def reading_gain(self, model: NoiseModel) -> FloatArray:
        """Σ_f S_F S⁻¹ in the wrench's own components, (6, 6): what noise in the readings counts."""
        gain = self.bins.count * model.density(self.bins.frequency)[0] / model.variance(self.bins)
        by_component = gain.reshape(-1, len(self.mix)).sum(axis=0)
        return np.asarray(self.mix.T @ np.diag(by_component) @ self.mix)


def rms(designs: Sequence[BlockDesign], psi: FloatArray) -> FloatArray:
    """Quadratic means (2,) over time of the wrench of some blocks, N and N·m about c."""
    each = [item.block.seconds * item.block.power(item.wrench(psi)) for item in designs]
    seconds = sum(item.block.seconds for item in designs)
    return np.asarray(np.sqrt(np.sum(each, axis=0).reshape(2, 3).sum(axis=1) / seconds))


def block_design(
    rig: Rig,
    slow: Slow,
    block: Block,
    state: State,
    moving: Moving,
    resting: Sequence[slice],
    place: slice,
) -> tuple[BlockDesign, Balance]:
    """Linearise one block at a state.

    resting : rows of the block at which the terminal rests; place : of their unknowns.
    Returns its design, and the static balance of one instant, which holds what the features
    count from.
    """
    rows, after, course = block.index, after_middle(slow, block.index), course_of(slow, block.index)
    lag = moving.lag(after)
    position = course(lag) if lag.any() else slow.position[rows]
    observed = instants(rig, slow, position, rows)
    if not rig.axes.all():
        R = rotations(state.hinge, position - state.datum)
        driven = inertia_wrench(R, position - state.datum, block.step, state, moving)
        observed = filled(observed, driven, state, rig.gravity)
    at = statics.balance(observed, state, state.barycentre, rig.gravity)
    seen = across(block, at, rig.axes)
    moved = _moving_columns(seen, at.rotation, position, state)
    F = statics.forces(state, at.seen.force)
    some = slice(None, None, _EVERY)
    weight = block.taper[0, some] ** 2 / np.sum(block.taper[0, some] ** 2)
    near = nearness(slow, block, resting)
    # What the unknown turns of the rests leave of the positioners' errors.
    left = np.maximum(1 - np.sum(near**2, axis=1), 0.0)[some] * weight
    turned = seen.wrench(at.noise_turn @ np.linalg.cholesky(at.turn_cov))
    own = seen.wrench(np.where(rig.axes[:, None], at.noise_force, 0.0))[some]
    B = seen.wrench(at.wrench)[some]
    delayed = _delayed(seen, at.rotation, F, lambda h: course(lag + h), after, state, moving)
    columns = [seen.transform(at.design), moved, delayed]
    for _, shape, _ in suspected(rig, slow):
        columns.append(seen.transform(_zeros_moving(at, shape[rows])))
    # Mean covariance of e for white noise of 1 N on every force component, and of 1 m on every
    # servo coordinate through the registered pose.
    unit_force = np.einsum("k,knab,kncb->ac", weight, own, own, optimize=True)
    unit_turn = np.einsum("k,kac,kbc->ab", left, turned[some], turned[some], optimize=True)
    mix, ratio = _independent(seen.seen, unit_force, unit_turn)
    result = BlockDesign(
        block=block,
        design=np.concatenate(columns, axis=2),
        mix=mix,
        bins=Bins.of(block, ratio),
        lever=np.einsum("k,knra,knsb->nrasb", weight, B, B, optimize=True),
        turned=turned,
        arm=at.arm,
        force=F,
        across=seen,
        rests=_at_rests(rig, seen, at, near, resting),
        place=place,
    )
    return result, statics.balance(at.seen.subset(slice(0, 1)), state, at.centre, rig.gravity)


def _independent(
    seen: FloatArray, unit_force: FloatArray, unit_turn: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Matrix (r, 6) that brings e to independent components, and their ratios λ (r,), N²/m².

    seen : (r, 6), brings e to the coordinates that no unmeasured force reaches.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(seen @ unit_force @ seen.T))
    ratio, axes = np.linalg.eigh(inverse @ (seen @ unit_turn @ seen.T) @ inverse.T)
    return axes.T @ inverse @ seen, np.maximum(ratio, 0.0)


def unknowns_at_rest(rig: Rig) -> int:
    """Unknowns of every rest: a turn of its pose, and a wrench where force noise is declared."""
    return 9 if rig.declared.force_noise else 3


def _at_rests(
    rig: Rig, seen: Across, at: Balance, near: FloatArray, resting: Sequence[slice]
) -> ComplexArray:
    """Coefficients (F, 6, u R) of the u unknowns of every rest, in their priors' uncertainties.

    at : the balance of the block's instants, with positions and forces of unit covariance.
    near : (N, R), how much of what is a rest's own each instant has.
    """
    std, middle = max(rig.declared.positioner, UNSTATED), [(r.start + r.stop) // 2 for r in resting]
    turns = np.linalg.cholesky(at.turn_cov[middle])
    turned = np.zeros((len(near), 6, len(resting), 3))  # of the pose, which makes no force
    turned[:, 3:] = np.einsum("kab,rbc,kr->karc", std * at.noise_turn[:, 3:], turns, near)
    whole = seen.transform(turned.reshape(len(near), 6, -1))
    found = [whole.reshape(len(whole), *turned.shape[1:])]
    if unknowns_at_rest(rig) > 3:
        own = np.where(rig.axes[:, None], at.noise_force[middle], 0.0)
        root = covariance_root(np.einsum("rnab,rncb->rac", own, own))
        found.append(seen.shaped(near, rig.declared.force_noise * root))
    return np.concatenate(found, axis=3).reshape(len(whole), 6, -1)


def instants(rig: Rig, slow: Slow, position: FloatArray, rows: slice) -> Postures:
    """Instants as postures, with unit noise and without friction: a feature of its own here."""
    motion = drifting(rig, slow)
    motion = None if motion is None else motion.subset(rows)
    return alike(position, slow.force[rows], rig.axes, motion=motion)


def suspected(rig: Rig, slow: Slow) -> list[tuple[str, FloatArray, float]]:
    """How zeros may move over the log that no declaration lets move; see `undeclared_zeros`."""
    return list(undeclared_zeros(rig.drift, slow.time, slow.temperature))


def _zeros_moving(at: Balance, shape: FloatArray) -> FloatArray:
    """Columns (N, 6, 3 n) of the amplitudes of zeros that move by a shape (N, n or 1)."""
    own = -np.moveaxis(at.noise_force, 1, 2)  # (N, 6, n, 3)
    return np.asarray((own * shape[:, None, :, None]).reshape(len(own), 6, -1))


def drifting(rig: Rig, slow: Slow) -> ZeroMotion | None:
    """How the zeros may move over the instants; a random walk stands in the spectrum instead."""
    return zero_motion(replace(rig.drift, walk=0.0), slow.time, slow.temperature, rig.n)


def _moving_columns(
    seen: Across, R: FloatArray, position: FloatArray, state: State
) -> ComplexArray:
    """Columns of m, m (r_m − c), I_c and τ, (F, 6, 11)."""
    place, turning, speed_up = _kinematics(seen.block, R, position, state)
    at_once = np.zeros((len(R), 6, 4))
    arm_rate = np.cross(np.swapaxes(R, 1, 2), speed_up[:, None], axis=2)  # (R e_a) × a
    at_once[:, 3:, :3] = np.swapaxes(arm_rate, 1, 2)
    at_once[:, 3:, 3] = state.n * stuck(turning)
    now = seen.transform(at_once)
    pushed = seen.derivative(_FORCE, np.concatenate([place[..., None], R], axis=2), 2)
    pushed[..., 1:] += now[..., :3]
    spun = seen.derivative(_MOMENT, dynamics.spin_momentum(R, turning), 1)
    return -np.concatenate([pushed, spun, now[..., 3:]], axis=2)


def stuck(turning: FloatArray) -> FloatArray:
    """ω/|ω| (N, 3), smooth near rest."""
    return np.asarray(turning / np.sqrt(np.sum(turning**2, axis=1, keepdims=True) + _STICK**2))


def inertia_wrench(
    R: FloatArray, position: FloatArray, step: float, state: State, moving: Moving
) -> FloatArray:
    """Wrench (N, 6) of inertia and friction about the barycentre, BCS, at every instant.

    R : (N, 3, 3), poses. position : (N, n, 3), m, of the hinges. step : s. It holds accelerations,
    which the estimate itself moves onto the taper.
    """
    from tdfscal.wrench.contact_wrench import inertial  # where axes lack

    place = position.mean(axis=1) + R @ (state.barycentre - state.hinge.mean(axis=0))
    found = motion(R, place, step, _WIDE)
    assert found is not None  # blocks are longer than the window
    own = symmetric(_own_inertia(state, moving))
    both = inertial(replace(state, barycentre=np.zeros(3)), own, found)
    both[:, 3:] += state.n * moving.friction * stuck(found.turning)
    return np.asarray(-np.einsum("kab,kcb->kca", R, both.reshape(-1, 2, 3)).reshape(-1, 6))


def _kinematics(
    block: Block, R: FloatArray, position: FloatArray, state: State
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place of c less its mean (m), angular velocity (rad/s) and acceleration (m/s²), BCS."""
    middle = state.hinge.mean(axis=0) - state.barycentre
    place = (position - state.datum).mean(axis=1) - R @ middle
    first, second = derivatives(np.hstack([R.reshape(len(R), 9), place]), block.step, _HALF)
    turning = -0.5 * so3.axial(first[:, :9].reshape(R.shape) @ np.swapaxes(R, 1, 2))
    return place - place.mean(axis=0), turning, second[:, 9:]


def _delayed(
    seen: Across,
    R: FloatArray,
    F: FloatArray,
    course: Callable[[float], FloatArray],
    after: FloatArray,
    state: State,
    moving: Moving,
) -> ComplexArray:
    """Columns (F, 6, 2): e by a delay of the poses, and by one that grows as `after` (N,), s.

    R : (N, 3, 3), poses. F : (N, n, 3), N, BCS. course : servo positions (N, n, 3) by the amount of
    the delay.
    """
    spread = np.einsum("na,knb->kab", state.hinge - state.barycentre, F)
    ends = [_terms(seen.block, R, spread, course(h), state, moving) for h in (_SHIFT, -_SHIFT)]
    # Where the delay grows, everything turns slower by as much, but for the friction.
    slower = (0.0, 0.0, 0.5 * (ends[0][2] + ends[1][2]))
    moment, push, spin = (
        np.stack([change, after[:, None] * change - less], axis=2)
        for change, less in zip(
            ((a - b) / (2 * _SHIFT) for a, b in zip(*ends, strict=True)), slower, strict=True
        )
    )
    out = seen.transform(np.concatenate([np.zeros_like(moment), moment], axis=1))
    out -= seen.derivative(_FORCE, push, 2)
    out -= seen.derivative(_MOMENT, spin, 1)
    return out


def _terms(
    block: Block,
    near: FloatArray,
    spread: FloatArray,
    position: FloatArray,
    state: State,
    moving: Moving,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What in e changes with the poses at some servo positions, (N, 3) each, BCS.

    The moment of forces and friction; m place and I_c ω, whose second and first derivatives are
    taken off. near : (N, 3, 3), poses by these. spread : (N, 3, 3), Σ ρ_i F_iᵀ with ρ_i the hinges
    about the barycentre.
    """
    R = rotations(state.hinge, position - state.datum, near)
    place, turning, _ = _kinematics(block, R, position, state)
    # Σ (R ρ_i) × F_i, the axial vector of R Σ ρ_i F_iᵀ.
    moment = so3.axial(R @ spread) - state.n * moving.friction * stuck(turning)
    spin = dynamics.spin_momentum(R, turning) @ _own_inertia(state, moving)
    return moment, state.mass * place, spin


def _own_inertia(state: State, moving: Moving) -> FloatArray:
    """I_c (6,), about the barycentre."""
    return moving.inertia - state.mass * dynamics.spread_matrix(state.barycentre)
