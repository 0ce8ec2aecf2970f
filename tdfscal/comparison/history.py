"""The life of a rig: angles of every check, their path, alarms, when to calibrate next.

A calibration that stands on an earlier one counts only with what its own data added.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from tdfscal.comparison.common import Intensity, Walk, intensity
from tdfscal.comparison.compatibility import smallest_changes
from tdfscal.comparison.control_chart import WINDOWS, Alarm, Check, Watching
from tdfscal.comparison.members import added_to
from tdfscal.comparison.pooling import Pool
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import of_load, turned
from tdfscal.model.parameters import EVEN_TURN, State
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.numerics.information import Information, p_value
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.significance import (
    ALARMS_PER_YEAR,
    DETECTION_POWER,
    INCOMPATIBLE,
    INTERVAL_COVERAGE,
    LONGEST_INTERVAL,
    MISFIT,
)

#: Fewer checks, or all within a day (months), say nothing of a walk.
_FEWEST_FOR_WALK, _ONE_DAY = 4, 1 / 30.44
#: What a history shows is taken to go on for so many times its own length, at most for the longest
#: interval between calibrations.
_FORESEEN = 2.0


@record
class Due:
    """When the largest standard uncertainty of a turn may meet the limit.

    By the upper ends of the 95 % intervals of walk and creep, or the declared walk where it is
    larger. month : None beyond what the history foresees, or where nothing tells of any walk.
    earliest : the same month; where it lies beyond, how far the history foresees; None where
    nothing tells. foreseen : month until which the history is taken to go on as it was. sensor :
    whose turn it is. now : rad, today's.
    """

    month: float | None
    earliest: float | None
    foreseen: float
    sensor: int
    now: float
    limit: float


@record
class Life:
    """A rig's history in K checks of n sensors, in the order of time.

    rpy, rpy_std : (K, n, 3), rad, what each check says by itself once all together have fixed
    hinges and datums; seen : (K, n), whether it says anything of that sensor.
    path, path_std : (K, n, 3), rad, roll, pitch, yaw of the smoothed path. mean, limit : (K, n, 3),
    weighted mean between alarms and the half width outside which one angle alone is surprising.
    level, smallest : of `Watching`. jumps : variance (C,) before each check by which
    the alarms free the constants. birge : by which all uncertainties were scaled. detectable :
    (n, 3), rad, smallest change of each angle alone that the last check by itself would have shown
    with probability `significance.DETECTION_POWER`.
    """

    supports: tuple[str, ...]
    names: tuple[str, ...]
    month: FloatArray
    seen: BoolArray
    rpy: FloatArray
    rpy_std: FloatArray
    path: FloatArray
    path_std: FloatArray
    mean: FloatArray
    limit: FloatArray
    alarms: tuple[Alarm, ...]
    level: FloatArray
    smallest: FloatArray
    jumps: tuple[FloatArray, ...]
    rate: float
    declared: float
    walk: Intensity | None
    birge: float
    due: Due
    detectable: FloatArray

    @property
    def known(self) -> BoolArray:
        """Sensors (n,) of which any check says anything; the others have no angles."""
        return np.asarray(self.seen.any(axis=0))

    @property
    def n(self) -> int:
        """Number of sensors."""
        return len(self.supports)


def live(
    rig: Rig,
    reference: State,
    prior: Information,
    checks: Sequence[Check],
    *,
    rate: float,
    birge: float = 1.0,
) -> Life:
    """Go through a rig's checks, in the order of time.

    Parameters
    ----------
    rig : the latest; its `drift.angle` is the walk that is no alarm.
    reference : constants from which the checks' information is counted.
    prior : what the rig file states of the constants.
    rate : false alarms per year.
    birge : ratio of all fits behind the checks, which scales them.

    Returns
    -------
    Life : two checks or more.
    """
    gaps = np.diff([c.month for c in checks], prepend=checks[0].month)
    checks = [replace(c, own=c.own.beside(prior).scaled(birge)) for c in checks]
    own, n, R = [check.own for check in checks], rig.n, reference.rotation

    def steps(walk: float) -> list[FloatArray]:
        size = len(prior.score)
        wide = (walk * float(np.sqrt(max(gap, 0.0))) for gap in gaps)
        return [turned(rig, q, size) + c.moved for q, c in zip(wide, checks, strict=True)]

    watch = Watching(checks, prior, steps(rig.drift.angle), n, rate).run()
    jumps = [a - b for a, b in zip(watch.walk, steps(rig.drift.angle), strict=True)]

    def jumping(walk: float) -> list[FloatArray]:
        return [a + b for a, b in zip(steps(walk), jumps, strict=True)]

    walk = None
    if len(checks) >= _FEWEST_FOR_WALK and gaps.sum() > _ONE_DAY:
        walk = intensity(lambda q: Walk(own, prior, jumping(q)).log_likelihood())
    used = max(rig.drift.angle, walk.value if walk else 0.0)
    rest, still = (Walk(own, prior, jumping(q)).others() for q in (used, 0.0))
    alone = _told(
        (
            (a.walked(turned(rig, EVEN_TURN, len(prior.score))), b)
            for a, b in zip(rest, own, strict=True)
        ),
        R,
    )
    path, mean = (_told(zip(known, own, strict=True), R) for known in (rest, still))
    z = normal_quantile(1 - watch.level / (2 * 3 * n))[:, None, None]
    width = np.einsum("iab,kib->kia", so3.rpy_jacobian(R) ** 2, alone.std**2 + mean.std**2)
    seen = np.asarray(alone.std.max(axis=2) < 0.3 * EVEN_TURN)
    return Life(
        supports=rig.supports,
        names=tuple(check.name for check in checks),
        month=np.array([check.month for check in checks]),
        seen=seen,
        rpy=alone.rpy,
        rpy_std=alone.rpy_std,
        path=path.rpy,
        path_std=path.rpy_std,
        mean=mean.rpy,
        limit=z * np.sqrt(width),
        alarms=tuple(watch.alarms),
        level=watch.level,
        smallest=watch.smallest,
        jumps=tuple(jumps),
        rate=rate,
        declared=rig.drift.angle,
        walk=walk,
        birge=birge,
        due=_due(
            (checks[0].month, checks[-1].month),
            rig.acceptance.angle_std,
            np.where(np.any(seen, axis=0)[:, None], path.std[-1], 0.0),
            _pace(watch.alarms, n),
            rig.drift.angle,
            walk,
        ),
        detectable=smallest_changes(R, watch.departure, 3, watch.level[-1] * WINDOWS[1] / n),
    )


@record
class _Told:
    """Std of turns, rad, BCS, and the angles that the turns make; all (K, n, 3)."""

    std: FloatArray
    rpy: FloatArray
    rpy_std: FloatArray


def _told(known: Iterable[tuple[Information, Information]], R: FloatArray) -> _Told:
    """What each check's own information and that of the others, added, say of the turns."""
    n, turned_to, stds, variances = len(R), [], [], []
    for others_say, own in known:
        state = others_say + own
        C = state.covariance[: 3 * n]
        now = so3.exp((C @ state.score).reshape(n, 3)) @ R
        turned_to.append(so3.to_rpy(now))
        stds.append(np.sqrt(np.diagonal(C)).reshape(n, 3))
        variances.append(so3.rpy_variance(now, C[:, : 3 * n]))
    return _Told(np.array(stds), np.array(turned_to), np.sqrt(variances))


