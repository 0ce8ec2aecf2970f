"""Thresholds of a path without contact, the smallest contacts that exceed them, and what helps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.detection.exceedance import Noise
from tdfscal.detection.noise import MeasuredNoise
from tdfscal.detection.path import Errors
from tdfscal.detection.shares import SOURCES, calibration_variances
from tdfscal.detection.threshold import Places, Watch, quantile
from tdfscal.model.calibrated import Calibrated
from tdfscal.records import BoolArray, FloatArray
from tdfscal.significance import CONTACT_ON_PATH

#: A path in no time that is known counts as so long, s.
UNTIMED = 3600.0
#: Postures that errors of their own are taken to have where they are not drawn one by one.
_MANY = 64.0


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
class Capability(Thresholds):
    """Thresholds with what they come from.

    shares : per source (6,) of the variance that stands against a contact. time : (B,), s.
    calibration_std : (B, 6), what one machine has on it, standard deviation: calibration, zeros and
    postures. seen_from : (B, 6), smallest contact at each time. noise : of each component.
    duration : s, of the path.
    """

    shares: dict[str, FloatArray]
    time: FloatArray
    calibration_std: FloatArray
    seen_from: FloatArray
    noise: tuple[Noise, ...]
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
