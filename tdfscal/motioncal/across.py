"""The balance of a motion across forces that nobody measures (theory, section 10).

A component without a sensor is a force of any course in time, u(t), along a wrench W(t) that turns
with the terminal. What stands across it says all that can be known: with K the mean covariance of e
for unit forces on all axes and N(t) an orthonormal basis of what K^(-1/2) W does not reach, carried
along in parallel from instant to instant,

    e' = T e,   T(t) = K^(1/2) N₀ N(t)ᵀ K^(-1/2),   T W = 0.

White noise of the forces stays white, and e' keeps to one space of 6 − m dimensions, whatever way
the terminal leans. Where T meets a derivative, that is one of local cubics: T turns, and cannot
stand beside the taper.
"""

from __future__ import annotations

import numpy as np

from tdfscal.errors import NotIdentifiableError
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State
from tdfscal.model.statics import Balance, Postures, balance, features, free
from tdfscal.motioncal.blocks import Block, ComplexArray
from tdfscal.records import BoolArray, FloatArray
from tdfscal.wrench.samples_in_motion import derivatives

#: Instants on either side that a local cubic takes in.
_HALF = 3
#: A direction whose share of the columns is below this is rounding.
_ROUNDING = 1e-9


@record
class Across:
    """T (N, 6, 6) of a block's instants; None where every axis is measured.

    seen : (r, 6), brings e' to its own r coordinates.
    """

    block: Block
    seen: FloatArray
    course: FloatArray | None = None

    def wrench(self, columns: FloatArray) -> FloatArray:
        """T c of wrenches c (N, ..., 6, a)."""
        T = self.course
        if T is None:
            return columns
        return np.asarray(T.reshape(len(T), *(1,) * (columns.ndim - 3), 6, 6) @ columns)

    def transform(self, columns: FloatArray) -> ComplexArray:
        """Coefficients (F, 6, c) of wrenches (N, 6, c), most of which are zero."""
        out = np.zeros((len(self.block.frequency), *columns.shape[1:]), dtype=np.complex128)
        if self.course is not None:
            there = columns.any(axis=(0, 1))
            out[..., there] = self.block.transform(self.wrench(columns[..., there]))
        else:
            some = columns.any(axis=0)
            out[:, some] = self.block.transform(columns[:, some])
        return out

    def derivative(self, rows: slice, signal: FloatArray, order: int) -> ComplexArray:
        """Coefficients (F, 6, c) of T times a derivative of signals (N, 3, c) in three rows of e.

        rows : of the force or of the moment. order : 1 or 2.
        """
        N, _, c = signal.shape
        if self.course is None:
            out = np.zeros((len(self.block.frequency), 6, c), dtype=np.complex128)
            out[:, rows] = self.block.transform(signal, derivative=order)
            return out
        both = derivatives(signal.reshape(N, -1), self.block.step, _HALF)
        return self.block.transform(self.course[:, :, rows] @ both[order - 1].reshape(N, 3, c))


def filled(posture: Postures, driven: FloatArray, state: State, g: float) -> Postures:
    """Instants, evenly spaced, with the forces that nobody measures as the balance demands them.

    driven : (N, 6), wrench of inertia and friction about the barycentre.

    They are the levers of the turns alone. Some combinations hardly reach the balance (a push
    along the line between two hinges), so that they come smoothed over as many instants as they
    need: min Σ |e + W u|² / σ² + |u''|² / q², with second differences q of white noise, √6 σ.
    """
    missing = ~posture.measured
    force = np.where(missing, 0.0, posture.force)
    bare = replace(posture, force=force, measured=np.ones_like(missing))
    at = balance(bare, state, state.barycentre, g)
    root = np.linalg.inv(_unit_root(at))
    W = root @ free(at.noise_force, ~missing)
    e = root @ (at.design @ features(state, at, g) + driven)[..., None]
    force[:, missing] = _smooth(np.swapaxes(W, 1, 2) @ W, -(np.swapaxes(W, 1, 2) @ e)[..., 0])
    return replace(bare, force=force)


def _smooth(information: FloatArray, right: FloatArray) -> FloatArray:
    """Solution u (N, m) of H u + D u = right; H (N, m, m), D that of second differences."""
    from scipy.linalg import solveh_banded  # slow to import, seldom needed

    N, m = right.shape
    bands = np.zeros((2 * m + 1, N, m))
    second = np.array([1.0, -2.0, 1.0]) / np.sqrt(6.0)
    for lag in range(3):  # lower bands of DᵀD, second difference by second difference
        for k in range(3 - lag):
            bands[lag * m, k : N - 2 + k] += second[k] * second[k + lag]
    for b in range(m):
        bands[: m - b, :, b] += information[:, b:, b].T
    return np.asarray(
        solveh_banded(bands.reshape(2 * m + 1, N * m), right.ravel(), lower=True).reshape(N, m)
    )


def _unit_root(at: Balance) -> FloatArray:
    """Triangular root (6, 6) of the mean covariance of e for unit forces on all axes."""
    return np.linalg.cholesky(np.einsum("knra,knsa->rs", at.wrench, at.wrench) / len(at.arm))


def across(block: Block, at: Balance, measured: BoolArray) -> Across:
    """What of a block's balance no force on axes that are not measured (n, 3) reaches.

    Raises NotIdentifiableError where they reach all of it.
    """
    if measured.all():
        return Across(block, np.eye(6))
    root = _unit_root(at)
    left, size, _ = np.linalg.svd(np.linalg.solve(root, free(at.noise_force, measured)))
    reached = int(np.median((size > _ROUNDING * size[:, :1]).sum(axis=1)))
    if reached == 6:
        raise NotIdentifiableError(Finding("axes-leave-nothing"))
    basis = _carried(left[:, :, reached:])
    seen = np.linalg.solve(root.T, basis[0]).T
    T = root @ basis[0] @ np.swapaxes(np.linalg.solve(root.T, basis), 1, 2)
    return Across(block, seen, T)


def _carried(basis: FloatArray) -> FloatArray:
    """Orthonormal bases (N, 6, r) of spaces that turn, each turned to meet the one before."""
    out = basis.copy()
    for k in range(1, len(out)):
        u, _, v = np.linalg.svd(out[k].T @ out[k - 1])
        out[k] = out[k] @ (u @ v)
    return out
