"""Residual wrenches at a calibration, and all that correlates them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.model.parameters import layout, parameter_count, prior_std
from tdfscal.model.postures import ZeroMotion
from tdfscal.numerics.least_squares import Asked, ask_beside, block_diagonal
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig

#: Postures over which a zero is off before it returns; in one a contact is as likely.
_SHORTEST = 2


@record
class Course:
    """When K postures were held, s; and the temperature (K, n), °C, at each sensor, if logged."""

    time: FloatArray
    temperature: FloatArray | None = None

    def subset(self, keep: IntArray) -> Course:
        """Return that of the postures that keep selects."""
        warm = None if self.temperature is None else self.temperature[keep]
        return Course(self.time[keep], warm)

    def step(self, first: int, last: int | None = None) -> FloatArray:
        """1 at postures (K, 1) held with one of them or after it, up to a last one, else 0."""
        until = np.inf if last is None else self.time[last]
        during = (self.time >= self.time[first]) & (self.time <= until)
        return np.asarray(during, dtype=np.float64)[:, None]

    def drifts(self, sensors: int) -> Iterator[tuple[bool, FloatArray]]:
        """Shapes (K, n, g) of drifts, and whether they are of temperature.

        They begin with the log, or began before it.
        """
        everyone = (len(self.time), sensors, 1)
        before = np.ones(everyone)
        elapsed = self.time - self.time.min(initial=np.inf)
        if not elapsed.any():
            return
        line = np.broadcast_to((elapsed / elapsed.max())[:, None, None], everyone)
        for shapes in ([line], [line, line**2], [line, line**2, before]):
            yield False, np.concatenate(shapes, axis=2)
        if self.temperature is not None:
            warming = (self.temperature - self.temperature[np.argmin(self.time)])[:, :, None]
            if warming.any():
                warming = warming / np.abs(warming).max()
                yield True, warming
                yield True, np.concatenate([warming, before], axis=2)


@record
class Linearised:
    """Residual wrenches at a calibration to the first order, white in each posture's own noise.

    residual : (m,); m is 6K, or as many as a motion determines. columns : (m, P + E), derivative
    by the calibrated parameters and by E of this log alone: zeros that move, a motion's own.
    own : (K, 6, 6), whitens each posture's own noise, with 0 along forces that nobody measures;
    K = 0 in motion, where a contact is found otherwise. own_root : (E, r), of the covariance of
    this log's parameters. own_unknown : (E,), those of which nothing is known. rows : directions of
    all residuals that no unmeasured force reaches. sensors : n. course : of the K postures.
    """

    residual: FloatArray
    columns: FloatArray
    own: FloatArray
    own_root: FloatArray
    own_unknown: BoolArray
    rows: int
    sensors: int
    course: Course

    @property
    def zero_columns(self) -> FloatArray:
        """Derivative (m, 3n) by the zeros."""
        return self.columns[:, layout(self.sensors)["zero"]]


@record
class Whitened:
    """Residual wrenches of K postures beside all that may correlate them.

    at : the same, white in each posture's own noise only. root, unknown : of all P + E parameters'
    covariance, and those of which nothing is known. common : M (m, q), what the best parameters do
    to the residuals: their covariance's inverse is I − M Mᵀ. residual : (m,), at these parameters.
    spread : ln det of the residuals' covariance, by what it is without the calibration's error.
    free : directions of the residuals that what is unknown takes.
    """

    at: Linearised
    root: FloatArray
    unknown: BoolArray
    common: FloatArray
    residual: FloatArray
    spread: float
    free: int

    @property
    def chi2(self) -> float:
        """χ² of all residual wrenches together."""
        return float(self.at.residual @ self.residual)

    @property
    def dof(self) -> int:
        """Its degrees of freedom."""
        return int(self.at.rows - self.free)

    @property
    def worth(self) -> float:
        """What one unknown has to lower χ² by (Schwarz)."""
        return float(np.log(max(self.at.rows, 2)))

    @property
    def deviance(self) -> float:
        """−2 ln of the residuals' likelihood, but for a constant of the log."""
        return float(self.chi2 + self.spread + self.worth * self.free)

    def information(self, columns: FloatArray) -> FloatArray:
        """Information (c, c) on what moves the residuals along columns (m, c)."""
        known = self.common.T @ columns
        return np.asarray(columns.T @ columns - known.T @ known)

    def ask(self, columns: FloatArray) -> Asked:
        """How far the residuals go to meet columns (m, c)."""
        known = columns.T @ self.common
        return ask_beside(columns.T @ columns, columns.T @ self.residual, known)

    @cached_property
    def wrenches(self) -> Asked:
        """How far they go to meet a wrench in each of the K postures alone."""
        K = len(self.at.own)
        common, residual = (
            x[: 6 * K].reshape(K, 6, x.shape[1]) for x in (self.common, self.residual[:, None])
        )
        across = np.swapaxes(self.at.own, 1, 2)
        return ask_beside(across @ self.at.own, (across @ residual)[..., 0], across @ common)

    def likeliest_run(self, columns: FloatArray, *, returns: bool) -> tuple[int, ...]:
        """The posture from which on a step of these columns (6K, 3) lowers χ² most.

        returns : whether it may end again, behind the second one, where that is worth an unknown.
        Score and information of every run are sums of its postures' own blocks.
        """
        K, order = len(self.at.own), np.argsort(self.at.course.time, kind="stable")
        first, end = np.triu_indices(K + 1, _SHORTEST)
        kept = (first > 0) & ((end == K) | returns)
        first, end = np.append(first[kept], K - 1), np.append(end[kept], K)
        across = np.swapaxes(columns.reshape(K, 6, 3), 1, 2)[order]
        rows = np.hstack([columns, self.common, self.residual[:, None]]).reshape(K, 6, -1)
        each = across @ rows[order]
        total = np.cumsum(np.concatenate([np.zeros_like(each[:1]), each]), axis=0)
        own, known, score = np.split(total[end] - total[first], [3, each.shape[2] - 1], axis=2)
        asked = ask_beside(own, score[..., 0], known)
        best = int(np.argmax(asked.statistic - self.worth * (end < K)))
        ends = [first[best]] if end[best] == K else [first[best], end[best] - 1]
        return tuple(order[ends].tolist())

    def scattered(self, columns: FloatArray) -> Whitened:
        """The same with noise of variance 1 along columns (G, m / G, c), of G groups of rows."""
        at, groups = self.at, len(columns)
        if groups == 1:  # it connects the postures, as a parameter does
            c = columns[0].shape[1]
            at = replace(at, columns=np.hstack([at.columns, columns[0]]))
            root, unknown = (
                block_diagonal(self.root, np.eye(c)),
                np.append(self.unknown, [False] * c),
            )
            return whiten(at, root, unknown)
        U, s, _ = np.linalg.svd(columns, full_matrices=False)
        weight = np.eye(U.shape[1]) - (U * (1 - 1 / np.hypot(1.0, s))[:, None]) @ np.swapaxes(
            U, 1, 2
        )

        def weighted(rows: FloatArray) -> FloatArray:
            return np.asarray((weight @ rows.reshape(*U.shape[:2], -1)).reshape(rows.shape))

        at = replace(
            at,
            residual=weighted(at.residual),
            columns=weighted(at.columns),
            own=weight @ at.own,
        )
        return whiten(at, self.root, self.unknown)


