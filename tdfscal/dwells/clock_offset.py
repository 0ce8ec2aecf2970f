"""Offset between the clocks of positions and forces, and its rate, from moves between dwells.

In a move both pass from one level to the next in step: when they do tells their offset, and how
that changes from move to move the rate (`numerics.streams`).
"""

from __future__ import annotations

import numpy as np

from tdfscal.clocks.search import SAME, Search, is_clear
from tdfscal.clocks.tracks import Peak, Track, Tracks, lag_by_moves
from tdfscal.dwells.bins import Bins
from tdfscal.dwells.dwell_means import evenly
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.records import ClockPrior, Dwells, FloatArray

_MOST = 100  # moves
_LEAST = 100  # bins in which forces seconds behind are looked for,
_ENOUGH, _COARSE = 36_000, 0.1  # some of a long log's, and s that they are apart at most

LARGE = 0.02
"""s; an offset beyond this, and beyond five standard errors, is worth a warning."""
_CERTAIN = 5.0  # standard errors
_VOUCHED, _UNEVEN = 0.1, 0.5  # s; of an offset that is no other one of seconds, of intervals


@record
class Offset:
    """seconds : time of the forces less that of the positions for one and the same motion.

    It holds in the middle of the moves and grows by `rate`, over their span, s. std, rate_std :
    standard errors, from the scatter of the moves. moves : how many showed it.
    """

    seconds: float
    std: float
    moves: int
    rate: float = 0.0
    rate_std: float = np.inf
    span: float = 0.0

    @property
    def large(self) -> bool:
        """Beyond `LARGE` somewhere in the log, and not by chance."""
        begin, end = self._ends if self.running else (self.seconds,) * 2
        return max(abs(begin), abs(end)) > LARGE and (
            self.running or abs(self.seconds) > _CERTAIN * self.std
        )

    @property
    def running(self) -> bool:
        """Whether the clocks run apart, and not by chance."""
        return abs(self.rate) > _CERTAIN * self.rate_std

    @property
    def _ends(self) -> tuple[float, float]:
        half = 0.5 * self.span * self.rate
        return self.seconds - half, self.seconds + half

    @property
    def finding(self) -> Finding:
        """As a finding."""
        values: dict[str, Value] = {"moves": self.moves, "std": self.std}
        if self.running:
            begin, end = self._ends
            values |= {"ppm": 1e6 * self.rate, "ppm_std": 1e6 * self.rate_std}
            values |= {"begin": begin, "end": end}
            return Finding("clocks-run-apart", size=self.rate, unit="1", values=values)
        code = "clocks-apart" if abs(self.seconds) >= 3.0 * self.std else "clocks-together"
        values["late"] = self.seconds > 0
        size = self.seconds if code == "clocks-together" else abs(self.seconds)
        return Finding(code, size=size, unit="s", values=values)


def motion_offset(bins: Bins, dwells: Dwells) -> Offset | None:
    """Estimate offset and rate between positions and forces; None where too few moves show them.

    bins : of the whole log. dwells : found in it.
    """
    n, middle, seen = len(bins.supports), bins.start + 0.5 * bins.width, bins.count > 0

    def tracks(kind: slice, late: bool) -> list[tuple[Track, bool]]:
        if seen.all():  # one, of all axes
            return [(Track.of(middle, bins.mean[:, kind].reshape(len(bins), -1)), late)]
        each = [Track.of(middle[own], bins.mean[own, k]) for k, own in enumerate(seen.T)]
        return [(track, late) for track in each[kind]]

    between = evenly(max(len(dwells) - 1, 0), _MOST)
    way = [(float(dwells.end[k]), float(dwells.start[k + 1])) for k in between]
    streams = tracks(slice(0, n), False), tracks(slice(n, None), True)
    line = lag_by_moves(*streams, way, 0.0, float(bins.period.max()))
    if line is None:
        return None
    return Offset(line.value, line.std, line.moves, line.rate, line.rate_std, line.span)


def misaligned(bins: Bins, dwells: Dwells) -> Finding | None:
    """Tell where forces seconds behind the positions, or ahead of them, are paired wrongly.

    Not where the moves between dwells tell how far, and follow each other so unevenly that none
    falls on the next one: in such a dwell both rest together.
    """
    if len(dwells) > 1 and np.std(np.diff(dwells.start)) > _UNEVEN:
        offset = motion_offset(bins, dwells)
        if offset is not None and offset.std < _VOUCHED:
            return None
    n, whole = len(bins.supports), np.flatnonzero((bins.count > 0).all(axis=1))
    if len(whole) < _LEAST:
        return None
    whole = whole[:: max(min(len(whole) // _ENOUGH, int(_COARSE / bins.width)), 1)]
    mean = bins.mean[whole]
    return forces_behind(bins.start[whole], mean[:, :n], mean[:, n:])


def forces_behind(time: FloatArray, position: FloatArray, force: FloatArray) -> Finding | None:
    """Say by how many s the forces of one recording come after its positions, if it is many.

    By the balance at the lags that bring the moves together; None where no other lag is far
    better than none, for the same forces and the same positions too: a lag may pass by a stretch
    in which a channel dropped out. time : (N,), s. position, force : (N, n, 3), m and N.
    """
    tracks, begin, step = [], float(time[0]), float(np.median(np.diff(time)))
    for kind, values in enumerate((position, force)):
        if not np.isfinite(values).all():
            return None  # of a component that is not measured
        each = enumerate(np.moveaxis(values, 1, 0))
        streams = {2 * i + kind: Track.of(time - begin, value) for i, value in each}
        tracks.append(Tracks(begin, float(time[-1]), step, streams))
    search = Search(tracks[0], tracks[1], ClockPrior())
    found = search.judged([Peak(0.0, 0.0, search.spans[0]), *search.candidates()])
    best = min(found, key=lambda candidate: candidate.misfit)
    near, paired = [c for c in found if abs(c.lag) <= SAME], search.instants(best.lag)
    for own in (paired, paired + best.lag):
        near += search.judged([c.peak for c in near], own)
    together = min(c.misfit for c in near)
    if not (np.isfinite(together) and is_clear(best, together)):
        return None
    behind = search.refined(best, "").offset
    return Finding("forces-behind", (), abs(behind), "s", values={"late": behind > 0})
