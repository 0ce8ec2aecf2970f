"""What explains residual wrenches that a calibration does not: one cause at a time.

Each cause is a linear model e = H a + noise of the whitened residual wrenches of all postures; it
is judged by how much χ² falls when its q unknowns a are fitted (generalised least squares).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tdfscal.model.parameters import layout
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import BoolArray, FloatArray
from tdfscal.significance import CAUSE_EXPLAINS, CAUSES_APART

Kind = Literal["sensor turned", "load changed", "zero drifted", "contact"]

#: What may happen to one sensor, and the parameters that stand for it.
_SENSOR_CAUSES: dict[Kind, str] = {"sensor turned": "rotation", "zero drifted": "zero"}

#: At most this share of the postures can be in contact before no cause is named.
_TOUCHED = 0.4
#: Postures that are tried as in contact, those with the largest residuals.
_SUSPECTS = 20


@dataclass(frozen=True, slots=True)
class Whitened:
    """Residual wrenches of K postures with all that correlates them taken away.

    residual : (m,), white; m is 6K, or as many as a motion determines. columns : (m, P), its
    derivative by the calibrated parameters.
    own : (K, 6, 6), whitens each posture's own noise; K = 0 in motion, where a contact is found
    otherwise. common : (m, r), orthonormal; shrink : (r,):
    along them the calibration's error is common to all postures. free : (m, f), orthonormal,
    directions of parameters that nobody knows; the residual has no part in them. rows : directions
    of all residuals that no unmeasured force reaches. sensors : n.
    """

    residual: FloatArray
    columns: FloatArray
    own: FloatArray
    common: FloatArray
    shrink: FloatArray
    free: FloatArray
    rows: int
    sensors: int

    @property
    def chi2(self) -> float:
        """χ² of all residual wrenches together."""
        return float(self.residual @ self.residual)

    @property
    def dof(self) -> int:
        """Its degrees of freedom."""
        return int(self.rows - self.free.shape[1])

    def white(self, columns: FloatArray) -> FloatArray:
        """Columns (6K, c), whitened posture by posture already, made white altogether."""
        common = self.shrink[:, None] * (self.common.T @ columns)
        white = columns - self.common @ common
        return np.asarray(white - self.free @ (self.free.T @ white))


def whiten(
    residual: FloatArray,
    columns: FloatArray,
    own: FloatArray,
    root: FloatArray,
    unknown: BoolArray,
    rows: int,
    sensors: int,
) -> Whitened:
    """Take away the error of the calibration from residuals that are white in their own noise.

    residual : (m,). columns : (m, P), its derivative by the parameters. own : (K, 6, 6), what
    whitened each posture's own noise, with 0 along forces that nobody measures; rows : how many
    directions that leaves. root : (P, r), U with U Uᵀ the covariance of the
    parameters. unknown : (P,), parameters of which nothing is known.

    With B the columns times U the covariance is I + B Bᵀ; by the singular values s of B its
    inverse root is I − V (1 − 1/√(1 + s²)) Vᵀ.
    """
    V, s, _ = np.linalg.svd(columns @ root, full_matrices=False)
    start = Whitened(
        residual=residual,
        columns=columns,
        own=own,
        common=V,
        shrink=1 - 1 / np.sqrt(1 + s**2),
        free=np.zeros((len(columns), 0)),
        rows=rows,
        sensors=sensors,
    )
    known = replace(start, free=_basis(start.white(columns[:, unknown])))
    return replace(
        known,
        residual=known.white(residual[:, None])[:, 0],
        columns=known.white(columns),
    )


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what columns (m, c) span."""
    size = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(U[:, s > 1e-9 * s.max(initial=0.0)])


@dataclass(frozen=True, slots=True)
class Cause:
    """A possible cause, fitted by generalised least squares.

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
        return self.remaining_p >= CAUSE_EXPLAINS


@dataclass(frozen=True, slots=True)
class _Model:
    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    columns: FloatArray


def causes(given: Whitened) -> tuple[Cause, ...]:
    """All single causes, the most likely first."""
    fitted = [_fit(model, given) for model in _models(given)]
    fitted += _contacts(given, max(fitted, key=_weight))
    return tuple(sorted(fitted, key=_weight, reverse=True))


def alike(first: Cause, other: Cause) -> bool:
    """Whether the data do not tell two causes apart."""
    return other.explains and _weight(first) - _weight(other) < CAUSES_APART


def turn_information(given: Whitened) -> FloatArray:
    """Information (n, 3, 3), 1/rad², that the postures hold about one sensor's turn alone."""
    n = given.sensors
    H = given.columns[:, layout(n)["rotation"]].reshape(-1, n, 3)
    return np.asarray(np.einsum("mna,mnb->nab", H, H))


def _weight(cause: Cause) -> float:
    """Gain less what as many unknowns are expected to gain (Akaike)."""
    return cause.gain - 2 * cause.unknowns


def _models(given: Whitened) -> list[_Model]:
    place = layout(given.sensors)
    load = slice(place["mass"].start, place["barycentre"].stop)
    found = [_Model("load changed", None, (), given.columns[:, load])]
    for kind, group in _SENSOR_CAUSES.items():
        for i, first in enumerate(range(place[group].start, place[group].stop, 3)):
            found.append(_Model(kind, i, (), given.columns[:, first : first + 3]))
    return found


def _contact(given: Whitened, postures: Sequence[int]) -> _Model:
    columns = np.zeros((len(given.own), 6, 6 * len(postures)))
    for place, k in enumerate(postures):
        columns[k, :, 6 * place : 6 * place + 6] = given.own[k]
    white = given.white(columns.reshape(-1, columns.shape[2]))
    return _Model("contact", None, tuple(sorted(postures)), white)


def _contacts(given: Whitened, rival: Cause) -> list[Cause]:
    """Contact in one posture each; where none explains all, in more of them, one by one."""
    K = len(given.own)
    if K < 2:
        return []
    off = np.sum(given.residual.reshape(K, 6) ** 2, axis=1)
    suspects = np.argsort(off)[::-1][:_SUSPECTS].tolist()
    single = [_fit(_contact(given, [k]), given) for k in suspects]
    best = max(single, key=_weight)
    chosen = list(best.postures)
    while not best.explains and not rival.explains and len(chosen) + 1 <= _TOUCHED * K:
        rest = [k for k in suspects if k not in chosen]
        if not rest:
            break
        best = max((_fit(_contact(given, [*chosen, k]), given) for k in rest), key=_weight)
        chosen = list(best.postures)
        single.append(best)
    return single


def _fit(model: _Model, given: Whitened) -> Cause:
    size = np.linalg.norm(model.columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    U, s, Vt = np.linalg.svd(model.columns / size, full_matrices=False)
    seen = s > 1e-9 * s.max(initial=0.0)
    fitted = U[:, seen].T @ given.residual
    gain, q = float(fitted @ fitted), int(seen.sum())
    root = (Vt[seen].T / s[seen]) / size[:, None]
    left = given.dof - q
    rest = max(given.chi2 - gain, 0.0)
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
        p_value=float(chi2_sf(gain, q)) if q else 1.0,
        remaining_p=float(chi2_sf(rest, left)) if left > 0 else 1.0,
    )