def _due(
    span: tuple[float, float],
    limit: float,
    path_std: FloatArray,
    pace: FloatArray,
    declared: float,
    walk: Intensity | None,
) -> Due:
    """When the first sensor's u² + q² t + (v t)² reaches the limit's, t months from the last check.

    span : months of the first and the last check. path_std : (n, 3), rad, now. pace : (n,), v, rad
    per month, largest of sensors that creep. q : the largest walk that the history allows.
    """
    first, last = span
    largest = path_std.max(axis=1)
    room = np.maximum(limit**2 - largest**2, 0.0)
    q = max(declared, walk.high if walk else 0.0)
    # The root of (v t)² + q² t = room, in the form that is right for v = 0 too.
    slower = q**2 + np.sqrt(q**4 + 4 * pace**2 * room)
    waits = np.full(len(room), np.inf)
    np.divide(2 * room, slower, out=waits, where=slower > 0)
    waits[room == 0.0] = 0.0
    sensor = int(np.argmin(waits)) if np.isfinite(waits).any() else int(np.argmax(largest))
    foreseen = last + min(_FORESEEN * (last - first), LONGEST_INTERVAL)
    month: float | None = last + float(waits[sensor])
    earliest = month
    if month is not None and month > foreseen:
        told = walk is not None or declared > 0 or bool(pace.any())
        month, earliest = None, foreseen if told else None
    return Due(month, earliest, foreseen, sensor, float(largest[sensor]), limit)


