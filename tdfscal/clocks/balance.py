"""Whether forces and positions balance at a lag: Newton and Euler, of nothing but a log.

With o in the middle of the hinges, arms a_i, the pose's own axes Q, u = ẑ + ö/g and loads in parts
of their sum,

    Σ X_i f_i − Σ w_i = m u,      Σ a_i × (X_i f_i − w_i) = Σ_k r_k Q_k × u + Q J Qᵀ ω̇ + τ ω/|ω|

is linear in X_i, w_i = X_i z_i, J, τ, r, m; friction left out would look like a lag. Its Gram
matrix over the instants of a lag is all that the
search on SO(3)ⁿ works on. Nothing of the rig needs to be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from tdfscal.clocks.tracks import Track
from tdfscal.frozen import record
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import widening
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.numerics.rotation_fits import descend
from tdfscal.records import BoolArray, FloatArray

_STEPS, _SETTLED = 12, 1e-6  # of the search for the mounting; the last one, in parts of the load
_RIDGE = 1e-12  # share of the trace that keeps a Gram matrix positive
_APART = 0.1  # s, of the poses that show accelerations
_GRAVITY = 9.81
_STICK = 1e-3  # rad/s, above which friction is Coulomb's
#: Entries of a symmetric matrix.
_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@record
class Model:
    """What balances best: rotation (n, 3, 3), rest (3n + 11,) of w_i, J, τ, r, m.

    misfit : RMS of the residual of an equation, in parts of the load.
    """

    rotation: FloatArray
    rest: FloatArray
    misfit: float


class Balance:
    """The balance of streams on two clocks.

    streams : of positions, then of forces, n each, with whether it is the second recorder's.
    """

    def __init__(self, positions: Sequence[tuple[Track, bool]],
                 forces: Sequence[tuple[Track, bool]]) -> None:  # fmt: skip
        self.positions, self.forces = positions, forces
        self.n = len(positions)
        place = np.stack([np.median(track.value, axis=0) for track, _ in positions])
        sides = {t: np.diff(place[list(t)], axis=0) for t in combinations(range(self.n), 3)}
        self._trio = max(sides, key=lambda t: float(np.linalg.norm(np.cross(*sides[t]))))
        self._length = float(np.sqrt(np.mean(np.sum((place - place.mean(axis=0)) ** 2, axis=1))))
        load = [np.sqrt(np.mean(np.sum(track.value**2, axis=1))) for track, _ in forces]
        self.load = float(np.sum(load))
        #: Misfit that the noise of the forces leaves where everything balances.
        square = sum(float(np.mean(track.noise**2)) for track, _ in forces)
        self.noise = float(np.sqrt(square)) / self.load
        self.parameters = 6 * self.n + 11

    def _rows(
        self, time: FloatArray, lag: FloatArray, ahead: float = 0.0
    ) -> tuple[FloatArray, BoolArray]:
        """Coefficients (N, 6, 12n + 11) at N instants, and which of them count, (N,).

        ahead : s, by which the positions are taken later than the forces.
        """
        known = np.ones(len(time), dtype=np.bool_)

        def values(streams: Sequence[tuple[Track, bool]], later: float) -> FloatArray:
            nonlocal known
            column = []
            for track, second in streams:
                value, there = track.at(time + later + (lag if second else 0.0))
                known = known & there
                column.append(value)
            return np.stack(column, axis=1)

        poses = [values(self.positions, ahead + step) for step in (-_APART, 0.0, _APART)]
        force = values(self.forces, 0.0)
        before, here, after = (self._axes(place) for place in poses)
        middle = [place.mean(axis=1) for place in poses]
        load = (middle[0] - 2.0 * middle[1] + middle[2]) / (_APART**2 * _GRAVITY)
        load[:, 2] += 1.0
        # d(ω)/dt of the axes Q (rows): small turns between neighbours.
        turns = 0.5 * (np.cross(here, after).sum(axis=1) - np.cross(before, here).sum(axis=1))
        spin = np.einsum("nka,na->nk", here, turns) / (_APART**2 * _GRAVITY)
        rate = np.cross(before, after).sum(axis=1) / (4.0 * _APART)
        rubbing = rate / np.sqrt(np.sum(rate**2, axis=1, keepdims=True) + _STICK**2)
        arm = (poses[1] - middle[1][:, None]) / self._length
        terminal = _of_terminal(here, load, spin, rubbing)
        return _coefficients(arm, force / self.load, *terminal, load), known

    def _axes(self, place: FloatArray) -> FloatArray:
        """The pose's own axes (N, 3, 3), as rows, by three hinges."""
        a, b, c = self._trio
        along = place[:, b] - place[:, a]
        normal = np.cross(along, place[:, c] - place[:, a])
        axes = np.stack([along, np.cross(normal, along), normal], axis=1)
        length = np.linalg.norm(axes, axis=2, keepdims=True)
        # Places that each count from a zero of their own may coincide.
        return np.asarray(axes / np.maximum(length, np.finfo(np.float64).tiny))

    def fit(self, times: Sequence[FloatArray], lags: Sequence[FloatArray],
            start: FloatArray | None = None) -> list[Model | None]:  # fmt: skip
        """What balances best by each lag's instants (N,), s; None where too few count.

        lags : (N,) at those of each, s. start : (n, 3, 3), rotations to begin from; by default
        those of the linear solution.
        """
        rows, known = self._rows(np.concatenate(times), np.concatenate(lags))
        ends = np.cumsum([len(time) for time in times])[:-1]
        both = zip(np.split(rows, ends), np.split(known, ends), strict=True)
        told = [own[there] if len(there) > 6 else own[:0] for own, there in both]
        flat = [own.reshape(-1, rows.shape[2]) for own in told if len(own) >= 6]
        if not flat:
            return [None] * len(told)
        gram = np.stack([own.T @ own / len(own) for own in flat])
        begin = _linear_rotations(gram, self.n) if start is None else np.stack([start] * len(gram))
        models = iter(_search(gram, begin))
        return [next(models) if len(own) >= 6 else None for own in told]

    def residual(
        self, time: FloatArray, lag: FloatArray, model: Model, ahead: float = 0.0
    ) -> FloatArray:
        """Residuals (N, 6) at instants (N,); NaN where a stream has a hole."""
        rows, known = self._rows(time, lag, ahead)
        left = rows @ np.append(model.rotation, model.rest)
        left[~known] = np.nan
        return np.asarray(left)

    def later(self, time: FloatArray, lag: FloatArray, model: Model, step: float) -> FloatArray:
        """Residuals (N, 6) at a lag larger by `step`, s; of all forces by earlier positions."""
        if all(second for _, second in self.forces):
            return self.residual(time, lag, model, -step)
        return self.residual(time, lag + step, model)

    def slopes(self, time: FloatArray, lag: FloatArray, model: Model) -> FloatArray:
        """Slopes (N, 6, 6n + 11) of the residuals by turns and by what is linear."""
        rows, k = self._rows(time, lag)[0], 9 * self.n
        turned = (so3.hat(np.eye(3)) @ model.rotation[:, None]).reshape(self.n, 3, 9)
        by_turns = rows[:, :, :k] @ block_diagonal(*np.swapaxes(turned, 1, 2))
        return np.concatenate([by_turns, rows[:, :, k:]], axis=2)


