"""What explains residual wrenches that a calibration does not: one cause at a time.

Each cause is a linear model e = H a + noise of the whitened residual wrenches of all postures; it
is judged by how far χ² falls when its q unknowns a are fitted (generalised least squares), less
q ln N for N residuals (Schwarz, Ann. Stat. 6, 1978). Causes of few and many unknowns are so held
against each other on one scale, twice the logarithm of their odds. Readings that scatter more than
is stated are such a cause too, with one unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Literal

import numpy as np

from tdfscal.model.parameters import layout
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import FloatArray
from tdfscal.selfcal.scatter import likeliest
from tdfscal.significance import CAUSE_EXPLAINS, CAUSES_APART
from tdfscal.validation.known_noise import Linearised, Whitened, basis

Kind = Literal[
    "sensor turned",
    "load changed",
    "zero drifted",
    "gain changed",
    "base tilted",
    "contact",
    "noise grown",
    "zeros wander",
    "zeros moved",
    "hinges stick",
]

#: Causes that are a scatter, not a change: the test of all residuals together sees them.
NOISE: tuple[Kind, ...] = ("noise grown", "zeros wander", "zeros moved", "hinges stick")
#: What may happen to one sensor, and the parameters that stand for it.
_SENSOR_CAUSES: dict[Kind, str] = {"sensor turned": "rotation", "zero drifted": "zero"}
#: Shapes of a gain's change in S (xx, yy, zz, yz, xz, xy): of all axes alike, one by one, each by
#: itself with crosstalk.
_GAINS = (
    np.array([[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]]).T,
    *(np.eye(6)[:, [a]] for a in range(3)),
    np.eye(6)[:, :3],
    np.eye(6),
)

#: At most this share of the postures can be in contact before no cause is named.
_TOUCHED = 0.4
#: Postures up to which noise that connects them is tried: its work grows with their cube.
_CONNECTED = 60
#: Postures that are tried as in contact, those with the largest residuals.
_SUSPECTS = 20


@dataclass(frozen=True, slots=True)
class Cause:
    """A possible cause, fitted by generalised least squares.

    support : index, for a sensor's cause. postures : indices, for a contact.
    value, std : (q,), its unknowns: a turn in rad (rx, ry, rz, BCS: R_now = exp([a]×) R); a load's
    mass in kg and barycentre in m, as changes; a zero's change in N; a gain's change as S (6,): xx,
    yy, zz, yz, xz, xy; the base's tilt in rad about x and y of the BCS; the standard deviation of
    more noise, of the zeros' wander or of a move of all zeros, N, or of the hinges' friction, N·m,
    per axis and posture. A contact has none here.
    gain : by how much χ² falls, with q unknowns. weight : the same less what as many unknowns are
    worth (Schwarz). p_value : that chance alone lets it fall so far.
    remaining_p : probability of the χ² that is left.
    """

    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    value: FloatArray
    std: FloatArray
    gain: float
    weight: float
    unknowns: int
    p_value: float
    remaining_p: float

    @property
    def explains(self) -> bool:
        """Nothing remarkable is left."""
        return self.remaining_p >= CAUSE_EXPLAINS


_WEIGHT = attrgetter("weight")


@dataclass(frozen=True, slots=True)
class Causes:
    """Single causes, the most likely first.

    best : one per kind and support or posture, the likeliest of its shapes. tried : how many could
    have looked like the likeliest by chance.
    """

    best: tuple[Cause, ...]
    tried: int

    @property
    def suspected(self) -> tuple[Cause, ...]:
        """The causes that explain the residuals and cannot be told apart, the likeliest first."""
        explaining = [cause for cause in self.best if cause.explains]
        if not explaining:
            return ()
        most = explaining[0].weight
        # What explains less well than another that leaves too much is not the cause.
        if self.best[0].weight - most >= CAUSES_APART:
            return ()
        return tuple(c for c in explaining if most - c.weight < CAUSES_APART)


@dataclass(frozen=True, slots=True)
class _Model:
    """Columns (6K, q) of the unknowns, of parameters by `shape` (p, q), which gives them back."""

    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    columns: FloatArray
    shape: FloatArray | None = None


def causes(given: Whitened) -> Causes:
    """Hold all single causes against each other."""
    models = _models(given)
    fitted = [_fit(model, given) for model in models]
    contacts = _contacts(given, max(fitted, key=_WEIGHT))
    best: dict[tuple[Kind, int | None, tuple[int, ...]], Cause] = {}
    for cause in (*fitted, *contacts):
        key = (cause.kind, cause.support, cause.postures)
        if key not in best or cause.weight > best[key].weight:
            best[key] = cause
    tried = len(models) + (len(given.own) if contacts else 0)
    found = [*best.values(), *_scatters(given, models), _zeros_moved(given, models)]
    return Causes(tuple(sorted(found, key=_WEIGHT, reverse=True)), tried)


def unknown_columns(cause: Cause, at: Linearised) -> FloatArray:
    """Derivative (m, q) of residuals by what a cause changes; none of a zero, nor of a scatter."""
    place, load = layout(at.sensors), ("mass", "barycentre")
    match cause.kind:
        case "sensor turned" | "gain changed":
            assert cause.support is not None
            q = len(cause.std)
            group = "rotation" if cause.kind == "sensor turned" else "sensitivity"
            first = place[group].start + q * cause.support
            return at.columns[:, first : first + q][:, cause.std > 0]
        case "load changed":
            return np.concatenate([at.columns[:, place[name]] for name in load], axis=1)
        case "base tilted":
            return at.columns[:, place["tilt"]]
        case "contact":
            return _touching(at.own, cause.postures)
    return at.columns[:, :0]


def _models(given: Whitened) -> list[_Model]:
    place = layout(given.sensors)
    load = slice(place["mass"].start, place["barycentre"].stop)
    found = [_Model("load changed", None, (), given.columns[:, load])]
    for kind, group in _SENSOR_CAUSES.items():
        for i, first in enumerate(range(place[group].start, place[group].stop, 3)):
            found.append(_Model(kind, i, (), given.columns[:, first : first + 3]))
    if not len(given.own):  # in motion the residual is known along these alone
        return found
    found.append(_Model("base tilted", None, (), given.columns[:, place["tilt"]]))
    for i, first in enumerate(range(place["sensitivity"].start, place["sensitivity"].stop, 6)):
        columns = given.columns[:, first : first + 6]
        found += [_Model("gain changed", i, (), columns @ shape, shape) for shape in _GAINS]
    return found


def _scatters(given: Whitened, models: Sequence[_Model]) -> list[Cause]:
    """More noise than is stated: of all forces (1/f too), of one sensor, of moments (friction)."""
    K, n = len(given.own), given.sensors
    if not K:
        return []
    zero = given.plain[:, layout(n)["zero"]].reshape(K, 6, n, 3)
    each = np.eye(K)
    suspects: list[tuple[Kind, int | None, FloatArray, FloatArray]] = [
        ("noise grown", None, zero.reshape(K, 6, -1), each),
        *(("noise grown", i, zero[:, :, i], each) for i in range(n)),
        ("hinges stick", None, given.own[:, :, 3:], each),
    ]
    if 1 < K <= _CONNECTED:
        suspects.append(("zeros wander", None, zero.reshape(K, 6, -1), _octaves(K)))
    return [_scatter(given, models, *suspect) for suspect in suspects]


def _zeros_moved(given: Whitened, models: Sequence[_Model]) -> Cause:
    """All zeros moved once, as a tare does it: a variance along their columns."""
    columns = given.columns[:, layout(given.sensors)["zero"]]
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    along = U.T @ given.residual
    theta, gain = likeliest(np.diag(s)[None], along[None], np.zeros((1, len(s), 0)))
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + theta * s**2)

    def weighted(columns: FloatArray) -> FloatArray:
        return np.asarray(columns - (U * shrink) @ (U.T @ columns))

    return _scatter_cause(given, models, "zeros moved", None, weighted, theta, gain)


def _octaves(K: int) -> FloatArray:
    """Correlation (K, K) of 1/f noise between postures, from less than one to more than the log.

    It is a sum of relaxations of equal variance whose times are octaves apart (van der Ziel,
    Physica 16, 1950).
    """
    apart = np.abs(np.subtract.outer(np.arange(K), np.arange(K)))
    times = 0.5 * 2.0 ** np.arange(np.ceil(np.log2(8 * K)) + 1)
    return np.asarray(np.mean(np.exp(-apart[..., None] / times), axis=2))


def _scatter(
    given: Whitened,
    models: Sequence[_Model],
    kind: Kind,
    support: int | None,
    columns: FloatArray,
    together: FloatArray,
) -> Cause:
    """A variance along columns (K, 6, m); it explains where, weighted by it, nothing stands out.

    columns : white in each posture's own noise. together : (K, K), correlation of the postures.
    """
    K = len(columns)
    if K <= _CONNECTED:
        blocks = np.einsum("kl,kac,lbc->kalb", together, columns, columns, optimize=True)
        half = given.white(blocks.reshape(6 * K, 6 * K))
        H = given.white(half.T)[None]
    else:  # what the calibration's error connects is a small part of so many
        H = columns @ np.swapaxes(columns, 1, 2)
    values, vectors = np.linalg.eigh((H + np.swapaxes(H, 1, 2)) / 2)
    values = np.maximum(values, 0.0)
    root, parts = vectors * np.sqrt(values)[:, None, :], values.shape
    white = given.residual.reshape(parts)
    theta, gain = likeliest(root, white, np.zeros((*parts, 0)))
    shrink = 1.0 / np.sqrt(1.0 + theta * values)
    weight = (vectors * shrink[:, None, :]) @ np.swapaxes(vectors, 1, 2)

    def weighted(columns: FloatArray) -> FloatArray:
        return np.asarray((weight @ columns.reshape(*parts, -1)).reshape(6 * K, -1))

    return _scatter_cause(given, models, kind, support, weighted, theta, gain)


def _scatter_cause(
    given: Whitened,
    models: Sequence[_Model],
    kind: Kind,
    support: int | None,
    weighted: Callable[[FloatArray], FloatArray],
    theta: float,
    gain: float,
) -> Cause:
    """A variance θ that lowers −2 ln L by `gain`; weighted : columns white with it."""
    rest, K = weighted(given.residual[:, None])[:, 0], len(given.own)
    p = [float(chi2_sf(rest @ rest, given.dof))]
    if K:
        each = np.sum(rest.reshape(K, 6) ** 2, axis=1)
        p.append(K * float(chi2_sf(each.max(), 6)))
    for model in models:
        span = basis(weighted(model.columns))
        along = span.T @ rest
        p.append(len(models) * float(chi2_sf(along @ along, max(span.shape[1], 1))))
    size = np.sqrt(theta)
    return Cause(
        kind=kind,
        support=support,
        postures=(),
        value=np.array([size]),
        std=np.array([size / np.sqrt(2.0 * max(given.dof, 1))]),
        gain=gain,
        weight=gain - given.worth,
        unknowns=1,
        p_value=float(chi2_sf(gain, 1)) / 2,
        # Three questions, each at its own level.
        remaining_p=min(1.0, 3 * min(p)),
    )


def _contact(given: Whitened, postures: Sequence[int]) -> _Model:
    white = given.white(_touching(given.own, postures))
    return _Model("contact", None, tuple(sorted(postures)), white)


def _touching(own: FloatArray, postures: Sequence[int]) -> FloatArray:
    """Derivative (6K, 6c) of residual wrenches by a contact wrench in each of c postures."""
    columns = np.zeros((len(own), 6, 6 * len(postures)))
    for place, k in enumerate(postures):
        columns[k, :, 6 * place : 6 * place + 6] = own[k]
    return columns.reshape(-1, columns.shape[2])


def _contacts(given: Whitened, rival: Cause) -> list[Cause]:
    """Contact in one posture each; where none explains all, in more of them, one by one."""
    K = len(given.own)
    if K < 2:
        return []
    off = np.sum(given.residual.reshape(K, 6) ** 2, axis=1)
    suspects = np.argsort(off)[::-1][:_SUSPECTS].tolist()
    found = [_fit(_contact(given, [k]), given) for k in suspects]
    best = max(found, key=_WEIGHT)
    while not best.explains and not rival.explains and len(best.postures) + 1 <= _TOUCHED * K:
        more = [[*best.postures, k] for k in suspects if k not in best.postures]
        if not more:
            break
        best = max((_fit(_contact(given, postures), given) for postures in more), key=_WEIGHT)
        found.append(best)
    return found


def _fit(model: _Model, given: Whitened) -> Cause:
    size = np.linalg.norm(model.columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    U, s, Vt = np.linalg.svd(model.columns / size, full_matrices=False)
    seen = s > 1e-9 * s.max(initial=0.0)
    fitted = U[:, seen].T @ given.residual
    gain, q = float(fitted @ fitted), int(seen.sum())
    root = (Vt[seen].T / s[seen]) / size[:, None]
    rest = max(given.chi2 - gain, 0.0)
    contact = model.kind == "contact"
    if model.shape is not None:
        root = model.shape @ root
    return Cause(
        kind=model.kind,
        support=model.support,
        postures=model.postures,
        # e is linear about the estimate: what changed is minus what would cancel it.
        value=np.zeros(0) if contact else -(root @ fitted),
        std=np.zeros(0) if contact else np.linalg.norm(root, axis=1),
        gain=gain,
        weight=gain - q * given.worth,
        unknowns=q,
        p_value=float(chi2_sf(gain, q)),
        remaining_p=float(chi2_sf(rest, given.dof - q)),
    )
