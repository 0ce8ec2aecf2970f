"""What explains residual wrenches that a calibration does not: one cause at a time.

Each cause is a linear model e = H a + noise of the whitened residual wrenches of all postures; it
is judged by how much χ² falls when its q unknowns a are fitted (generalised least squares).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import FloatArray, IntArray
from tdfscal.statics import layout

Kind = Literal["sensor turned", "load changed", "zero drifted", "contact"]

#: A cause explains the residuals when what it leaves has at least this probability.
EXPLAINS = 0.01
#: Two causes are told apart when one leaves this much less χ² than the other, unknowns aside.
_CLEAR = 9.0
#: At most this share of the postures can be in contact before no cause is named.
_TOUCHED = 0.4
#: Postures that are tried as in contact, those with the largest residuals.
_SUSPECTS = 20


@dataclass(frozen=True, slots=True)
class Whitened:
    """Residual wrenches with all that correlates them.

    residual : (K, 6), L⁻¹ e of each posture's own noise. jacobian : (K, 6, P), L⁻¹ ∂e/∂θ.
    root : (P, r), U with U Uᵀ the covariance of θ. whitener : (K, 6, 6), L⁻¹.
    """

    residual: FloatArray
    jacobian: FloatArray
    root: FloatArray
    whitener: FloatArray

    def decorrelate(self, columns: FloatArray) -> FloatArray:
        """White columns (6K, c) of (6K, c): the calibration's common error taken into account.

        With B = J U the covariance is I + B Bᵀ; by the singular values s of B its inverse root is
        I − V (1 − 1/√(1 + s²)) Vᵀ.
        """
        B = (self.jacobian @ self.root).reshape(-1, self.root.shape[1])
        V, s, _ = np.linalg.svd(B, full_matrices=False)
        shrink = 1 - 1 / np.sqrt(1 + s**2)
        return np.asarray(columns - V @ (shrink[:, None] * (V.T @ columns)))


@dataclass(frozen=True, slots=True)
class Cause:
    """A possible cause, fitted.

    support : index, for a sensor's cause. postures : indices, for a contact.
    value, std : (q,), its unknowns: a turn in rad (rx, ry, rz, BCS: R_now = exp([a]×) R); a load's
    mass in kg and barycentre in m, as changes; a zero's change in N. A contact has none here.
    gain : by how much χ² falls, with q unknowns. p_value : that chance alone lets it fall so far.
    remaining_p : probability of the χ² that is left.
    """

    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    value: FloatArray
    std: FloatArray
    gain: float
    unknowns: int
    p_value: float
    remaining_p: float

    @property
    def explains(self) -> bool:
        """Nothing remarkable is left."""
        return self.remaining_p >= EXPLAINS


@dataclass(frozen=True, slots=True)
class _Model:
    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    columns: FloatArray


def causes(given: Whitened, free: FloatArray | None = None) -> tuple[Cause, ...]:
    """All single causes, the most likely first.

    free : (6K, f), directions of which nothing is known, fitted in any case.
    """
    z, project = _white(given, free)
    fitted = [_fit(model, z, project) for model in _models(given)]
    fitted += _contacts(given, z, project, max(fitted, key=_weight))
    return tuple(sorted(fitted, key=_weight, reverse=True))


def alike(first: Cause, other: Cause) -> bool:
    """Whether the data do not tell two causes apart."""
    return other.explains and _weight(first) - _weight(other) < _CLEAR


def statistic(given: Whitened, free: FloatArray | None = None) -> tuple[float, int]:
    """χ² of all residual wrenches together, and its degrees of freedom."""
    z, project = _white(given, free)
    return float(z @ z), z.size - project.shape[1]


def _weight(cause: Cause) -> float:
    """Gain less what as many unknowns are expected to gain (Akaike)."""
    return cause.gain - 2 * cause.unknowns


def _white(given: Whitened, free: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """White residual (6K,) and an orthonormal basis (6K, f) of what is fitted in any case."""
    z = given.decorrelate(given.residual.reshape(-1, 1))[:, 0]
    if free is None or not free.shape[1]:
        return z, np.zeros((z.size, 0))
    basis = _basis(given.decorrelate(free))
    return z - basis @ (basis.T @ z), basis


def _basis(columns: FloatArray) -> FloatArray:
    size = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(U[:, s > 1e-9 * s.max(initial=0.0)])


def _models(given: Whitened) -> list[_Model]:
    n = (given.jacobian.shape[2] - 6) // 18
    place = layout(n)
    J = given.jacobian.reshape(-1, given.jacobian.shape[2])

    def of(kind: Kind, columns: IntArray, support: int | None = None) -> _Model:
        return _Model(kind, support, (), given.decorrelate(J[:, columns]))

    found = [of("load changed", np.arange(place["mass"].start, place["barycentre"].stop))]
    for i in range(n):
        found.append(of("sensor turned", place["rotation"].start + 3 * i + np.arange(3), i))
        found.append(of("zero drifted", place["zero"].start + 3 * i + np.arange(3), i))
    return found


def _contact(given: Whitened, postures: Sequence[int]) -> _Model:
    K = len(given.residual)
    columns = np.zeros((K, 6, 6 * len(postures)))
    for place, k in enumerate(postures):
        columns[k, :, 6 * place : 6 * place + 6] = given.whitener[k]
    return _Model(
        "contact", None, tuple(sorted(postures)), given.decorrelate(columns.reshape(6 * K, -1))
    )


def _contacts(given: Whitened, z: FloatArray, project: FloatArray, rival: Cause) -> list[Cause]:
    """Contact in one posture each; where none explains all, in more of them, one by one."""
    K = len(given.residual)
    if K < 2:
        return []
    off = np.sum(z.reshape(K, 6) ** 2, axis=1)
    suspects = np.argsort(off)[::-1][:_SUSPECTS].tolist()
    single = [_fit(_contact(given, [k]), z, project) for k in suspects]
    best = max(single, key=_weight)
    chosen = list(best.postures)
    while not best.explains and not rival.explains and len(chosen) + 1 <= _TOUCHED * K:
        more = [
            _fit(_contact(given, [*chosen, k]), z, project) for k in suspects if k not in chosen
        ]
        best = max(more, key=_weight)
        chosen = list(best.postures)
        single.append(best)
    return single


def _fit(model: _Model, z: FloatArray, project: FloatArray) -> Cause:
    H = model.columns - project @ (project.T @ model.columns)
    size = np.linalg.norm(H, axis=0)
    size = np.where(size > 0, size, 1.0)
    U, s, Vt = np.linalg.svd(H / size, full_matrices=False)
    seen = s > 1e-9 * s.max(initial=0.0)
    fitted = U[:, seen].T @ z
    gain, q = float(fitted @ fitted), int(seen.sum())
    root = (Vt[seen].T / s[seen]) / size[:, None]
    left = z.size - project.shape[1] - q
    rest = max(float(z @ z) - gain, 0.0)
    contact = model.kind == "contact"
    return Cause(
        kind=model.kind,
        support=model.support,
        postures=model.postures,
        # e is linear about the estimate: what changed is minus what would cancel it.
        value=np.zeros(0) if contact else -(root @ fitted),
        std=np.zeros(0) if contact else np.linalg.norm(root, axis=1),
        gain=gain,
        unknowns=q,
        p_value=float(chi2_sf(gain, q)),
        remaining_p=float(chi2_sf(rest, left)) if left > 0 else 1.0,
    )


def turn_information(given: Whitened, free: FloatArray | None = None) -> FloatArray:
    """Information (n, 3, 3), 1/rad², that the postures hold about one sensor's turn alone."""
    _, project = _white(given, free)
    columns = [m.columns for m in _models(given) if m.kind == "sensor turned"]
    left = [H - project @ (project.T @ H) for H in columns]
    return np.stack([H.T @ H for H in left])
