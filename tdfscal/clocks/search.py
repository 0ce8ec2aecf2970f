"""The lags that two recorders' moves allow, which of them balances, and the clock by it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import combinations
from operator import attrgetter

import numpy as np

from tdfscal.clocks.balance import Balance, Model, refine
from tdfscal.clocks.tracks import (
    Peak,
    Track,
    Tracks,
    Wiring,
    activity,
    correlation_time,
    lag_by_moves,
    moves,
    peaks,
)
from tdfscal.errors import DataError, NotIdentifiableError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.numerics.streams import Line
from tdfscal.records import ClockPrior, FloatArray, RecorderClock

_WIDTH = 0.1  # s, of a bin of activity
_BINS = 1 << 16
_OVERLAP = 0.25  # shortest, as a share of the shorter recording
_COMPLETE = 0.9  # share of the longer one, below which a recording may be cut short
_CANDIDATES, _LEAST = 24, 8  # lags looked at, at most and at least,
_FAINT = 0.1  # by their share of the best one's evidence
_INSTANTS = 240  # on which a candidate is judged
_SPACING = 0.08  # s, of instants at the least
_STEP = 0.3  # s, by which a statement may be off beside its uncertainty,
SAME = 0.6  # and up to which two lags are one
_DENSE = 10_000  # instants on which offset and rate are refined
_ALIKE = 1.5  # ratio of misfits up to which two lags explain alike,
_REPEATS = 0.1  # where positions repeat to this part of their travel,
_HALF = 0.5  # or by this part of the evidence at least
CLEAR = 3.0  # ratio of misfits from which a lag is told from chance,
_CERTAIN = 20.0  # and its log-likelihood ratio
_PART = 0.125  # of that time, by which lags that are all tried are apart,
_MOST_LAGS, _TOGETHER = 2_000, 64  # how many at most, of which so many are judged together;
_BASINS, _CLOSER = 3, 17  # about the best of them, so many closer ones each
_WRONG = 5.0  # times the noise's misfit, from which the streams may be wired wrongly
_CHANCE = 22.0  # log-likelihood ratio of an activity that is no chance,
_LIKE = 0.85  # and its correlation
_MISFIT = attrgetter("misfit")
_UNKNOWN = 1e3  # s, standard uncertainty of a lag that nothing but its statement tells
_ALSO = 0.6  # share of it from which another lag is as likely


@record
class Candidate:
    """A lag, s, from begin to begin. misfit : of the balance, for its degrees of freedom.

    rows : independent equations of it. model : what balances; None where none does.
    """

    peak: Peak
    misfit: float = np.inf
    rows: float = 0.0
    model: Model | None = None

    @property
    def lag(self) -> float:
        """Seconds."""
        return self.peak.lag


class Search:
    """What two recorders hold, and what is stated of the second one's clock."""

    def __init__(self, first: Tracks, second: Tracks, prior: ClockPrior) -> None:
        self.first, self.second, self.prior = first, second, prior
        self.spans = first.end - first.begin, second.end - second.begin
        #: Lag from begin to begin that is stated, and its standard uncertainty.
        self.stated = float(prior.offset.value) - (second.begin - first.begin)
        self.std = float(prior.offset.std)
        self.positions, self.forces = _streams(first, second)
        #: None where a support's position or force is with neither, or a channel is.
        complete = len(self.positions) == len(self.forces) >= 3 and all(
            np.ptp(track.value, axis=0).all() for track, _ in self.forces
        )
        self.balance = Balance(self.positions, self.forces) if complete else None

    def candidates(self) -> list[Peak]:
        """Lags at which both are active together, the likeliest first."""
        slowest = max(self.first.period, self.second.period)
        width = max(_WIDTH, 1.5 * slowest, max(self.spans) / _BINS)  # s, of a bin of activity
        first, second = (
            activity(tracks.forces or tracks.positions, width, span)
            for tracks, span in zip((self.first, self.second), self.spans, strict=True)
        )
        found = peaks(first, second, width, _OVERLAP * min(self.spans), _CANDIDATES)
        faint = _FAINT * found[0].evidence if found else 0.0
        found = [p for k, p in enumerate(found) if k < _LEAST or p.evidence > faint]
        if np.isfinite(self.std):
            found = [p for p in found if abs(p.lag - self.stated) <= self.reach]
            found.append(Peak(self.stated, 0.0, min(self.spans)))
        return [p for p in found if -self.spans[0] < p.lag < self.spans[1]]

    @property
    def reach(self) -> float:
        """How much, s, the lag may be off what is stated."""
        return 5.0 * self.std + self.prior.rate_std * max(self.spans) + _STEP

    @cached_property
    def by_moves(self) -> list[Candidate]:
        """The lags that the moves allow, those that balance best first."""
        return sorted(self.judged(self.candidates()), key=_MISFIT)

    @cached_property
    def found(self) -> list[Candidate]:
        """The lags that may be, those that balance best first.

        A motion without rests is active all the time: where none of the lags that the moves allow
        is clear, all are tried, in steps of the time in which the positions tell something new.
        """
        found = self.by_moves
        clear = found and is_clear(found[0], _usual(found))
        if self.balance is None or np.isfinite(self.std) or clear:
            return found
        step, least = _PART * self.correlation_time, _OVERLAP * min(self.spans)
        every = np.arange(least - self.spans[0], self.spans[1] - least, step)
        if len(every) <= _MOST_LAGS:
            found = found + self.judged([Peak(lag, 0.0, least) for lag in every])
            found.sort(key=_MISFIT)
        ways = step * np.linspace(-1.0, 1.0, _CLOSER)
        closer = [Peak(c.lag + way, 0.0, least) for c in found[:_BASINS] for way in ways]
        return sorted([*found, *self.judged(closer)], key=_MISFIT)

    def wired(self) -> Search:
        """The search in which one mistake of the wiring is undone, where only so a lag balances.

        A sign or an exchange that leaves residuals far above the noise at every lag says nothing
        of the clock: it is the log's own to be told, by the clock that holds without it.
        """
        if self.balance is None or not self.found:
            return self
        best, likeliest = self.found[0].misfit, self
        if best <= _WRONG * self.balance.noise:
            return self
        least = best / CLEAR
        for wiring in _mistakes(len(self.positions)):
            other = Search(self.first.rewired(wiring), self.second.rewired(wiring), self.prior)
            found = other.by_moves
            usual = min(_usual(found), best)
            if found[0].misfit < least and is_clear(found[0], usual):
                likeliest, least = other, found[0].misfit
        return likeliest

    def chosen(self, name: str) -> Candidate:
        """The lag that explains both recordings."""
        found = self.found
        if not found:
            raise self._not_found(name)
        best, usual = found[0], _usual(found)
        if np.isfinite(self.std):
            return best
        if not is_clear(best, usual):
            return self._by_activity(name, found)
        for other in found[1:]:
            if abs(other.lag - best.lag) > SAME and self._alike(best, other, usual):
                raise self._undecided(name, best, other)
        return best

    def _by_activity(self, name: str, found: Sequence[Candidate]) -> Candidate:
        """The lag by the moves alone, where the balance does not tell."""
        best, *others = sorted(found, key=lambda c: -c.peak.evidence)
        if best.peak.r < _LIKE or best.peak.evidence < _CHANCE * self.correlation_time:
            raise self._not_found(name)
        if others and others[0].peak.evidence > _ALSO * best.peak.evidence:
            raise self._undecided(name, best, others[0])
        return replace(best, model=None)  # whose moves do not balance

    def _alike(self, best: Candidate, other: Candidate, usual: float) -> bool:
        """Whether another lag explains both as well: moves that repeat, or few of them."""
        if other.misfit > _ALIKE * best.misfit:
            return False
        if _evidence(other, self.balance, usual) > _HALF * _evidence(best, self.balance, usual):
            return True
        tracks = [track for track, _ in self.positions or self.forces]
        shift = abs(other.lag - best.lag)
        time = np.linspace(0.0, max(self.spans) - shift, _INSTANTS)
        here, again = (np.hstack([t.at(time + s)[0] for t in tracks]) for s in (0.0, shift))
        return float(np.mean((again - here) ** 2)) < _REPEATS**2 * float(np.mean(np.var(here, 0)))

    def judged(self, lags: Sequence[Peak], time: FloatArray | None = None) -> list[Candidate]:
        """The lags with the misfit of the balance there; time : instants, default all of a lag."""
        if self.balance is None or not lags:
            return [Candidate(peak) for peak in lags]
        if len(lags) > _TOGETHER:
            parts = (lags[k : k + _TOGETHER] for k in range(0, len(lags), _TOGETHER))
            return [candidate for part in parts for candidate in self.judged(part, time)]
        found, taken = [], self.balance.parameters
        times = [self.instants(peak.lag) if time is None else time for peak in lags]
        shift = [np.full(len(own), peak.lag) for peak, own in zip(lags, times, strict=True)]
        for peak, own, model in zip(lags, times, self.balance.fit(times, shift), strict=True):
            rows = 6.0 * float(own[-1] - own[0]) / self.correlation_time if model else 0.0
            free, misfit = rows - taken, np.inf
            if model and free >= 0.25 * taken:
                misfit = model.misfit * float(np.sqrt(rows / free))
            found.append(Candidate(peak, misfit, rows, model))
        return found

    @cached_property
    def correlation_time(self) -> float:
        """Time, s, in which the positions, or else the forces, tell something new."""
        told = self.positions or self.forces
        span = min(self.spans[late] for _, late in told)
        return correlation_time([track for track, _ in told], span)

    def instants(self, lag: float, most: int = _INSTANTS) -> FloatArray:
        """Instants of the first clock, from its begin, at which both recorders run."""
        begin, end = max(0.0, -lag), min(self.spans[0], self.spans[1] - lag)
        if end <= begin:
            return np.empty(0)
        return np.linspace(begin, end, min(most, max(int((end - begin) / _SPACING), 2)))

    def _not_found(self, name: str) -> DataError:
        first, second = self.spans
        short = min(self.spans) < _COMPLETE * max(self.spans)
        values: dict[str, Value] = {"first": first, "second": second, "short": short}
        return DataError(Finding("recorder-not-found", (name,), values=values))

    def _undecided(self, name: str, a: Candidate, b: Candidate) -> NotIdentifiableError:
        shift = self.second.begin - self.first.begin
        values: dict[str, Value] = {"likelier": shift + a.lag, "other": shift + b.lag}
        return NotIdentifiableError(Finding("recorder-clock-open", (name,), values=values))

    def refined(self, candidate: Candidate, name: str) -> RecorderClock:
        """The clock with offset and rate, by the balance or by single moves."""
        slowest, drift = max(self.first.period, self.second.period), self.prior.rate_std
        time = self.instants(candidate.lag, _DENSE)
        middle = 0.5 * float(time[0] + time[-1])
        line: FloatArray = np.array([candidate.lag, 0.0])
        told = _WIDTH if candidate.peak.r >= _LIKE else _UNKNOWN
        covariance: FloatArray = np.diag([told**2 + slowest**2, drift**2])
        by_moves = self._by_moves(candidate, slowest)
        if self.balance is not None and candidate.model is not None:
            line, covariance = refine(
                self.balance, candidate.model, time, candidate.lag, candidate.rows, drift, slowest
            )
        # By one of several amplifiers the balance would tell how its sensors settle.
        better = self._in_part or (by_moves and by_moves.std**2 < covariance[0, 0])
        if by_moves is not None and better:
            middle = by_moves.middle
            share = drift**2 / (drift**2 + by_moves.rate_std**2)
            line = np.array([by_moves.seconds, by_moves.rate * share])
            covariance = np.diag([by_moves.std**2, by_moves.rate_std**2 * share])
        line, covariance = self._with_stated(line, covariance)
        # At the first stamp of the first clock, where the offset is told.
        back = np.array([1.0, -middle])
        offset = self.second.begin - self.first.begin + float(back @ line)
        rate, rate_std = float(line[1]), float(np.sqrt(covariance[1, 1]))
        offset_std = float(np.sqrt(back @ covariance @ back))
        return RecorderClock(name, self.first.begin, offset, offset_std, rate, rate_std)

    def _by_moves(self, candidate: Candidate, slowest: float) -> Line | None:
        if not (self.positions and self.forces):
            return None
        # Of each kind what the second holds, or else all.
        both = [[s for s in kind if s[1]] or kind for kind in (self.positions, self.forces)]
        first = lag_by_moves(both[0], both[1], self._moves(candidate.lag), candidate.lag, slowest)
        if first is None:
            return None
        lag = first.seconds
        return lag_by_moves(both[0], both[1], self._moves(lag), lag, slowest) or first

    @cached_property
    def _in_part(self) -> bool:
        """Whether the second holds some of the forces, or of the positions, and not all."""
        return any(0 < sum(late for _, late in kind) < len(kind)
                   for kind in (self.positions, self.forces))  # fmt: skip

    def _moves(self, lag: float) -> list[tuple[float, float]]:
        """Moves from rest to rest by the positions, s of the first clock."""
        late = not self.first.positions
        tracks = self.second if late else self.first
        found = moves(tracks.positions, self.spans[late], tracks.period)
        return [(a - lag * late, b - lag * late) for a, b in found]

    def _with_stated(
        self, line: FloatArray, covariance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Lag and rate with what is stated of the offset."""
        if not np.isfinite(self.std):
            return line, covariance
        gain = covariance[:, 0] / (covariance[0, 0] + self.std**2)
        return line + gain * (self.stated - line[0]), covariance - np.outer(gain, covariance[0])


def _streams(
    first: Tracks, second: Tracks
) -> tuple[list[tuple[Track, bool]], list[tuple[Track, bool]]]:
    """Positions and forces of both, in the supports' order; with whether each is the second's."""
    both: tuple[list[tuple[Track, bool]], list[tuple[Track, bool]]] = [], []
    for number in sorted({*first.streams, *second.streams}):
        late = number not in first.streams
        both[number % 2].append(((second if late else first).streams[number], late))
    return both


def _usual(found: Sequence[Candidate]) -> float:
    """Misfit of lags by chance: the median of those far from the best, the first."""
    rest = [c for c in found if np.isfinite(c.misfit)]
    far = [c.misfit for c in rest if abs(c.lag - found[0].lag) > 5.0]
    return float(np.median(far)) if far else np.inf


def _mistakes(n: int) -> Iterator[Wiring]:
    """Ways in which the streams of n supports may be wired or signed wrongly.

    With the mounting free, one wrong sign of a sensor is as good as three; and positions exchanged
    are forces exchanged.
    """
    for some in (*combinations(range(n), 1), *combinations(range(n), 2), tuple(range(n))):
        yield {2 * i + 1: (2 * i + 1, -np.ones(3)) for i in some}
    for i, j in combinations(range(n), 2):
        yield {2 * i + 1: (2 * j + 1, np.ones(3)), 2 * j + 1: (2 * i + 1, np.ones(3))}
    for by in (1, n - 1):
        yield {2 * i + 1: (2 * ((i + by) % n) + 1, np.ones(3)) for i in range(n)}
    for i in range(n):
        yield from ({2 * i: (2 * i, sign)} for sign in 1.0 - 2.0 * np.eye(3))


def _evidence(candidate: Candidate, balance: Balance | None, usual: float) -> float:
    """Log-likelihood ratio of a lag against those that balance by chance."""
    if balance is None or not np.isfinite(candidate.misfit):
        return 0.0
    return (candidate.rows - balance.parameters) * float(np.log(usual / candidate.misfit))


def is_clear(best: Candidate, usual: float) -> bool:
    """Whether a lag balances far better than lags do by chance."""
    if not np.isfinite(best.misfit):
        return False
    ratio = usual / max(best.misfit, 1e-12)
    return ratio > CLEAR and best.rows * np.log(ratio) > _CERTAIN