def whiten(at: Linearised, root: FloatArray, unknown: BoolArray) -> Whitened:
    """Residuals beside parameters of covariance U Uᵀ, and some of which nothing is known.

    With B the columns times U the residuals' covariance is I + B Bᵀ; by its singular values s the
    inverse is I − V s²/(1 + s²) Vᵀ.
    """
    V, s, _ = np.linalg.svd(at.columns @ root, full_matrices=False)
    known = V * (s / np.hypot(1.0, s))
    half = V * (1 - 1 / np.hypot(1.0, s))
    open_ = at.columns[:, unknown]
    free = basis(open_ - half @ (V.T @ open_))
    common = np.hstack([known, free - half @ (V.T @ free)])
    residual = at.residual - common @ (common.T @ at.residual)
    spread = float(np.sum(np.log1p(s**2)))
    return Whitened(at, root, unknown, common, residual, spread, free.shape[1])


def moving_zeros(rig: Rig, motion: ZeroMotion | None) -> tuple[FloatArray, BoolArray]:
    """Root (3nG, 3nG) of the amplitudes' covariance by which zeros move in this log; the unknown.

    A log's amplitudes are its own: they have their prior.
    """
    std = prior_std(rig, motion)[parameter_count(rig.n) :]
    return np.diag(np.where(np.isfinite(std), std, 0.0)), np.isinf(std)


def basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what columns (m, c) span."""
    size = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(U[:, s > 1e-9 * s.max(initial=0.0)])
