"""Thresholds of a path without contact, and the smallest contacts that exceed them.

Angles, zeros and load of a calibration are correlated, and their errors stand against each other:
their variances do not add up. A source's share is its Shapley value with the variance that knowing
it takes away, Var E[w | sources], averaged over all orders in which they become known (Owen and
Prieur, SIAM/ASA J. Uncertainty Quantification 5, 2017): never negative, and 1 in sum.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from tdfscal.detection.noise import MeasuredNoise
from tdfscal.detection.path import Errors
from tdfscal.detection.threshold import Noise, Places, Watch
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated
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
    member, names = member[used], ("calibration", *GROUPS)
    explained, orders = dict[frozenset[int], FloatArray](), list(permutations(range(len(names))))
    for subset in {frozenset(order[:k]) for order in orders for k in range(len(names) + 1)}:
        known, gain = np.isin(member, list(subset)), np.zeros((len(C), len(C)))
        if known.any():
            cross = C[:, known]
            gain = cross @ np.linalg.pinv(C[np.ix_(known, known)], 1e-9, True) @ cross.T
        explained[subset] = np.einsum("cpq,pq->c", mean, gain)
    parts = {name: np.zeros(6) for name in names}
    for order in orders:
        for k, g in enumerate(order):
            gained = explained[frozenset(order[: k + 1])] - explained[frozenset(order[:k])]
            parts[names[g]] += gained / len(orders)
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
class Capability:
    """Thresholds with what they come from.

    threshold : (6,), N and N·m, exceeded on a contact-free path as seldom as is asked;
    smallest_contact : exceeds it with the probability asked for, at any time of the path; NaN where
    nothing bounds it. shares : per source (6,) of the variance that stands against a contact.
    calibration_std : (B, 6), what one machine has on it, standard deviation: calibration, zeros and
    postures. noise : of each component; resting : as it is at stops, else along a motion.
    duration : s, of the path.
    """

    threshold: FloatArray
    smallest_contact: FloatArray
    shares: dict[str, FloatArray]
    calibration_std: FloatArray
    noise: tuple[Noise, ...]
    resting: bool
    duration: float

    @property
    def worst(self) -> tuple[int, ...]:
        """Components with the largest smallest contact: of the force, and of the torque."""
        size = np.where(np.isfinite(self.smallest_contact), self.smallest_contact, -1.0)
        return int(np.argmax(size[:3])), 3 + int(np.argmax(size[3:]))


def assess(
    given: Calibrated, errors: Errors, noise: MeasuredNoise, duration: float, request: Request
) -> Capability:  # fmt: skip
    """Find thresholds and smallest contacts along a path of a duration, s."""
    components = with_slow(noise.components, errors.slow, duration)
    limit, contact = np.full(6, np.nan), np.full(6, np.nan)
    for c, watch in enumerate(watches(errors, components, duration)):
        if watch is not None:
            limit[c] = watch.threshold(request.probability(duration))
            contact[c] = watch.smallest_contact(limit[c], request.detect)
    std = np.linalg.norm(errors.factor, axis=2)
    std[:, errors.open] = np.inf
    return Capability(
        limit,
        contact,
        _shares(given, errors, components),
        std,
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


def more_false_stops(errors: Errors, found: Capability, moved: FloatArray) -> BoolArray:
    """Components (6,) that a wrench (6,) which stays takes beyond twice the false stops asked for.

    A Gaussian of variance σ² crosses a level u that lies δ nearer or farther by cosh(u δ / σ²)
    times as often.
    """
    variance = np.mean(np.sum(errors.factor**2, axis=2), axis=0)
    variance = variance + [one.std**2 for one in found.noise]
    exponent = found.threshold * moved / np.maximum(variance, np.finfo(np.float64).tiny)
    return np.asarray(exponent > np.arccosh(2.0))


def _shares(
    given: Calibrated, errors: Errors, components: tuple[Noise, ...]
) -> dict[str, FloatArray]:
    parts = calibration_variances(given, errors.linear.jacobian)
    parts["zeros"] = parts["zeros"] + np.mean(np.sum(errors.zeros**2, axis=2), axis=0)
    parts["noise"] = np.mean(np.sum(errors.postures**2, axis=2), axis=0)
    parts["noise"] = parts["noise"] + [one.std**2 for one in components]
    total = np.sum([parts[source] for source in SOURCES], axis=0)
    told = np.where(errors.open, np.nan, np.maximum(total, np.finfo(np.float64).tiny))
    return {source: parts[source] / told for source in SOURCES}
