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
    COURSES,
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

#: What may happen to one sensor, and the parameters that stand for it.
_SENSOR_CAUSES: dict[Kind, str] = {"sensor turned": "rotation", "zero drifted": "zero"}
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
#: Postures up to which noise that connects them is tried: its work grows with their cube.
_CONNECTED = 60
#: Postures that are tried as in contact, those with the largest residuals.
_SUSPECTS = 20


def causes(given: Whitened) -> Causes:
    """Hold all single causes against each other."""
    models = _models(given)
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
    place, load = layout(at.sensors), ("mass", "barycentre")
    match cause.kind:
        case "sensor turned" | "gain changed":
            assert cause.support is not None
            q = len(cause.std)
            group = "rotation" if cause.kind == "sensor turned" else "sensitivity"
            first = place[group].start + q * cause.support
            return at.columns[:, first : first + q][:, cause.std > 0]
        case "sensors turned":
            return at.columns[:, place["rotation"]]
        case "load changed":
            return np.concatenate([at.columns[:, place[name]] for name in load], axis=1)[
                :, cause.std > 0
            ]
        case "gains changed":
            return _common_gain(at.columns, at.sensors)
        case "base tilted":
            return at.columns[:, place["tilt"]]
        case "contact":
            return _touching(at.own, cause.postures)
    if cause.kind in STEPS:
        assert cause.support is not None
        return _stepping(cause.kind, cause.support, cause.postures[0], at)
    if cause.kind in COURSES:
        shapes = (each for kind, each in _drifts(at) if kind == cause.kind)
        drifts = (_drifting(shape, cause.support, at) for shape in shapes)
        # Of what a shape moves the residuals may tell less than all.
        telling = (columns for columns in drifts if columns.shape[1] >= cause.unknowns)
        return min(telling, key=lambda columns: columns.shape[1])
    return at.columns[:, :0]


def _models(given: Whitened) -> list[Model]:
    place, sensors = layout(given.at.sensors), given.at.sensors
    load = slice(place["mass"].start, place["barycentre"].stop)
    # A gain common to all sensors looks like another mass: whoever weighs the terminal knows.
    found = [
        Model("load changed", None, (), given.columns[:, load]),
        Model("load changed", None, (), given.columns[:, place["mass"]], np.eye(4)[:, :1]),
        Model("gains changed", None, (), _common_gain(given.columns, sensors), _GAINS[0]),
    ]
    for kind, group in _SENSOR_CAUSES.items():
        for i, first in enumerate(range(place[group].start, place[group].stop, 3)):
            columns = given.columns[:, first : first + 3]
            found.append(Model(kind, i, (), columns))
            if group == "zero":
                found += [Model(kind, i, (), columns[:, [a]], np.eye(3)[:, [a]]) for a in range(3)]
    found.append(Model("sensors turned", None, (), given.columns[:, place["rotation"]]))
    if not len(given.at.own):  # in motion the residual is known along these alone
        return found
    found.append(Model("base tilted", None, (), given.columns[:, place["tilt"]]))
    for i, first in enumerate(range(place["sensitivity"].start, place["sensitivity"].stop, 6)):
        columns = given.columns[:, first : first + 6]
        found += [Model("gain changed", i, (), columns @ shape, shape) for shape in _GAINS]
    return found


def _common_gain(columns: FloatArray, sensors: int) -> FloatArray:
    """Derivative (m, 1) by a gain that all sensors have in common."""
    gains = columns[:, layout(sensors)["sensitivity"]]
    return np.asarray(gains.reshape(len(columns), sensors, 6).sum(axis=1) @ _GAINS[0])


def _in_course(given: Whitened) -> Iterator[Model]:
    """Steps of each sensor, from its likeliest posture on, and drifts of its zero or of all."""
    everyone = range(given.at.sensors)
    for kind in STEPS if len(given.at.own) > 1 else ():
        for i in everyone:
            first = _likeliest_step(given, kind, i)
            columns = given.white(_stepping(kind, i, first, given.at))
            yield Model(kind, i, (first,), columns)
    for kind, shape in _drifts(given.at):
        since = shape - shape[np.argmin(given.at.course.time)]
        most = since[np.argmax(np.abs(since[:, :, 0]).max(axis=1))]
        for i in (None, *everyone):
            columns = given.white(_drifting(shape, i, given.at))
            largest = most if i is None else most[[i]]
            back = np.asarray(np.kron(block_diagonal(*largest[:, None]), np.eye(3)), np.float64)
            yield Model(kind, i, (), columns, back)


def _drifts(at: Linearised) -> Iterator[tuple[Kind, FloatArray]]:
    for warm, shape in at.course.drifts(at.sensors) if len(at.own) > 1 else ():
        yield ("zeros follow temperature" if warm else "zeros drift"), shape


def _drifting(shape: FloatArray, support: int | None, at: Linearised) -> FloatArray:
    """Derivative (6K, 3m) by a drift of shape (K, n, g): m = n g of all zeros, g of one."""
    by_zero = at.zero_columns.reshape(len(at.own), 6, at.sensors, 3)
    if support is not None:
        by_zero, shape = by_zero[:, :, [support]], shape[:, [support]]
    return np.asarray(np.einsum("kbna,kng->kbnga", by_zero, shape).reshape(len(at.columns), -1))


def _stepping(kind: Kind, sensor: int, first: int, at: Linearised) -> FloatArray:
    """Derivative (6K, 3) by a sensor's turn, or its zero's jump, from one posture on."""
    begin = layout(at.sensors)[_STEPPING[kind]].start + 3 * sensor
    after = np.repeat(at.course.step(first), 6, axis=0)
    return np.asarray(at.columns[:, begin : begin + 3] * after)


def _likeliest_step(given: Whitened, kind: Kind, sensor: int) -> int:
    """The posture from which on a step lowers χ² most.

    Score and information of every step are sums of its postures' own blocks.
    """
    K, order = len(given.at.own), np.argsort(given.at.course.time, kind="stable")
    y, M = given.unfolded
    begin = layout(given.at.sensors)[_STEPPING[kind]].start + 3 * sensor
    columns = given.at.columns[:, begin : begin + 3]

    def after(other: FloatArray) -> FloatArray:
        """Sums (K, 3, …) over the postures from each one on, in the order of time."""
        each = np.einsum("kba,kbm->kam", columns.reshape(K, 6, 3), other.reshape(K, 6, -1))
        return np.cumsum(each[order][::-1], axis=0)[::-1]

    score, common = after(y), after(M)
    information = after(columns) - common @ np.swapaxes(common, 1, 2)
    seen = np.linalg.pinv(information, rcond=1e-9, hermitian=True)
    gain = np.sum(score * (seen @ score), axis=(1, 2))[1:]
    return int(order[1 + int(np.argmax(gain))])


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
