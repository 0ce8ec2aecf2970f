"""The one mistake in a log without which forces fit that fit nowhere as they are.

Sensors or channels exchanged, an axis of the opposite sign, a sensor or a channel of another unit
or scale, a zero that jumped on the way: each is undone, and of each the cost over all mountings is
searched, everything but the rotations eliminated. A channel's scale is not guessed: its column of
the rotation is left free, and its length says the scale. A jump is a parameter, tried between all
postures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.errors import DataError
from tdfscal.model.parameters import nominal, starting_state
from tdfscal.model.statics import Postures, balance
from tdfscal.model.zero_motion import ZeroMotion
from tdfscal.numerics import so3
from tdfscal.numerics.rotation_descent import descend, stacked
from tdfscal.records import FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import Fit, Priors, spread, statistic
from tdfscal.selfcal.mounting_search import best_start, landscape, robust_cost
from tdfscal.significance import CAUSES_APART

#: A mistake is believed when without it the residuals' variance is below the present one's by
#: this, and not above what is stated by as much.
_BETTER = 9.0
#: Postures that are looked at, at most, evenly spread over the log; mistakes that are fitted.
_POSTURES, _FITTED = 60, 8
#: Postures on either side of a jump.
_FEWEST = 2
#: Steps from each start at most; rounds in which a scale and the weights by it agree.
_DESCENT, _ROUNDS = 40, 3
#: Logarithm of a scale below which it is a sensor's gain, and no mistake.
_GAIN = np.log(1.2)
#: Share of the load that is left after a tare, at most.
_TARED = 0.3


@dataclass(frozen=True, slots=True)
class Misreading:
    """A mistake in the readings, and the fit without it.

    names : what is named otherwise, in words, where that is the mistake. support, axis : whose
    readings are `factor` times what they should be, every axis where None; or whose zero jumped by
    `jump` (3,), N, between the postures `between`, `tared`: to nothing.
    """

    fit: Fit
    names: str = ""
    support: int = 0
    axis: int | None = None
    factor: float = 1.0
    jump: FloatArray | None = None
    between: tuple[int, int] = (0, 0)
    tared: bool = False

    @property
    def misfit(self) -> float:
        """Variance of the residuals in units of the stated one."""
        return spread(self.fit.distance, self.fit.at.rows)

    @property
    def turn(self) -> float:
        """Largest turn of a sensor from its nominal mounting, rad."""
        back = np.swapaxes(nominal(self.fit.rig).rotation, 1, 2)
        return float(np.linalg.norm(so3.log(self.fit.state.rotation @ back), axis=1).max())


@dataclass(frozen=True, slots=True)
class _Undone:
    """The postures without a mistake, named as in `Misreading`; first : posture of a jump."""

    postures: Postures
    names: str = ""
    support: int = 0
    axis: int | None = None
    factor: float = 1.0
    first: int = 0


def likeliest_misreading(
    rig: Rig, observed: Postures, present: Fit, time: FloatArray | None = None
) -> Misreading | None:
    """Look for the one mistake that explains the postures; None where there is none.

    present : the best that can be made of the postures as they are. time : (K,), s, of the
    postures; without it no jump is looked for.
    """
    order = np.arange(len(observed)) if time is None else np.argsort(time, kind="stable")
    some = np.unique(np.linspace(0, len(order) - 1, _POSTURES).round().astype(np.int64))
    seen, misfit = observed.subset(order[some]), spread(present.distance, present.at.rows)
    if misfit < _BETTER:
        return None
    starts = np.stack([nominal(rig).rotation, present.state.rotation])
    undone = [*_renamed(rig, seen), *_in_other_units(rig, seen)]
    undone += _rescaled(rig, seen, starts)
    if time is not None:
        undone += _without_jump(rig, seen)
    cost = [_lowest(_root(rig, each.postures), starts)[1] for each in undone]
    found = []
    for k in np.argsort(cost, kind="stable")[:_FITTED]:
        mistake = _fitted(rig, undone[k], order[some])
        if _BETTER * mistake.misfit < misfit and mistake.misfit < _BETTER:
            found.append(mistake)
    return _likeliest(found) if found else None


def refusal(
    rig: Rig, mistake: Misreading, before: float, number: IntArray, time: FloatArray | None
) -> DataError:
    """The error that names a mistake, its evidence and what to do.

    before : variance of the residuals with it. number, time : (K,), of the postures.
    """
    evidence = (
        f"without it the residuals fall from {np.sqrt(before):.2g} to "
        f"{np.sqrt(mistake.misfit):.2g} times what is stated"
    )
    if mistake.jump is not None:
        return _jump_refused(rig, mistake, evidence, number, time)
    if mistake.names:
        said = f"the forces fit with {mistake.names}, and not as they are named"
    else:
        unit = log_against_rig.unit_of(mistake.factor)
        whose = "every axis" if mistake.axis is None else f"F{'xyz'[mistake.axis]}"
        said = (
            f"{whose} of {rig.supports[mistake.support]} reads {mistake.factor:.3g} times what the "
            f"other sensors ask of it{f', as if it were {unit}' if unit else ''}"
        )
    return DataError(
        f"{said}; {evidence}",
        where="log forces",
        hint="correct the force fields of the log block in rig.yaml, or the cabling"
        if mistake.names
        else "look at the recorder's scaling of that channel, and at its amplifier; correct the "
        "log, or leave the axis out of `axes` in rig.yaml",
    )


def _jump_refused(
    rig: Rig, mistake: Misreading, evidence: str, number: IntArray, time: FloatArray | None
) -> DataError:
    assert mistake.jump is not None
    last, first = mistake.between
    when = f"between postures {number[last]} and {number[first]}"
    if time is not None:
        when += f" ({time[last]:.1f} and {time[first]:.1f} s)"
    jump = ", ".join(f"{value:.3g}" for value in mistake.jump)
    tared = ", as a tare makes it" if mistake.tared else ""
    return DataError(
        f"the zero of {rig.supports[mistake.support]} jumped by ({jump}) N {when}{tared}; "
        f"{evidence}",
        where="log forces",
        hint="give the parts before and after as two campaigns, each in a folder with a rig.yaml "
        "(zeros are each campaign's own), or one of them by --from or --to",
    )


def _root(rig: Rig, seen: Postures) -> FloatArray:
    """Root of the cost over all mountings, as `landscape` has it."""
    start = starting_state(rig, seen.motions)
    at = balance(seen, start, rig.barycentre.value, rig.gravity)
    compressed = statistic(at, np.ones(len(seen)))
    return landscape(rig, at, compressed, start, Priors(rig, seen.motion))


def _lowest(root: FloatArray, starts: FloatArray) -> tuple[FloatArray, float]:
    """Mounting (n, 3, 3) of the lowest cost from some starts, and that cost."""
    found = descend(root, starts, iterations=_DESCENT, tolerance=1e-3)
    best = int(np.argmin(found.cost))
    return found.rotation[best], float(found.cost[best])


def _fitted(rig: Rig, undone: _Undone, order: IntArray) -> Misreading:
    """Fit in full; order : (K,), the numbers of the postures."""
    result = best_start(rig, undone.postures)
    said = Misreading(result, undone.names, undone.support, undone.axis, undone.factor)
    if not undone.first:
        return said
    jump, first = result.state.drift[-1, undone.support], undone.first
    load = undone.postures.force[:first, undone.support].mean(axis=0)
    return replace(
        said,
        jump=jump,
        between=(int(order[first - 1]), int(order[first])),
        tared=bool(np.linalg.norm(load + jump) < _TARED * np.linalg.norm(load)),
    )


def _likeliest(found: list[Misreading]) -> Misreading:
    """The likeliest; among those about as likely the one with the sensors least turned.

    A mirrored axis and two that are exchanged differ by a quarter turn alone.
    """
    scale = min(mistake.misfit for mistake in found)
    cost = [robust_cost(mistake.fit, scale) for mistake in found]
    near = [m for m, own in zip(found, cost, strict=True) if own < min(cost) + CAUSES_APART]
    return min(near, key=lambda mistake: mistake.turn)


def _renamed(rig: Rig, seen: Postures) -> Iterator[_Undone]:
    for ways in (log_against_rig.rewired, log_against_rig.channels_exchanged):
        for words, other in ways(rig, seen):
            yield _Undone(other, words)


def _in_other_units(rig: Rig, seen: Postures) -> Iterator[_Undone]:
    """One sensor whose every axis is in another unit."""
    for i in range(rig.n):
        for factor in log_against_rig.UNITS:
            yield _Undone(_divided(seen, i, None, factor), support=i, factor=factor)


def _divided(seen: Postures, sensor: int, axis: int | None, factor: float) -> Postures:
    """Postures whose readings were too large by a factor; noise never below what is stated."""
    scale, noise = np.ones(seen.measured.shape), np.ones(seen.measured.shape)
    own = slice(None) if axis is None else axis
    scale[sensor, own], noise[sensor, own] = 1 / factor, max(1.0, 1 / abs(factor))
    grown = noise[:, :, None] * noise[:, None, :]
    return replace(seen, force=seen.force * scale, force_cov=seen.force_cov * grown)


def _rescaled(rig: Rig, seen: Postures, starts: FloatArray) -> Iterator[_Undone]:
    """Channels of another scale; of the opposite sign alone they have a name already."""
    for i, a in np.argwhere(rig.axes).tolist():
        other = _scaled(rig, seen, i, a, starts)
        if abs(np.log(abs(other.factor))) > _GAIN:
            yield other


def _scaled(rig: Rig, seen: Postures, i: int, a: int, starts: FloatArray) -> _Undone:
    """A channel of the scale that explains the postures best."""
    factor, own = 1.0, slice(9 * i + a, 9 * i + 9, 3)  # column a of X_i
    undone = seen
    for _ in range(_ROUNDS):
        root = _root(rig, undone)
        free = np.linalg.qr(root[:, own])[0]
        across = root - free @ (free.T @ root)
        rotation, _ = _lowest(across, starts)
        y = stacked(rotation)
        y[own] = 0.0
        column = -np.linalg.lstsq(root[:, own], root @ y, rcond=None)[0]
        scale = float(column @ rotation[i, :, a])
        if not np.isfinite(scale) or scale == 0.0:
            break
        factor /= scale
        undone = _divided(seen, i, a, factor)
    return _Undone(undone, support=i, axis=a, factor=factor)


def _without_jump(rig: Rig, seen: Postures) -> Iterator[_Undone]:
    """Zeros that may have jumped between two postures, which are in the order of time."""
    K = len(seen)
    wide = 10.0 * float(np.median(np.linalg.norm(seen.force, axis=2)))
    for i in range(rig.n):
        for first in range(_FEWEST, K - _FEWEST + 1):
            step = np.zeros((K, rig.n, 1))
            step[first:, i] = 1.0
            motion = ZeroMotion(("step",), step, np.array([wide]))
            if (own := seen.motion) is not None:
                motion = replace(
                    own,
                    kind=(*own.kind, "step"),
                    value=np.concatenate([own.value, step], axis=2),
                    std=np.append(own.std, wide),
                )
            yield _Undone(replace(seen, motion=motion), support=i, first=first)
