"""Thresholds of a path without contact, the smallest contacts that exceed them, and what helps.

Angles, zeros and load of a calibration are correlated, and their errors stand against each other:
their variances do not add up. A source's share is its Shapley value with the variance that knowing
it takes away, Var E[w | sources], averaged over all orders in which they become known (Owen and
Prieur, SIAM/ASA J. Uncertainty Quantification 5, 2017): never negative, and 1 in sum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations
from math import comb

import numpy as np

from tdfscal.detection.noise import MeasuredNoise
from tdfscal.detection.path import Errors
from tdfscal.detection.threshold import Noise, Places, Watch, quantile
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated, redrawn
from tdfscal.model.parameters import layout
from tdfscal.records import BoolArray, FloatArray
from tdfscal.significance import CONTACT_ON_PATH

#: Parameters of each source; what is not named is the rig's geometry, and counts as calibration.
GROUPS = {
    "zeros": ("zero",),
    "load": ("mass", "barycentre"),
    "gain": ("sensitivity",),
}
SOURCES = ("calibration", *GROUPS, "noise")


def calibration_variances(given: Calibrated, jacobian: FloatArray) -> dict[str, FloatArray]:
    """Parts (6,) of the wrench's mean variance over places, by source of the calibration.

    jacobian : (B, 6, P).
    """
    place, P = layout(given.rig.n), len(given.covariance)
    member = np.zeros(P, dtype=np.intp)
    for g, groups in enumerate(GROUPS.values(), 1):
        for name in groups:
            member[place[name]] = g
    scale = np.sqrt(np.diagonal(given.covariance))
    used = scale > 0
    C = given.covariance[np.ix_(used, used)] / np.outer(scale[used], scale[used])
    J = jacobian[:, :, used] * scale[used]
    mean = np.einsum("bcp,bcq->cpq", J, J) / len(J)  # (6, p, p)
    member, count = member[used], 1 + len(GROUPS)
    explained = {}
    for size in range(count + 1):
        for subset in combinations(range(count), size):
            known = np.isin(member, subset)
            gain = np.zeros((len(C), len(C)))
            if known.any():
                cross = C[:, known]
                gain = cross @ np.linalg.pinv(C[np.ix_(known, known)], 1e-9, True) @ cross.T
            explained[subset] = np.einsum("cpq,pq->c", mean, gain)
    parts = {}
    for g, name in enumerate(("calibration", *GROUPS)):
        rest = [other for other in range(count) if other != g]
        parts[name] = sum(
            (
                (explained[tuple(sorted((*subset, g)))] - explained[subset])
                / (count * comb(count - 1, size))
                for size in range(count)
                for subset in combinations(rest, size)
            ),
            np.zeros(6),
        )
    return parts


#: A path in no time that is known counts as so long, s.
UNTIMED = 3600.0
#: Postures that errors of their own are taken to have where they are not drawn one by one.
_MANY = 64.0


@record
class Request:
    """What is asked of a path.

    false_stops : per hour, on each axis. detect : probability with which a contact is seen.
    cutoff : Hz, of the controller's filter; None for none.
    """

    false_stops: float = 0.1
    detect: float = 0.95
    cutoff: float | None = None

    def probability(self, duration: float) -> float:
        """Probability of a false stop on a path of a duration, s, of stops at this rate."""
        return float(-np.expm1(-self.false_stops * duration / 3600.0))


@record
class Thresholds:
    """Per component of the wrench (6,), N and N·m; NaN where nothing bounds it.

    threshold : exceeded on a contact-free path as seldom as is asked. smallest_contact : exceeds it
    with the probability asked for, at any time of the path.
    """

    threshold: FloatArray
    smallest_contact: FloatArray

    @property
    def worst(self) -> tuple[int, ...]:
        """Components with the largest smallest contact: of the force, and of the torque."""
        size = np.where(np.isfinite(self.smallest_contact), self.smallest_contact, -1.0)
        return int(np.argmax(size[:3])), 3 + int(np.argmax(size[3:]))


@record
class Capability(Thresholds):
    """Thresholds with what they come from.

    shares : per source (6,) of the variance that stands against a contact. time : (B,), s.
    calibration_std : (B, 6), what one machine has on it, standard deviation: calibration, zeros and
    postures. seen_from : (B, 6), smallest contact at each time. noise : of each component;
    resting : as it is at stops, else along a motion. duration : s, of the path.
    """

    shares: dict[str, FloatArray]
    time: FloatArray
    calibration_std: FloatArray
    seen_from: FloatArray
    noise: tuple[Noise, ...]
    resting: bool
    duration: float


def assess(
    given: Calibrated, errors: Errors, noise: MeasuredNoise, time: FloatArray, duration: float,
    request: Request,
) -> Capability:  # fmt: skip
    """Find thresholds and smallest contacts along a path of a duration, s, at times (B,), s."""
    components = with_slow(noise.components, errors.slow, duration)
    found = thresholds(errors, components, duration, request)
    std = np.linalg.norm(errors.factor, axis=2)
    std[:, errors.open] = np.inf
    total = np.hypot(std, [one.std for one in components])
    seen_from = found.threshold + quantile(request.detect) * total
    return Capability(
        found.threshold,
        found.smallest_contact,
        _shares(given, errors, components),
        time,
        std,
        seen_from,
        components,
        noise.resting,
        duration,
    )


def with_slow(
    components: tuple[Noise, ...], slow: FloatArray, duration: float
) -> tuple[Noise, ...]:
    """Add a variance (6,) that changes from posture to posture, of which there are many."""
    out = []
    for one, more in zip(components, slow, strict=True):
        variance = one.slow**2 + more
        if variance > 0:
            hold = duration / _MANY
            rate = (one.slow**2 / one.relaxation + more / hold) / variance
            one = replace(one, slow=float(np.sqrt(variance)), relaxation=float(1.0 / rate))
        out.append(one)
    return tuple(out)


def thresholds(
    errors: Errors,
    components: tuple[Noise, ...],
    duration: float,
    request: Request,
    which: Sequence[int] = range(6),
) -> Thresholds:
    """Find the thresholds and the smallest contacts of some of the components."""
    limit, contact = np.full(6, np.nan), np.full(6, np.nan)
    for c, watch in enumerate(watches(errors, components, duration)):
        if watch is not None and c in which:
            limit[c] = watch.threshold(request.probability(duration))
            contact[c] = watch.smallest_contact(limit[c], request.detect)
    return Thresholds(limit, contact)


def watches(errors: Errors, components: tuple[Noise, ...], duration: float) -> list[Watch | None]:
    """Each component over the path; None where nothing bounds it."""
    factor = errors.factor
    weight = np.ones(len(factor))
    return [
        None if unbounded else Watch(Places.of(factor[:, c], weight, one.std), one, duration)
        for c, (one, unbounded) in enumerate(zip(components, errors.open, strict=True))
    ]


def beyond_contact_free(
    errors: Errors, found: Capability, largest: FloatArray
) -> tuple[BoolArray, FloatArray]:
    """Components whose largest wrench (6,) no path without contact shows, and what it may show.

    largest : of the filtered log, N and N·m.
    """
    limit = found.threshold.copy()
    every = watches(errors, found.noise, found.duration)
    for c, watch in enumerate(every):
        if watch is not None and largest[c] > limit[c]:
            limit[c] = watch.threshold(CONTACT_ON_PATH / len(every))
    return np.asarray(largest > limit), limit


def _shares(
    given: Calibrated, errors: Errors, components: tuple[Noise, ...]
) -> dict[str, FloatArray]:
    parts = calibration_variances(given, errors.linear.jacobian)
    parts["zeros"] = parts["zeros"] + np.mean(np.sum(errors.zeros**2, axis=2), axis=0)
    parts["noise"] = np.mean(np.sum(errors.postures**2, axis=2), axis=0)
    parts["noise"] = parts["noise"] + [one.std**2 for one in components]
    total = np.sum([parts[source] for source in SOURCES], axis=0)
    share = {
        source: np.divide(parts[source], total, out=np.zeros(6), where=total > 0)
        for source in SOURCES
    }
    for each in share.values():
        each[errors.open] = np.nan
    return share


#: Gain from which on a remedy is worth a word, as a share of the contact.
_WORTH = 0.1
#: Time that the terminal hangs free before a run for its wrench to be set to zero, s.
_HELD = 3.0


@record
class Remedy:
    """One thing done, and the smallest contacts (6,) that would be seen then, N and N·m.

    Of the worst force and the worst torque; NaN for the others.

    kind : `tare` (each sensor, as the rig file states its zeros), `set-to-zero` (the wrench, where
    the path begins), `filter` (at `value`, Hz), `weigh`, `calibrate` (with half the uncertainty).
    """

    kind: str
    smallest_contact: FloatArray
    value: float | None = None

    def ratio(self, now: FloatArray) -> float:
        """Contact then over the contact (6,) now, geometric mean over the components."""
        known = np.isfinite(now) & np.isfinite(self.smallest_contact) & (now > 0)
        return float(np.exp(np.mean(np.log(self.smallest_contact[known] / now[known]))))


def remedies(
    given: Calibrated, errors: Errors, noise: Callable[[float | None], MeasuredNoise],
    now: Thresholds, duration: float, request: Request, *, filtered_to: float | None,
) -> tuple[Remedy, ...]:  # fmt: skip
    """Work out what each remedy brings; those worth a word, the best first.

    noise : of the wrench behind a filter of that cut-off. filtered_to : Hz, a lower cut-off to try.
    """
    which = now.worst
    here = with_slow(noise(request.cutoff).components, errors.slow, duration)
    tried: list[tuple[str, float | None, Errors, tuple[Noise, ...]]] = [
        (kind, None, other, here)
        for kind, other in _changed(given, errors, [one.std for one in here])
    ]
    if filtered_to is not None:
        quiet = with_slow(noise(filtered_to).components, errors.slow, duration)
        tried.append(("filter", filtered_to, errors, quiet))
    before, found = _spread(errors, here), []
    for kind, value, other, components in tried:
        after = _spread(other, components)
        if all(after[c] > (1.0 - _WORTH) * before[c] for c in which):
            continue
        better = thresholds(other, components, duration, request, which)
        found.append(Remedy(kind, better.smallest_contact, value))
    worth = [one for one in found if one.ratio(now.smallest_contact) < 1.0 - _WORTH]
    return tuple(sorted(worth, key=lambda one: one.ratio(now.smallest_contact)))


def _spread(errors: Errors, components: tuple[Noise, ...]) -> FloatArray:
    """Standard deviation (6,) of what stands on the wrench, where that is most."""
    largest = np.linalg.norm(errors.factor, axis=2).max(axis=0)
    return np.asarray(np.hypot(largest, [one.std for one in components]))


def _changed(given: Calibrated, errors: Errors, noise: list[float]) -> Iterator[tuple[str, Errors]]:
    """What would stand on the wrench after each of them."""
    rig, J = given.rig, errors.linear.jacobian
    if np.isfinite(rig.zero.std[rig.axes]).all():
        fresh = redrawn(given, zero=(given.state.zero, np.diag(rig.zero.std.ravel() ** 2)))
        none = errors.zeros[:, :, :0]
        yield "tare", replace(errors, calibration=J @ fresh.root, zeros=none)
    together = np.concatenate([errors.calibration, errors.zeros], axis=2)
    first = together[0]
    own = np.square(errors.postures[0]).sum(axis=1) + np.square(noise) / _HELD
    shown = first @ first.T + np.diag(np.maximum(own, 1e-12 * np.square(first).sum()))
    rest = np.eye(first.shape[1]) - first.T @ np.linalg.solve(shown, first)
    values, vectors = np.linalg.eigh((rest + rest.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    yield "set-to-zero", replace(errors, calibration=together @ root, zeros=together[:, :, :0])
    place, known = layout(rig.n), np.zeros(len(given.covariance), dtype=np.bool_)
    for name in GROUPS["load"]:
        known[place[name]] = True
    known &= np.diagonal(given.covariance) > 0
    if known.any():
        half = given.root
        weighed = half[known]
        left = np.eye(half.shape[1]) - np.linalg.pinv(weighed) @ weighed
        yield "weigh", replace(errors, calibration=errors.calibration @ left)
    yield "calibrate", replace(errors, calibration=errors.calibration / 2.0)
