"""Control chart of a rig's sensors: steps, creep, and alarms with a stated rate per year.

Every check (a calibration, or a campaign) is held against what those before it predict. Of each
sensor it is asked whether it turned with the last check, or with the last three, nine or 27: χ² of
a turn of that one sensor, with all other constants of the rig free to be what they are. The rate is
spent evenly over time and shared among the tests of a check, so that a year raises as many false
alarms with daily checks as with monthly ones. What raised an alarm does not name it: sensor, date,
step or creep are those that explain most of what the checks so far show, and once more of what
those show that came after. After a step the sensor's past counts no more, a creep is followed, and
the search goes on.

A turn of which the filter is not told shows in the departure of each check after it, and less with
each, since the filter takes it in. Its score and its information are sums over the checks since
(generalised likelihood ratio; Willsky and Jones, IEEE Trans. Autom. Control 21, 1976), whatever the
walk, and whatever else the filter was told.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, Self

import numpy as np

from tdfscal.frozen import field, record, replace
from tdfscal.model.parameters import EVEN_TURN
from tdfscal.numerics.information import Contrast, Information, contrast, p_value
from tdfscal.records import FloatArray, IntArray
from tdfscal.significance import CAUSE_EXPLAINS, alarm_level

Kind = Literal["step", "creep"]
_KINDS: tuple[Kind, Kind] = ("step", "creep")
#: So many checks back a turn may have begun.
BACK = 48
#: Two checks of a creep are a step and noise: it must have begun before them.
_CREEP_CHECKS = 2
#: Steps are commoner: a creep must explain so much more χ² to be called one.
_CREEP_BETTER = 4.0


@record
class Alarm:
    """A sensor that turned, or a terminal that is not as it was.

    sensor : its index; None of a load, and where all together depart and no single one explains it.
    raised, onset : indices of the checks that raised it, and with which it began.
    turn : (3,), rad, BCS; of a creep, per month. covariance : (3, 3), of it.
    chi2 : that it takes away. p_value : that a sound rig departs as much at this check, in any of
    its tests; 1 where it is not asked yet.
    """

    kind: Kind | Literal["load"]
    sensor: int | None
    raised: int
    onset: int
    turn: FloatArray
    covariance: FloatArray
    chi2: float = 0.0
    p_value: float = 1.0

    @property
    def std(self) -> FloatArray:
        """Standard uncertainty (3,), rad, of the turn about each axis."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def size(self) -> float:
        """How far it turned, rad, about whatever axis."""
        return float(np.linalg.norm(self.turn))

    @property
    def size_std(self) -> float:
        """Standard uncertainty of the size, rad; 0 where no sensor's turn is meant."""
        along = self.turn / self.size if self.size else self.turn
        return float(np.sqrt(along @ self.covariance @ along))