def _of_terminal(
    axes: FloatArray, load: FloatArray, spin: FloatArray, rubbing: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Moments (N, 3, 7) of the entries of J and of τ, and (N, 3, 3) of r, in the BCS.

    axes : (N, 3, 3), the pose's own. load : (N, 3), u. spin : (N, 3), ω̇ in the pose's axes.
    rubbing : (N, 3), ω/|ω|.
    """
    within = np.zeros((len(axes), 3, 6))
    for entry, (i, j) in enumerate(_ENTRIES):
        within[:, i, entry] += spin[:, j]
        if i != j:
            within[:, j, entry] += spin[:, i]
    turned = np.einsum("nka,nke->nae", axes, within)
    turned = np.concatenate([turned, rubbing[:, :, None]], axis=2)
    return turned, np.swapaxes(np.cross(axes, load[:, None]), 1, 2)


def _coefficients(
    arm: FloatArray, force: FloatArray, turned: FloatArray, upright: FloatArray, load: FloatArray
) -> FloatArray:
    """Rows (N, 6, 12n + 11) of vec X_i by rows, w_i, J, τ, r, m.

    arm : (N, n, 3) in parts of the rig's size. force : (N, n, 3) of the load; turned, upright as
    `_of_terminal` has them.
    """
    N, n, _ = arm.shape
    eye = np.eye(3)
    across = np.moveaxis(np.cross(arm[:, :, None], eye), 3, 1)  # (N, 3, n, a): a_i × e_a
    rows = np.zeros((N, 6, 12 * n + 11))
    rotations = rows[:, :, : 9 * n].reshape(N, 6, n, 3, 3)
    rotations[:, :3] = eye[None, :, None, :, None] * force[:, None, :, None, :]
    rotations[:, 3:] = across[..., None] * force[:, None, :, None, :]
    rows[:, :, : 9 * n] = rotations.reshape(N, 6, -1)
    rows[:, :3, 9 * n : 12 * n] = -np.tile(eye, n)
    rows[:, 3:, 9 * n : 12 * n] = -across.reshape(N, 3, -1)
    rows[:, 3:, 12 * n : 12 * n + 7] = -turned
    rows[:, 3:, 12 * n + 7 : 12 * n + 10] = -upright
    rows[:, :3, -1] = -load
    return rows


def _linear_rotations(gram: FloatArray, n: int) -> FloatArray:
    """Rotations (T, n, 3, 3) of the linear solutions without zeros and with m = 1."""
    wanted = np.array([*range(9 * n), *range(12 * n, 12 * n + 10)])
    part = gram[:, wanted[:, None], wanted]
    found = np.linalg.solve(_lifted(part, 1e-6 / len(wanted)), -gram[:, wanted, -1:])
    return so3.project(found[:, : 9 * n].reshape(-1, n, 3, 3))


def _lifted(gram: FloatArray, share: float) -> FloatArray:
    """Each Gram matrix (T, m, m) with a share of its trace on its diagonal."""
    trace = np.trace(gram, axis1=1, axis2=2)[:, None, None]
    return np.asarray(gram + share * trace * np.eye(gram.shape[1]))


def _search(gram: FloatArray, rotation: FloatArray) -> list[Model]:
    """The mountings that balance T Gram matrices best, each from one near by (T, n, 3, 3).

    What is linear is eliminated.
    """
    k = rotation[0].size
    linear = _lifted(gram, 1e-10 / gram.shape[1])[:, k:, k:]
    back = np.linalg.solve(linear, gram[:, k:, :k])
    schur = gram[:, :k, :k] - gram[:, :k, k:] @ back
    lower = np.linalg.cholesky(_lifted(schur, _RIDGE))
    root: FloatArray = np.pad(lower.swapaxes(1, 2), ((0, 0), (0, 0), (0, 1)))
    best = descend(root, rotation, iterations=_STEPS, tolerance=_SETTLED).rotation
    flat = best.reshape(-1, k, 1)
    misfit = np.sqrt(np.maximum(flat.swapaxes(1, 2) @ schur @ flat, 0.0)).ravel().tolist()
    rest = -(back @ flat)[..., 0]
    return [Model(*each) for each in zip(best, rest, misfit, strict=True)]


_ROUNDS = 40  # at most, where the noise of the slope makes steps short
_FITTED = 600  # instants for the mounting
_FEWEST, _BLOCKS = 6, 24
_LAG_SETTLED = 0.05  # of the lag's standard uncertainty
_LEAST = 0.02  # of the slowest stream's period, that no balance tells better


def refine(
    balance: Balance,
    model: Model,
    time: FloatArray,
    lag: float,
    rows: float,
    rate_std: float,
    slowest: float,
) -> tuple[FloatArray, FloatArray]:
    """Line of the lag (2,): in the middle of the instants, s, and its rate; covariance (2, 2).

    The residual changes with the lag as the arms of the forces change with time: a parameter of
    the poses (theory, section 8), whose noise is too small to weaken it. Gauss–Newton with all that
    balances eliminated; standard uncertainties by blocks of equal information, as what is left is
    correlated in time, and for the degrees of freedom that the balance has taken.

    time : (N,), s, even instants. rows : independent equations that they are. rate_std : stated.
    slowest : s, period of the slowest stream.
    """
    middle = 0.5 * (time[0] + time[-1])
    line, covariance = np.array([lag, 0.0]), np.zeros((2, 2))
    h = max(0.02, 0.5 * slowest)
    some = slice(None, None, max(len(time) // _FITTED, 1))
    blocks = int(np.clip(rows / 6.0, _FEWEST, _BLOCKS))
    lost = rows / max(rows - balance.parameters, 0.25 * balance.parameters)
    for _ in range(_ROUNDS):
        course = line[0] + line[1] * (time - middle)
        model = balance.fit([time[some]], [course[some]], model.rotation)[0] or model
        left = balance.residual(time, course, model)
        after, before = (balance.later(time, course, model, step) for step in (h, -h))
        slope = (after - before) / (2 * h)
        known = np.isfinite(left).all(axis=1) & np.isfinite(slope).all(axis=1)
        columns = np.stack([left, slope, slope * (time - middle)[:, None]], axis=2)[known]
        columns = _without(columns, balance.slopes(time, course, model)[known])
        step, covariance = _step(columns, blocks, lost, line[1], rate_std)
        line = line + step
        if step[0] ** 2 < _LAG_SETTLED**2 * covariance[0, 0]:
            break
    covariance[0, 0] += (_LEAST * slowest) ** 2
    return line, covariance


def _without(columns: FloatArray, others: FloatArray) -> FloatArray:
    """What is left of columns (N, 6, c) where others (N, 6, p) may take up what they can."""
    flat, by = columns.reshape(-1, columns.shape[2]), others.reshape(-1, others.shape[2])
    gram = by.T @ by
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    ridge = 1e-10 * np.eye(len(gram))
    taken = np.linalg.solve(gram / np.outer(scale, scale) + ridge, (by.T @ flat) / scale[:, None])
    return np.asarray((flat - by @ (taken / scale[:, None])).reshape(columns.shape))


def _step(
    columns: FloatArray, blocks: int, lost: float, rate: float, rate_std: float
) -> tuple[FloatArray, FloatArray]:
    """Change of lag and rate, and the covariance of both.

    columns : (N, 6, 3), residual and its slopes. lost : variance that the balance has taken up.
    """
    gram = np.einsum("nai,naj->nij", columns, columns)
    share = np.cumsum(gram[:, 1, 1])
    block = np.minimum((blocks * share / share[-1]).astype(int), blocks - 1)
    sums = np.zeros((blocks, 3, 3))
    np.add.at(sums, block, gram)
    G, pulls = sums[:, 1:, 1:], -sums[:, 1:, 0]
    inverse = np.linalg.inv(G.sum(axis=0))
    step = inverse @ pulls.sum(axis=0)
    scores = pulls - G @ step
    lost *= widening(blocks - 2) ** 2
    covariance = lost * inverse @ (scores.T @ scores) @ inverse
    # With what is stated of the rate.
    information = np.linalg.inv(covariance)
    stated = np.diag([0.0, 1.0 / max(rate_std, 1e-12) ** 2])
    covariance = np.linalg.inv(information + stated)
    step = covariance @ (information @ step + stated @ np.array([0.0, -rate]))
    return step, covariance