def _pace(alarms: Sequence[Alarm], n: int) -> FloatArray:
    """Largest speed (n,), rad per month, of the sensors whose last alarm is a creep."""
    pace, above = np.zeros(n), normal_quantile((1 + INTERVAL_COVERAGE) / 2)
    for alarm in alarms:
        if alarm.sensor is None:
            continue
        pace[alarm.sensor] = 0.0
        if alarm.kind == "creep" and alarm.size > 0:
            pace[alarm.sensor] = alarm.size + above * alarm.size_std
    return pace


def life_of(rig: Rig, pooled: Pool) -> tuple[Life, list[Finding]]:
    """Go through a pool's checks; and say which count with their own scatter."""
    shared, prior, checks = pooled.common, pooled.walk.prior, list[Check]()
    fits, told = list[tuple[float, int]](), _determined(rig, pooled)
    for k, m in enumerate(pooled.members):
        own = m.own if told.all() else added_to(rig, m.own + prior, prior, told)
        load = shared.places[k][of_load(shared.rigs[k])]
        checks.append(Check(m.name, m.month, own, load, pooled.moved[k]))
        fits.append(replace(m, reduced=replace(m.reduced, information=own)).within(prior))
    birge = _scatter(fits)
    least = float(birge.min())
    noisy = [
        Finding("campaign-noisy", (check.name,), float(ratio))
        for check, ratio in zip(checks, birge, strict=True)
        if ratio > least
    ]
    scaled = [replace(c, own=c.own.scaled(b / least)) for c, b in zip(checks, birge, strict=True)]
    return live(rig, pooled.reference, prior, scaled, rate=ALARMS_PER_YEAR, birge=least), noisy


def turn_suspected(life: Life, checks: int) -> Iterator[Finding]:
    """A turn that raises no alarm, of which the last checks speak, since the first of the history.

    Alarms are as seldom as a year's are stated to be. Each of the new checks is also held against
    those before it, all together at the level of a comparison.
    """
    p = np.min(life.smallest[-checks:], axis=0) * WINDOWS[1] * checks
    if not life.alarms and p.min() < INCOMPATIBLE:
        sensor, values = life.supports[int(np.argmin(p))], {"since": life.names[0]}
        yield Finding("turn-suspected", (sensor,), p_value=float(p.min()), values=values)


def turns_visible(life: Life) -> Iterator[Finding]:
    """From which size on a turn since the first check would have raised an alarm at the last."""
    if np.isfinite(least := life.detectable[life.known]).any():
        visible, told = float(np.max(least)), {"power": DETECTION_POWER}
        yield Finding("turns-visible", life.names[:1], visible, "rad", values=told)


def _birge(fits: Sequence[tuple[float, int]]) -> float:
    """Birge ratio of fits together, never below 1: understated noise is no turned sensor."""
    dof = sum(count for _, count in fits)
    return max(1.0, float(np.sqrt(sum(chi2 for chi2, _ in fits) / dof))) if dof else 1.0


def _scatter(fits: Sequence[tuple[float, int]]) -> FloatArray:
    """Birge ratio (K,) by which each campaign counts: the common one, but a noisy one's its own.

    A noisy month neither passes for a turned sensor nor widens the others.
    """
    noisy = np.array([p_value(fit) < MISFIT / len(fits) for fit in fits])
    common = _birge([fit for fit, own in zip(fits, noisy, strict=True) if not own])
    return np.array([_birge([f]) if own else common for f, own in zip(fits, noisy, strict=True)])


def _determined(rig: Rig, pooled: Pool) -> BoolArray:
    """Sensors (n,) that campaigns together determine, or that lack no axis in any of them."""
    whole = np.all([one.axes.all(axis=1) for one in pooled.common.rigs], axis=0)
    last = pooled.posterior(len(pooled.members) - 1)
    std = np.sqrt(np.diagonal(last.covariance)[: 3 * rig.n]).reshape(-1, 3)
    return np.asarray(whole | (std.max(axis=1) < rig.acceptance.identifiable))