@record
class TurnsSince:
    """The filter after a check, and turns of n sensors that began with any of the last H checks.

    check : index of the last. known : after it. departure : of it from what was predicted.
    response : (2, H, C, 3n), of steps and creeps: what the filter has not taken in of a turn by
    1 rad, or by 1 rad a month. matrix (2, H, n, 3, 3), score (2, H, n, 3): of one sensor's turn, no
    other turned, by all departures.
    """

    check: int
    known: Information
    departure: Contrast
    response: FloatArray
    matrix: FloatArray
    score: FloatArray

    def then(self, own: Information, variance: FloatArray, gap: float) -> TurnsSince:
        """Return it after the next check, `gap` months later; the constants walked by variance."""
        before = self.known.walked(variance)
        departure, known = contrast(before, own), before + own
        _, held, C, wide = self.response.shape
        kept = min(held, BACK - 1)
        response = np.zeros((2, kept + 1, C, wide))
        response[:, :kept] = self.response[:, held - kept :]
        response[0, kept] = np.eye(C, wide)
        response[1] += gap * np.eye(C, wide)
        parts = response.reshape(2, kept + 1, C, wide // 3, 3)
        shown = (departure.matrix @ response).reshape(parts.shape)
        matrix = np.einsum("ehcia,ehcib->ehiab", parts, shown)
        score = np.einsum("ehcia,c->ehia", parts, departure.score)
        matrix[:, :kept] += self.matrix[:, held - kept :]
        score[:, :kept] += self.score[:, held - kept :]
        left = known.covariance @ (before.matrix @ response)
        return TurnsSince(self.check + 1, known, departure, left, matrix, score)

    def of(self, kind: Kind, sensor: int, onset: int) -> Contrast:
        """Return what is seen of the turn of one sensor that began with a check."""
        at = _KINDS.index(kind), onset - self.check - 1, sensor
        return Contrast(self.matrix[at], self.score[at])

    def likeliest(
        self, sensor: int, after: int, until: int, kinds: Iterable[Kind] = _KINDS
    ) -> Alarm | None:
        """Turn of a sensor that explains most; it began after one check and until another.

        None where there is none.
        """
        begun = range(max(after, self.check - self.response.shape[1]) + 1, until + 1)
        turns = [
            self._turn(kind, sensor, onset)
            for kind in kinds
            for onset in begun
            if kind == "step" or onset <= self.check - _CREEP_CHECKS
        ]
        return max(
            turns, key=lambda turn: turn.chi2 - _CREEP_BETTER * (turn.kind == "creep"), default=None
        )

    def _turn(self, kind: Kind, sensor: int, onset: int) -> Alarm:
        seen = self.of(kind, sensor, onset)
        chi2, _ = seen.chi2()
        return Alarm(kind, sensor, self.check, onset, *seen.change(slice(0, 3)), chi2)


def begin(prior: Information, own: Information, sensors: int) -> TurnsSince:
    """Return the filter after the first check, from which all turns count."""
    size = len(prior.score)
    return TurnsSince(
        0,
        prior + own,
        Contrast(np.zeros((size, size)), np.zeros(size)),
        np.zeros((2, 0, size, 3 * sensors)),
        np.zeros((2, 0, sensors, 3, 3)),
        np.zeros((2, 0, sensors, 3)),
    )


#: Checks that speak together against those before them, each with its share of the alarm level. The
#: longer see again what the shorter saw, so that of the shares' sum, above 1, at most 1 comes true
#: (`benchmarks.life`).
WINDOWS = {1: 0.48, 3: 0.36, 9: 0.14, 27: 0.09}
#: Share of all sensors together.
OF_ALL = 0.03
#: Two steps have three unknowns and a date more than one creep: they must explain so much more χ².
_TWO_STEPS_COST = 12.0
#: By so much, kg and m, a load may be another.
_LOADED = 1e3
#: Checks after an alarm that still tell its date and size: what comes long after is another story.
_SETTLED = BACK // 2


@record
class Check:
    """What one calibration, or one campaign, says of the constants (C,); rotations first.

    month : date of measurement in months from any instant. load : places of its terminal's mass
    and barycentre among the constants; none where they are not asked for. moved : variance (C,)
    by which constants other than the turns are others than at the check before.
    """

    name: str
    month: float
    own: Information
    load: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int_))
    moved: FloatArray = field(default_factory=lambda: np.zeros(()))


