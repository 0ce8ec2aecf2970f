"""What would make a smaller contact be seen: the same path again with one thing done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.detection.capability import Request, Thresholds, thresholds, with_slow
from tdfscal.detection.exceedance import Noise
from tdfscal.detection.noise import MeasuredNoise
from tdfscal.detection.path import Errors
from tdfscal.detection.shares import GROUPS
from tdfscal.model.calibrated import Calibrated, redrawn
from tdfscal.model.parameters import layout
from tdfscal.records import FloatArray

#: Gain from which on a remedy is worth a word, as a share of the contact.
_WORTH = 0.1
#: Time that the terminal hangs free before a run for its wrench to be set to zero, s.
_HELD = 3.0


@dataclass(frozen=True, slots=True)
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
