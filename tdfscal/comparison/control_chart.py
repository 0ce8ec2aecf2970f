"""Control chart of a rig's sensors: steps, creep, and alarms with a stated rate per year.

Every check (a calibration, or a campaign) is held against all before it. A sensor's step is asked
for by the last check, and by the last three together, against those before them; its creep by an
exponentially weighted sum (EWMA; Lowry et al., Technometrics 34, 1992) of what each check departs
from the prediction. Both are χ² of a turn of that one sensor, with all other constants of the rig
free to be what they are. The rate is spent evenly over time and shared among the tests of a check
(Bonferroni), so that a year raises as many false alarms with daily checks as with monthly ones; the
tests overlap, so that the sum of their levels may be more than the rate (`COMES_TRUE`).
After a step the sensor's past counts no more, a creep is followed, and the search goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tdfscal.model.parameters import EVEN_TURN
from tdfscal.numerics.information import Contrast, Information, contrast, nothing, p_value
from tdfscal.records import FloatArray

#: Checks that speak together against those before them, each with its share of the alarm level.
WINDOWS = {1: 0.45, 3: 0.35}
#: Shares of the sum for creep, and of all sensors together; the windows' are shared by sensors too.
OF_CREEP, OF_ALL = 0.15, 0.05
#: Of the sum of all levels, what comes true as false alarms, since the tests are much alike:
#: measured 0.62 to 0.71 of the sensors' tests, and 0.76 ± 0.09 of all of them at the default rate
#: (`benchmarks.life`).
COMES_TRUE = 0.8
#: Share by which a check's departure counts less with each check after it.
FORGETTING = 0.2
#: A month of 1/12 year; the rate of a check spends at least a day's and at most a year's share.
_MONTHS = 12.0
_SHORTEST = 1 / 30.4375
#: A ramp must explain a departure by so much χ² more than a step to be called one.
_RAMP_BETTER = 4.0
#: And must have begun so many checks before the last: two checks of a ramp are a step and noise.
_RAMP_CHECKS = 2
#: Two steps have three unknowns and a date more than one creep: they must explain so much more.
_TWO_STEPS_COST = 12.0
#: Onsets that are tried for naming, in checks back.
_BACK = 48

Kind = Literal["step", "creep"]


@dataclass(frozen=True, slots=True)
class Check:
    """What one calibration, or one campaign, says of the constants (C,); rotations first.

    month : date of measurement in months from any instant.
    """

    name: str
    month: float
    own: Information


@dataclass(frozen=True, slots=True)
class Alarm:
    """A sensor that turned.

    sensor : its index; None where all together depart and no single one explains it.
    raised, onset : indices of the checks that raised it, and with which it began.
    turn : (3,), rad, BCS; of a creep, per month. std : (3,), its standard uncertainty.
    p_value : that a sound rig departs as much at this check, in any of its tests.
    """

    kind: Kind
    sensor: int | None
    raised: int
    onset: int
    turn: FloatArray
    std: FloatArray
    p_value: float


@dataclass(frozen=True, slots=True)
class Watch:
    """The result of going through a history.

    alarms : in the order in which they were raised. steps : variance (C,) of the walk before each
    check, the jumps of the alarms included. level : (K,), of a check, all its tests together.
    smallest : (K, n), least p-value of a sensor's tests at each check, among all the check's tests;
    1 at the first.
    """

    alarms: tuple[Alarm, ...]
    steps: tuple[FloatArray, ...]
    level: FloatArray
    smallest: FloatArray


@dataclass(frozen=True, slots=True)
class _Sum:
    """EWMA of one sensor: score (3,) and its variance (3, 3)."""

    score: FloatArray
    variance: FloatArray

    def with_next(self, departure: Contrast, where: slice) -> _Sum:
        keep = 1 - FORGETTING
        return _Sum(
            keep * self.score + departure.score[where],
            keep**2 * self.variance + departure.matrix[where, where],
        )

    @property
    def p_value(self) -> float:
        return p_value(Contrast(self.variance, self.score).chi2())


_NO_SUM = _Sum(np.zeros(3), np.zeros((3, 3)))


class Watching:
    """Goes through the checks in the order of time."""

    def __init__(
        self,
        checks: Sequence[Check],
        prior: Information,
        steps: Sequence[FloatArray],
        sensors: int,
        rate: float,
    ) -> None:
        self.checks, self.prior, self.n = checks, prior, sensors
        self.own = [check.own for check in checks]
        self.steps = [step.copy() for step in steps]
        self.start = [0] * sensors
        self.sums: list[list[_Sum]] = []
        self.before: list[Information] = []
        self.alarms: list[Alarm] = []
        months = np.array([check.month for check in checks])
        spent = np.clip(np.diff(months, prepend=months[0]), _SHORTEST, _MONTHS) / _MONTHS
        self.level = rate * spent
        self.smallest = np.ones((len(checks), sensors))

    def run(self) -> Watch:
        """Return the alarms and the walk with their jumps."""
        for k in range(len(self.checks)):
            self._filter(k)
            if k == 0:
                continue
            first = True
            while (found := self._worst(k, note=first)) is not None:
                self._raise(k, *found)
                first = False
        return Watch(self._refined(), tuple(self.steps), self.level, self.smallest)

    def _filter(self, k: int) -> None:
        """What is known before check k, and the sums with it."""
        del self.before[k:], self.sums[k:]
        if k == 0:
            self.before.append(self.prior)
            self.sums.append([_NO_SUM] * self.n)
            return
        self.before.append((self.before[k - 1] + self.own[k - 1]).walked(self.steps[k]))
        departure = contrast(self.before[k], self.own[k])
        self.sums.append(
            [
                _NO_SUM if self.start[i] >= k else total.with_next(departure, _turn(i))
                for i, total in enumerate(self.sums[k - 1])
            ]
        )

    def _since(self, k: int, last: int) -> Information:
        """What checks k … last say of the constants at k."""
        now = nothing(len(self.prior.score))
        for j in range(last, k - 1, -1):
            now = now + self.own[j]
            if j > k:
                now = now.walked(self.steps[j])
        return now

    def _worst(self, k: int, *, note: bool) -> tuple[float, int | None] | None:
        """Least p-value below the level at check k, and its sensor."""
        found: list[tuple[float, int | None]] = []
        for i in range(self.n):
            tests = [self.sums[k][i].p_value / OF_CREEP]
            for size, share in WINDOWS.items():
                if (onset := k - size + 1) > self.start[i]:
                    apart = contrast(self.before[onset], self._since(onset, k))
                    tests.append(p_value(apart.chi2(_turn(i))) / share)
            least = min(1.0, COMES_TRUE * self.n * min(tests))
            if note:
                self.smallest[k, i] = least
            found.append((least, i))
        p, sensor = min(found)
        if p <= self.level[k]:
            return p, sensor
        every = COMES_TRUE * p_value(contrast(self.before[k], self.own[k]).chi2()) / OF_ALL
        return (every, None) if note and every <= self.level[k] else None

    def _raise(self, k: int, p: float, sensor: int | None) -> None:
        if sensor is None:
            turn = np.zeros(3)
            self.alarms.append(Alarm("step", None, k, k, turn, turn, p))
            return
        kind, onset, turn, std = self._name(k, sensor)
        earlier = next((a for a in reversed(self.alarms) if a.sensor == sensor), None)
        if earlier is not None and earlier.kind == "step":
            creep = self._one_creep(k, earlier, onset)
            if creep is not None:  # what seemed a step was the beginning of it
                self.alarms.remove(earlier)
                kind, (onset, turn, std), p = "creep", creep, earlier.p_value
        self.alarms.append(Alarm(kind, sensor, k, onset, turn, std, p))
        self.start[sensor] = onset
        if kind == "step":  # what was known of the sensor holds no more
            self.steps[onset][_turn(sensor)] += EVEN_TURN**2
        else:  # it is followed from here on, at up to twice this speed
            pace = 2 * float(np.linalg.norm(turn))
            for j in range(onset, len(self.checks)):
                gap = self.checks[j].month - self.checks[j - 1].month
                self.steps[j][_turn(sensor)] += (pace * gap) ** 2
        for j in range(onset, k + 1):
            self._filter(j)

    def _name(self, k: int, sensor: int) -> tuple[Kind, int, FloatArray, FloatArray]:
        """Step or creep, since when, how far: what explains the checks up to k best."""
        first = max(self.start[sensor], k - _BACK)
        step = self._best(first, k, sensor, self._step)
        if k - first > _RAMP_CHECKS:
            ramp = self._best(first, k, sensor, self._ramp, until=k - _RAMP_CHECKS)
            if ramp[0] > step[0] + _RAMP_BETTER:
                return "creep", *ramp[1:]
        return "step", *step[1:]

    def _one_creep(
        self, k: int, earlier: Alarm, onset: int
    ) -> tuple[int, FloatArray, FloatArray] | None:
        """Onset, turn per month and std of a creep that does as well as two steps, if one does."""
        assert earlier.sensor is not None
        sensor, first = earlier.sensor, max(0, earlier.onset - _BACK)
        two = [(sensor, self._step(earlier.onset, k)), (sensor, self._step(onset, k))]
        stepped = self._explains(first, k, two)[0]
        ramp = self._best(first, k, sensor, self._ramp)
        return ramp[1:] if ramp[0] > stepped - _TWO_STEPS_COST else None

    def _refined(self) -> tuple[Alarm, ...]:
        """Give each alarm the size, and a creep the onset, that all checks until the next say."""
        refined = []
        for alarm in self.alarms:
            if alarm.sensor is None:
                refined.append(alarm)
                continue
            own = sorted(a.onset for a in self.alarms if a.sensor == alarm.sensor)
            place = own.index(alarm.onset)
            last = own[place + 1] - 1 if place + 1 < len(own) else len(self.checks) - 1
            first = max(own[place - 1] if place else 0, last - _BACK)
            if first >= alarm.onset or last < alarm.onset:
                refined.append(alarm)
            elif alarm.kind == "creep":
                _, onset, turn, std = self._best(first, last, alarm.sensor, self._ramp)
                onset = min(onset, alarm.raised)
                refined.append(replace(alarm, onset=onset, turn=turn, std=std))
            else:
                shape = self._step(alarm.onset, last)
                _, turn, std = self._explains(first, last, [(alarm.sensor, shape)])
                refined.append(replace(alarm, turn=turn, std=std))
        return tuple(refined)

    def _step(self, onset: int, k: int) -> FloatArray:
        return (np.arange(k + 1) >= onset).astype(np.float64)

    def _ramp(self, onset: int, k: int) -> FloatArray:
        months = np.array([check.month for check in self.checks[: k + 1]])
        return np.asarray(np.maximum(months - months[onset - 1], 0.0))

    def _best(
        self,
        first: int,
        k: int,
        sensor: int,
        shape: Callable[[int, int], FloatArray],
        until: int | None = None,
    ) -> tuple[float, int, FloatArray, FloatArray]:
        """χ², onset (until the last that may be), turn and std of the best shape for first … k."""
        found = [
            (self._explains(first, k, [(sensor, shape(onset, k))]), onset)
            for onset in range(first + 1, (k if until is None else until) + 1)
        ]
        (explained, turn, std), onset = max(found, key=lambda pair: pair[0][0])
        return explained, onset, turn, std

    def _explains(
        self, first: int, k: int, columns: list[tuple[int, FloatArray]]
    ) -> tuple[float, FloatArray, FloatArray]:
        """χ² that turns of these sensors and shapes in time (k + 1,) take away from first … k.

        What the other sensors are known to have done is allowed for. Also the first column's turn
        (3,) and its standard uncertainty.
        """
        asked = {sensor for sensor, _ in columns}
        known = [
            (alarm.sensor, (self._ramp if alarm.kind == "creep" else self._step)(alarm.onset, k))
            for alarm in self.alarms
            if alarm.sensor is not None and alarm.sensor not in asked and first < alarm.onset <= k
        ]
        total = self._regressed(first, k, [*columns, *known])
        without = self._regressed(first, k, known)[0] if known else 0.0
        return total[0] - without, total[1], total[2]

    def _regressed(
        self, first: int, k: int, columns: list[tuple[int, FloatArray]]
    ) -> tuple[float, FloatArray, FloatArray]:
        own = self.own[first : k + 1]
        matrices = np.array([item.matrix for item in own])
        scores = np.array([item.score for item in own])
        known = self.before[first]
        covariance = Information(known.matrix + matrices.sum(axis=0), known.score).covariance
        total = known.score + scores.sum(axis=0)
        turns = [(_turn(sensor), shape[first:]) for sensor, shape in columns]
        cross = np.hstack([np.tensordot(g, matrices[:, :, at], axes=1) for at, g in turns])
        score = np.concatenate([g @ scores[:, at] for at, g in turns])
        square = np.block(
            [[np.tensordot(g * h, matrices[:, a, b], axes=1) for b, h in turns] for a, g in turns]
        )
        left = score - cross.T @ (covariance @ total)
        spread = np.linalg.pinv(square - cross.T @ covariance @ cross, rcond=1e-9, hermitian=True)
        amount = spread @ left
        return float(left @ amount), amount[:3], np.sqrt(np.diagonal(spread)[:3].clip(0.0))


def _turn(sensor: int) -> slice:
    return slice(3 * sensor, 3 * sensor + 3)
