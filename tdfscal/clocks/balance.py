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
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tdfscal.clocks.tracks import Track
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray

_STEPS = 12  # of the search for the mounting
_APART = 0.1  # s, of the poses that show accelerations
_GRAVITY = 9.81
_STICK = 1e-3  # rad/s, above which friction is Coulomb's
#: [e_k]× as ε_akc, less its sign.
_EPSILON = -np.stack([so3.hat(e) for e in -np.eye(3)], axis=1)
#: Entries of a symmetric matrix.
_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, slots=True)
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
        self._trio = max(combinations(range(self.n), 3), key=lambda t: _area(place[list(t)]))
        self._length = float(np.sqrt(np.mean(np.sum((place - place.mean(axis=0)) ** 2, axis=1))))
        load = [np.sqrt(np.mean(np.sum(track.value**2, axis=1))) for track, _ in forces]
        self.load = float(np.sum(load))
        self.parameters = 6 * self.n + 11

    def _features(
        self, time: FloatArray, lag: FloatArray | float, ahead: float = 0.0
    ) -> tuple[_Features, BoolArray]:
        """Features of N instants, and which of them count, (N,).

        ahead : s, by which the positions are taken later than the forces.
        """
        shift = lag + np.zeros(len(time))
        known = np.ones(len(time), dtype=np.bool_)

        def values(streams: Sequence[tuple[Track, bool]], later: float) -> FloatArray:
            nonlocal known
            column = []
            for track, second in streams:
                value, there = track.at(time + later + (shift if second else 0.0))
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
        return _Features(arm, here, load, spin, rubbing, force / self.load), known

    def _axes(self, place: FloatArray) -> FloatArray:
        """The pose's own axes (N, 3, 3), as rows, by three hinges."""
        a, b, c = self._trio
        along = place[:, b] - place[:, a]
        normal = np.cross(along, place[:, c] - place[:, a])
        axes = np.stack([along, np.cross(normal, along), normal], axis=1)
        return np.asarray(axes / np.linalg.norm(axes, axis=2, keepdims=True))

    def fit(
        self, time: FloatArray, lag: FloatArray | float, start: FloatArray | None = None
    ) -> Model | None:
        """What balances best at instants (N,) and a lag, s; None where too few instants count.

        start : (n, 3, 3), rotations to begin from; by default those of the linear solution.
        """
        features, known = self._features(time, lag)
        if known.sum() < 6:
            return None
        rows = features.rows()[known].reshape(-1, 12 * self.n + 11)
        gram = rows.T @ rows / len(rows)
        return _search(gram, _linear_rotations(gram, self.n) if start is None else start)

    def residual(
        self, time: FloatArray, lag: FloatArray | float, model: Model, ahead: float = 0.0
    ) -> FloatArray:
        """Residuals (N, 6) at instants (N,); NaN where a stream has a hole."""
        features, known = self._features(time, lag, ahead)
        left = features.residual(model)
        left[~known] = np.nan
        return left

    def linearised(
        self, time: FloatArray, lag: FloatArray, model: Model
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals as above, and their slopes (N, 6, 6n + 11) by turns and by what is linear."""
        features, known = self._features(time, lag)
        left, rows, k = features.residual(model), features.rows(), 9 * self.n
        left[~known] = np.nan
        return left, np.concatenate([rows[:, :, :k] @ _turns(model.rotation), rows[:, :, k:]], 2)


@dataclass(frozen=True, slots=True)
class _Features:
    """Of N instants: arm (N, n, 3) in parts of the rig's size; axes (N, 3, 3), the pose's own;
    load (N, 3), u; spin (N, 3), ω̇ in the pose's axes; rubbing (N, 3), ω/|ω|; force (N, n, 3).
    """

    arm: FloatArray
    axes: FloatArray
    load: FloatArray
    spin: FloatArray
    rubbing: FloatArray
    force: FloatArray

    def terminal(self) -> tuple[FloatArray, FloatArray]:
        """Moments (N, 3, 7) of the entries of J and of τ, and (N, 3, 3) of r, in the BCS."""
        within = np.zeros((len(self.arm), 3, 6))
        for entry, (i, j) in enumerate(_ENTRIES):
            within[:, i, entry] += self.spin[:, j]
            if i != j:
                within[:, j, entry] += self.spin[:, i]
        turned = np.einsum("nka,nke->nae", self.axes, within)
        turned = np.concatenate([turned, self.rubbing[:, :, None]], axis=2)
        return turned, np.swapaxes(np.cross(self.axes, self.load[:, None]), 1, 2)

    def rows(self) -> FloatArray:
        """Coefficients (N, 6, 12n + 10) of vec X_i by rows, w_i, J, τ, r, m."""
        N, n, _ = self.arm.shape
        eye = np.eye(3)
        across = np.moveaxis(np.cross(self.arm[:, :, None], eye), 3, 1)  # (N, 3, n, a): a_i × e_a
        rows = np.zeros((N, 6, 12 * n + 11))
        rotations = rows[:, :, : 9 * n].reshape(N, 6, n, 3, 3)
        rotations[:, :3] = eye[None, :, None, :, None] * self.force[:, None, :, None, :]
        rotations[:, 3:] = across[..., None] * self.force[:, None, :, None, :]
        rows[:, :, : 9 * n] = rotations.reshape(N, 6, -1)
        rows[:, :3, 9 * n : 12 * n] = -np.tile(eye, n)
        rows[:, 3:, 9 * n : 12 * n] = -across.reshape(N, 3, -1)
        turned, upright = self.terminal()
        rows[:, 3:, 12 * n : 12 * n + 7] = -turned
        rows[:, 3:, 12 * n + 7 : 12 * n + 10] = -upright
        rows[:, :3, -1] = -self.load
        return rows

    def residual(self, model: Model) -> FloatArray:
        """What does not balance, (N, 6)."""
        n = self.arm.shape[1]
        w, J, r, m = np.split(model.rest, [3 * n, 3 * n + 7, 3 * n + 10])
        turned = np.einsum("iab,nib->nia", model.rotation, self.force) - w.reshape(n, 3)
        of_J, of_r = self.terminal()
        moment = np.cross(self.arm, turned).sum(axis=1) - of_J @ J - of_r @ r
        return np.hstack([turned.sum(axis=1) - float(m[0]) * self.load, moment])


def _area(trio: FloatArray) -> float:
    return float(np.linalg.norm(np.cross(trio[1] - trio[0], trio[2] - trio[0])))


def _linear_rotations(gram: FloatArray, n: int) -> FloatArray:
    """Rotations (n, 3, 3) of the linear solution without zeros and with m = 1."""
    wanted = [*range(9 * n), *range(12 * n, 12 * n + 10)]
    part = gram[np.ix_(wanted, wanted)]
    ridge = 1e-6 * np.trace(part) / len(part) * np.eye(len(part))
    found = np.linalg.solve(part + ridge, -gram[wanted, -1])
    return so3.project(found[: 9 * n].reshape(n, 3, 3))


def _turns(rotation: FloatArray) -> FloatArray:
    """Change (9n, 3n) of vec X_i by turns [e_k]× X_i."""
    n = len(rotation)
    each = np.einsum("akc,icb->iabk", _EPSILON, rotation)
    return np.asarray(np.einsum("iabk,ij->iabjk", each, np.eye(n)).reshape(9 * n, 3 * n))


def _search(gram: FloatArray, rotation: FloatArray) -> Model:
    """Levenberg–Marquardt on SO(3)ⁿ; what is linear is eliminated."""
    n = len(rotation)
    k = 9 * n
    linear = gram[k:, k:] + 1e-10 * np.trace(gram) / len(gram) * np.eye(len(gram) - k)
    back = np.linalg.solve(linear, gram[k:, :k])
    schur = gram[:k, :k] - gram[:k, k:] @ back

    def cost(rotation: FloatArray) -> float:
        return float(rotation.ravel() @ schur @ rotation.ravel())

    best, damping = cost(rotation), 1e-3
    for _ in range(_STEPS):
        J = _turns(rotation)
        H, slope = J.T @ schur @ J, J.T @ schur @ rotation.ravel()
        while damping < 1e8:
            step = np.linalg.solve(H + damping * np.diag(np.diag(H) + 1e-15), -slope)
            turned = so3.exp(step.reshape(n, 3)) @ rotation
            if (lower := cost(turned)) < best:
                break
            damping *= 10
        else:
            break
        done = best - lower < 1e-4 * best
        rotation, best, damping = turned, lower, max(damping / 10, 1e-9)
        if done:
            break
    return Model(rotation, -back @ rotation.ravel(), float(np.sqrt(max(best, 0.0))))