class Watching:
    """Goes through the checks in the order of time.

    alarms : as they were raised. level : (K,), of a check, all its tests together. smallest :
    (K, n), least p-value of a sensor's tests at each check, among all the check's tests; 1 at the
    first. departure : of the last check from what those before it predicted. walk : variance (C,)
    before each check, the jumps of the alarms included.
    """

    def __init__(
        self,
        checks: Sequence[Check],
        prior: Information,
        steps: Sequence[FloatArray],
        sensors: int,
        rate: float,
    ) -> None:
        self.own, self.prior, self.steps, self.n = [c.own for c in checks], prior, steps, sensors
        self.loads = [check.load for check in checks]
        months = np.array([check.month for check in checks])
        self.gaps = np.diff(months, prepend=months[0])
        self.alarms: list[Alarm] = []
        self.level = alarm_level(self.gaps, rate)
        self.smallest = np.ones((len(checks), sensors))

    def run(self) -> Self:
        """Find the alarms, and the walk with their jumps."""
        now, walk = self._through(0), self._walk()
        self.departure = now.departure
        for k in range(1, len(self.own)):
            now = now.then(self.own[k], walk[k], self.gaps[k])
            self.departure = now.departure
            p = self.smallest[k] = self._p_values(now)
            every = p_value(now.departure.chi2()) / OF_ALL
            if min(p.min(), every) <= self.level[k] and self._loaded(now):
                self.alarms.append(_unexplained("load", k, min(float(p.min()), every)))
                now, walk = self._through(k), self._walk()
                p, every = self._p_values(now), p_value(now.departure.chi2()) / OF_ALL
            if p.min() > self.level[k] >= every:
                self.alarms.append(_unexplained("step", k, every))
            while p.min() <= self.level[k]:
                self._raise(now, p)
                now, walk = self._through(k), self._walk()
                p = self._p_values(now)
        self.alarms = [self._settled(alarm) for alarm in self.alarms]
        self.walk = self._walk()
        return self

    def _walk(self, but: Alarm | None = None) -> list[FloatArray]:
        """Variance (C,) before each check; all alarms are known but one."""
        walk = [step.copy() for step in self.steps]
        for alarm in self.alarms:
            if alarm.kind == "load":
                walk[alarm.onset][self.loads[alarm.onset]] += _LOADED**2
            if alarm.sensor is None or alarm is but:
                continue
            where = slice(3 * alarm.sensor, 3 * alarm.sensor + 3)
            if alarm.kind == "step":  # what was known of the sensor holds no more
                walk[alarm.onset][where] += EVEN_TURN**2
            else:  # it is followed from here on, at up to twice this speed
                pace = 2 * float(np.linalg.norm(alarm.turn))
                for k in range(alarm.onset, len(walk)):
                    walk[k][where] += (pace * self.gaps[k]) ** 2
        return walk

    def _loaded(self, now: TurnsSince) -> bool:
        """Whether another load explains the last check, and better than any one sensor's turn."""
        load, departure = self.loads[now.check], now.departure
        if not len(load) or p_value(departure.left(load)) < CAUSE_EXPLAINS:
            return False
        return bool(p_value(departure.chi2(load)) < departure.turn_p(self.n).min())

    def _through(self, last: int, but: Alarm | None = None) -> TurnsSince:
        """Go through the checks up to the last; all alarms are known but one."""
        now, walk = begin(self.prior, self.own[0], self.n), self._walk(but)
        for k in range(1, last + 1):
            now = now.then(self.own[k], walk[k], self.gaps[k])
        return now

    def _p_values(self, now: TurnsSince) -> FloatArray:
        """Least p-value (n,) of each sensor's tests, among those of all sensors."""
        least = np.ones(self.n)
        for i in range(self.n):
            for size, share in WINDOWS.items():
                if (onset := now.check - size + 1) > self._past(i)[-1]:
                    least[i] = min(
                        least[i], self.n * p_value(now.of("step", i, onset).chi2()) / share
                    )
        return least

    def _past(self, sensor: int) -> list[int]:
        """Checks with which the sensor's past began anew."""
        return [0, *sorted(alarm.onset for alarm in self.alarms if alarm.sensor == sensor)]

    def _raise(self, now: TurnsSince, p: FloatArray) -> None:
        """Name the turn that explains most, of the sensors whose tests alarm."""
        named: list[Alarm] = []
        for i in np.flatnonzero(p <= self.level[now.check]).tolist():
            turn = now.likeliest(i, self._past(i)[-1], now.check)
            assert turn is not None
            named.append(replace(turn, p_value=float(p[i])))
        alarm = max(named, key=lambda turn: turn.chi2)
        earlier = next((a for a in reversed(self.alarms) if a.sensor == alarm.sensor), None)
        if earlier is not None and earlier.kind == "step":
            creep = self._one_creep(now.check, earlier, alarm)
            if creep is not None:  # what seemed a step was the beginning of it
                self.alarms.remove(earlier)
                alarm = replace(creep, raised=now.check, p_value=earlier.p_value)
        self.alarms.append(alarm)

    def _one_creep(self, k: int, earlier: Alarm, later: Alarm) -> Alarm | None:
        """Return a creep that does as well until check k as two turns, if one does."""
        assert earlier.sensor is not None
        without = self._through(k, earlier)
        step = without.likeliest(earlier.sensor, earlier.onset - 1, earlier.onset, ("step",))
        creep = without.likeliest(earlier.sensor, self._past(earlier.sensor)[-2], k, ("creep",))
        if step is None or creep is None or creep.chi2 < step.chi2 + later.chi2 - _TWO_STEPS_COST:
            return None
        return creep

    def _settled(self, alarm: Alarm) -> Alarm:
        """Name an alarm again by all checks until the sensor's next, as far as they tell of it."""
        if alarm.sensor is None:
            return alarm
        past = [*self._past(alarm.sensor), len(self.own)]
        place = past.index(alarm.onset, 1)
        last = min(past[place + 1] - 1, alarm.raised + _SETTLED)
        now = self._through(max(last, alarm.onset), alarm)
        turn = now.likeliest(alarm.sensor, past[place - 1], min(alarm.raised, last))
        return alarm if turn is None else replace(turn, raised=alarm.raised, p_value=alarm.p_value)


def _unexplained(kind: Literal["step", "load"], check: int, p: float) -> Alarm:
    """An alarm that is no one sensor's turn."""
    return Alarm(kind, None, check, check, np.zeros(3), np.zeros((3, 3)), p_value=p)
