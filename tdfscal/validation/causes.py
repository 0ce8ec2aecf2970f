"""What explains residual wrenches that a calibration does not: one cause at a time.

Beside what may have changed since the calibration these are changes in the course of the log, a
contact in some postures, and readings that scatter more than is stated, with one unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from tdfscal.model.parameters import layout
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.information import Contrast
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.records import FloatArray
from tdfscal.selfcal.score_tests import best_variance
from tdfscal.validation.residuals import (
    STEPS,
    WEIGHT,
    Cause,
    Causes,
    Kind,
    Linearised,
    Model,
    Whitened,
    basis,
    explained,
    fitted,
)

#: What steps on the way, and the parameters that stand for it.
_STEPPING = dict(zip(STEPS, ("rotation", "zero"), strict=True))
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
#: Postures up to which noise that connects them is tried, and zeros that jump and return: the work
#: grows with their cube, and with their square.
_CONNECTED = 60
#: Postures over which a zero is off before it returns; in one a contact is as likely.
_SHORTEST = 2
#: Postures that are tried as in contact, those with the largest residuals.
_SUSPECTS = 20


def causes(given: Whitened) -> Causes:
    """Hold all single causes against each other."""
    models = _models(given.at)
    single = [fitted(model, given) for model in (*models, *_in_course(given))]
    contacts = _contacts(given, max(single, key=WEIGHT))
    best: dict[tuple[Kind, int | None, tuple[int, ...]], Cause] = {}
    for cause in (*single, *contacts):
        key = (cause.kind, cause.support, cause.postures)
        if key not in best or cause.weight > best[key].weight:
            best[key] = cause
    tried = len(models) + (len(given.at.own) if contacts else 0)
    found = [*best.values(), *_scatters(given, models), _zeros_moved(given, models)]
    # What looks alike to rounding stays in the order above.
    return Causes(tuple(sorted(found, key=lambda cause: -round(cause.weight, 6))), tried)


def unknown_columns(cause: Cause, at: Linearised) -> FloatArray:
    """Derivative (m, q) of residuals by what a cause changes; none of a zero, nor of a scatter."""
    if cause.kind == "contact":
        return _touching(at.own, cause.postures)
    if cause.columns is None or cause.kind == "zero drifted":
        return at.columns[:, :0]
    return cause.columns


def _models(at: Linearised) -> list[Model]:
    place, n = layout(at.sensors), at.sensors

    def by(group: str) -> FloatArray:
        return at.columns[:, place[group]]

    load = np.concatenate([by("mass"), by("barycentre")], axis=1)
    # A gain common to all sensors looks like another mass: whoever weighs the terminal knows.
    alike = by("sensitivity").reshape(-1, n, 6).sum(axis=1) @ _GAINS[0]
    found = [
        Model("load changed", None, (), load),
        Model("load changed", None, (), by("mass"), np.eye(4)[:, :1]),
        Model("gains changed", None, (), alike, _GAINS[0]),
        Model("sensors turned", None, (), by("rotation")),
    ]
    for i in range(n):
        turn, zero = (by(group)[:, 3 * i : 3 * i + 3] for group in ("rotation", "zero"))
        found += [Model("sensor turned", i, (), turn), Model("zero drifted", i, (), zero)]
        for a in range(3):
            found.append(Model("zero drifted", i, (), zero[:, [a]], np.eye(3)[:, [a]]))
    if not len(at.own):  # in motion the residual is known along these alone
        return found
    found.append(Model("base tilted", None, (), by("tilt")))
    for i in range(n):
        gain = by("sensitivity")[:, 6 * i : 6 * i + 6]
        found += [Model("gain changed", i, (), gain @ shape, shape) for shape in _GAINS]
    return found


def _in_course(given: Whitened) -> Iterator[Model]:
    """Steps of each sensor, from its likeliest posture on, and drifts of its zero or of all."""
    at = given.at
    if len(at.own) < 2:
        return
    for kind, group in _STEPPING.items():
        for i in range(at.sensors):
            begin = layout(at.sensors)[group].start + 3 * i
            columns = at.columns[:, begin : begin + 3]
            returns = group == "zero" and len(at.own) <= _CONNECTED
            run = _likeliest_run(given, columns, returns=returns)
            during = np.repeat(at.course.step(*run), 6, axis=0)
            yield Model(kind, i, run, columns * during)
    by_zero = at.zero_columns.reshape(len(at.own), 6, at.sensors, 3)
    for warm, shape in at.course.drifts(at.sensors):
        drift: Kind = "zeros follow temperature" if warm else "zeros drift"
        since = shape - shape[np.argmin(at.course.time)]
        most = since[np.argmax(np.abs(since[:, :, 0]).max(axis=1))]
        for i in (None, *range(at.sensors)):
            own = slice(None) if i is None else slice(i, i + 1)
            columns = np.einsum("kbna,kng->kbnga", by_zero[:, :, own], shape[:, own])
            back = np.kron(block_diagonal(*most[own, None]), np.eye(3))
            yield Model(drift, i, (), columns.reshape(len(at.columns), -1), np.asarray(back))


def _likeliest_run(given: Whitened, columns: FloatArray, *, returns: bool) -> tuple[int, ...]:
    """The posture from which on a step of these columns (6K, 3) lowers χ² most.

    returns : whether it may end again, behind the second one, where that is worth an unknown.
    Score and information of every run are sums of its postures' own blocks.
    """
    K, order = len(given.at.own), np.argsort(given.at.course.time, kind="stable")
    y, M = given.unfolded
    first, end = np.triu_indices(K + 1, _SHORTEST)
    kept = (first > 0) & ((end == K) | returns)
    first, end = np.append(first[kept], K - 1), np.append(end[kept], K)

    def during(other: FloatArray) -> FloatArray:
        """Sums (runs, 3, …) over the postures of each run."""
        each = np.einsum("kba,kbm->kam", columns.reshape(K, 6, 3), other.reshape(K, 6, -1))
        total = np.cumsum(np.concatenate([np.zeros_like(each[:1]), each[order]]), axis=0)
        return np.asarray(total[end] - total[first])

    score, common = during(y), during(M)
    information = during(columns) - common @ np.swapaxes(common, 1, 2)
    seen = np.linalg.pinv(information, rcond=1e-9, hermitian=True)
    worth = np.sum(score * (seen @ score), axis=(1, 2)) - given.worth * (end < K)
    best = int(np.argmax(worth))
    ends = [first[best]] if end[best] == K else [first[best], end[best] - 1]
    return tuple(order[ends].tolist())


def _scatters(given: Whitened, models: Sequence[Model]) -> list[Cause]:
    """More noise than is stated: of all forces (1/f too), of one sensor, of moments (friction)."""
    K, n = len(given.at.own), given.at.sensors
    if not K:
        return []
    zero = given.at.zero_columns.reshape(K, 6, n, 3)
    each = np.eye(K)
    suspects: list[tuple[Kind, int | None, FloatArray, FloatArray]] = [
        ("noise grown", None, zero.reshape(K, 6, -1), each),
        *(("noise grown", i, zero[:, :, i], each) for i in range(n)),
        ("hinges stick", None, given.at.own[:, :, 3:], each),
    ]
    found = [_scatter(given, models, *suspect) for suspect in suspects]
    if 1 < K <= _CONNECTED:
        elapsed = given.at.course.time - given.at.course.time.min()
        walk = np.minimum(elapsed[:, None], elapsed) / max(float(elapsed.max()), 1e-9)
        columns = zero.reshape(K, 6, -1)
        found.append(_scatter(given, models, "zeros wander", None, columns, walk))
    return found


def _zeros_moved(given: Whitened, models: Sequence[Model]) -> Cause:
    """All zeros moved once, as a tare does it: a variance along their columns."""
    columns = given.columns[:, layout(given.at.sensors)["zero"]]
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    along = U.T @ given.residual
    theta, gain = best_variance(np.diag(s)[None], along[None], np.zeros((1, len(s), 0)))
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + theta * s**2)

    def weighted(columns: FloatArray) -> FloatArray:
        return np.asarray(columns - (U * shrink) @ (U.T @ columns))

    return _scatter_cause(given, models, "zeros moved", None, weighted, theta, gain)


def _scatter(
    given: Whitened,
    models: Sequence[Model],
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
    theta, gain = best_variance(root, white, np.zeros((*parts, 0)))
    shrink = 1.0 / np.sqrt(1.0 + theta * values)
    weight = (vectors * shrink[:, None, :]) @ np.swapaxes(vectors, 1, 2)

    def weighted(columns: FloatArray) -> FloatArray:
        return np.asarray((weight @ columns.reshape(*parts, -1)).reshape(6 * K, -1))

    return _scatter_cause(given, models, kind, support, weighted, theta, gain)


def _scatter_cause(
    given: Whitened,
    models: Sequence[Model],
    kind: Kind,
    support: int | None,
    weighted: Callable[[FloatArray], FloatArray],
    theta: float,
    gain: float,
) -> Cause:
    """A variance θ that lowers −2 ln L by `gain`; weighted : columns white with it."""
    rest, K = weighted(given.residual[:, None])[:, 0], len(given.at.own)
    p = [float(chi2_sf(rest @ rest, given.dof))]
    if K:
        each = np.sum(rest.reshape(K, 6) ** 2, axis=1)
        p.append(K * float(chi2_sf(each.max(), 6)))
    for model in models:
        span = basis(weighted(given.white(model.columns)))
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


def _touching(own: FloatArray, postures: Sequence[int]) -> FloatArray:
    """Derivative (6K, 6c) of residual wrenches by a contact wrench in each of c postures."""
    columns = np.zeros((len(own), 6, 6 * len(postures)))
    for place, k in enumerate(postures):
        columns[k, :, 6 * place : 6 * place + 6] = own[k]
    return columns.reshape(-1, columns.shape[2])


def _contacts(given: Whitened, rival: Cause) -> list[Cause]:
    """Contact in one posture each; where none explains all, in more of them, one by one.

    Score and information of a wrench in each come from the suspects' own blocks.
    """
    K = len(given.at.own)
    if K < 2:
        return []
    off = np.sum(given.residual.reshape(K, 6) ** 2, axis=1)
    suspects = np.argsort(off)[::-1][:_SUSPECTS]
    own, (y, M) = given.at.own[suspects], given.unfolded
    score = np.einsum("kba,kb->ka", own, y.reshape(K, 6)[suspects]).ravel()
    common = np.einsum("kba,kbm->kam", own, M.reshape(K, 6, -1)[suspects]).reshape(len(score), -1)
    each = block_diagonal(*np.swapaxes(own, 1, 2) @ own)
    seen = Contrast(each - common @ common.T, score)

    def touched(places: Sequence[int]) -> Cause:
        rows = (6 * np.array(places)[:, None] + np.arange(6)).ravel()
        postures = tuple(sorted(suspects[list(places)].tolist()))
        return explained(given, "contact", *seen.chi2(rows), postures=postures)

    found = [touched([k]) for k in range(len(suspects))]
    places = [int(np.argmax([cause.weight for cause in found]))]
    best = found[places[0]]
    while not best.explains and not rival.explains and len(places) + 1 <= _TOUCHED * K:
        more = [[*places, k] for k in range(len(suspects)) if k not in places]
        if not more:
            break
        best, places = max(((touched(p), p) for p in more), key=lambda one: one[0].weight)
        found.append(best)
    return found
