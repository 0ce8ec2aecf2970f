"""The balance of a motion across forces that nobody measures (theory, section 10).

A component without a sensor is a force of any course in time, u(t), along a wrench W(t) that turns
with the terminal. What stands across it says all that can be known: with K the mean covariance of e
for unit forces on all axes and N(t) an orthonormal basis of what K^(-1/2) W does not reach, carried
along in parallel from instant to instant,

    e' = T e,   T(t) = K^(1/2) N₀ N(t)ᵀ K^(-1/2),   T W = 0.

White noise of the forces stays white, and e' keeps to one space of 6 − m dimensions, whatever way
the terminal leans. Where T meets a derivative, that derivative is moved onto the taper as always:
T x'' = (T x)'' − 2 (T' x)' + T'' x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import NotIdentifiableError
from tdfscal.model.statics import Balance
from tdfscal.motioncal.blocks import Block, ComplexArray
from tdfscal.records import FloatArray
from tdfscal.wrench.kinematics import derivatives

#: Instants on either side that a local cubic takes in for the derivatives of T.
_HALF = 3
#: A direction whose share of the columns is below this is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Across:
    """T of a block's instants, and its first two derivatives; none where every axis is measured.

    seen : (r, 6), brings e' to its own r coordinates. course : T, T', T'' (N, 6, 6) each, or none.
    """

    block: Block
    seen: FloatArray
    course: tuple[FloatArray, ...] = ()

    def wrench(self, columns: FloatArray) -> FloatArray:
        """T c of wrenches c (N, ..., 6, a)."""
        if not self.course:
            return columns
        T = self.course[0]
        return np.asarray(T.reshape(len(T), *(1,) * (columns.ndim - 3), 6, 6) @ columns)

    def transform(self, columns: FloatArray) -> ComplexArray:
        """Coefficients (F, 6, c) of wrenches (N, 6, c), most of which are zero."""
        out = np.zeros((len(self.block.frequency), *columns.shape[1:]), dtype=np.complex128)
        if self.course:
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
        transform = self.block.transform
        if not self.course:
            out = np.zeros((len(self.block.frequency), 6, signal.shape[2]), dtype=np.complex128)
            out[:, rows] = transform(signal, derivative=order)
            return out
        T, first, second = (each[:, :, rows] @ signal for each in self.course)
        if order == 1:
            return transform(T, derivative=1) - transform(first)
        return transform(T, derivative=2) - 2 * transform(first, derivative=1) + transform(second)


def across(block: Block, at: Balance) -> Across:
    """What of a block's balance no free force reaches.

    Raises NotIdentifiableError where free forces reach all of it.
    """
    if at.seen.measured.all():
        return Across(block, np.eye(6))
    B = at.wrench.mean(axis=0)
    root = np.linalg.cholesky(np.einsum("nra,nsa->rs", B, B))
    left, size, _ = np.linalg.svd(np.linalg.solve(root, at.free))
    reached = int(np.median((size > _ROUNDING * size[:, :1]).sum(axis=1)))
    if reached == 6:
        raise NotIdentifiableError(
            "the components that the sensors do not measure leave nothing of the balance of forces "
            "and moments",
            hint="measure more axes: a rigid terminal needs some beyond six that are missing",
        )
    basis = _carried(left[:, :, reached:])
    seen = np.linalg.solve(root.T, basis[0]).T
    T = root @ basis[0] @ np.swapaxes(np.linalg.solve(root.T, basis), 1, 2)
    course = [d.reshape(T.shape) for d in derivatives(T.reshape(len(T), -1), block.step, _HALF)]
    return Across(block, seen, (T, *course))


def _carried(basis: FloatArray) -> FloatArray:
    """Orthonormal bases (N, 6, r) of spaces that turn, each turned to meet the one before."""
    out = basis.copy()
    for k in range(1, len(out)):
        u, _, v = np.linalg.svd(out[k].T @ out[k - 1])
        out[k] = out[k] @ (u @ v)
    return out
