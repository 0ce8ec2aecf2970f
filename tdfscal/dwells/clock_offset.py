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
from tdfscal.frozen import replace
from tdfscal.numerics.streams import Line
from tdfscal.records import ClockPrior, Dwells, FloatArray

_MOST = 100  # moves
_LEAST = 100  # bins in which forces seconds behind are looked for,
_ENOUGH, _COARSE = 36_000, 0.1  # some of a long log's, and s that they are apart at most

LARGE = 0.02
"""s; an offset beyond this, and beyond five standard errors, is worth a warning."""
_CERTAIN = 5.0  # standard errors
_VOUCHED, _UNEVEN = 0.1, 0.5  # s; of an offset that is no other one of seconds, of intervals


def is_large(offset: Line) -> bool:
    """Beyond `LARGE` somewhere in the log, and not by chance."""
    running = abs(offset.rate) > _CERTAIN * offset.rate_std
    most = abs(offset.seconds) + (0.5 * offset.span * abs(offset.rate) if running else 0.0)
    return most > LARGE and (running or abs(offset.seconds) > _CERTAIN * offset.std)


def offset_finding(offset: Line) -> Finding:
    """What the moves say of the offset, time of the forces less that of the positions."""
    values: dict[str, Value] = {"moves": offset.moves, "std": offset.std}
    if abs(offset.rate) > _CERTAIN * offset.rate_std:  # they run apart, and not by chance
        half = 0.5 * offset.span * offset.rate
        values |= {"ppm": 1e6 * offset.rate, "ppm_std": 1e6 * offset.rate_std}
        values |= {"begin": offset.seconds - half, "end": offset.seconds + half}
        return Finding("clocks-run-apart", size=offset.rate, unit="1", values=values)
    code = "clocks-apart" if abs(offset.seconds) >= 3.0 * offset.std else "clocks-together"
    values["late"] = offset.seconds > 0
    size = offset.seconds if code == "clocks-together" else abs(offset.seconds)
    return Finding(code, size=size, unit="s", values=values)


def motion_offset(bins: Bins, dwells: Dwells) -> Line | None:
    """Time of the forces less that of the positions for one and the same motion, and its rate.

    bins : of the whole log. dwells : found in it. None where too few moves show it.
    """
    n, middle, seen = len(bins.supports), bins.start + 0.5 * bins.width, bins.count > 0
    each = [(Track.of(middle[own], bins.mean[own, k]), k >= n) for k, own in enumerate(seen.T)]
    between = evenly(max(len(dwells) - 1, 0), _MOST)
    way = [(float(dwells.end[k]), float(dwells.start[k + 1])) for k in between]
    return lag_by_moves(each[:n], each[n:], way, 0.0, float(bins.period.max()))


def with_offset(dwells: Dwells, offset: Line | None) -> Dwells:
    """The dwells with a finding of `motion_offset` where that is large."""
    if offset is None or not is_large(offset):
        return dwells
    return replace(dwells, findings=(*dwells.findings, offset_finding(offset)))


def misaligned(bins: Bins, dwells: Dwells, offset: Line | None) -> Finding | None:
    """Tell where forces seconds behind the positions, or ahead of them, are paired wrongly.

    offset : `motion_offset`. Not where that tells how far, and moves follow each other so unevenly
    that none falls on the next one: in such a dwell both rest together.
    """
    uneven = len(dwells) > 1 and np.std(np.diff(dwells.start)) > _UNEVEN
    if uneven and offset is not None and offset.std < _VOUCHED:
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
    if abs(best.lag) <= SAME:
        return None
    near, paired = [c for c in found if abs(c.lag) <= SAME], search.instants(best.lag)
    for own in (paired, paired + best.lag):
        near += search.judged([c.peak for c in near], own)
    together = min(c.misfit for c in near)
    if not (np.isfinite(together) and is_clear(best, together)):
        return None
    behind = search.refined(best, "").offset
    return Finding("forces-behind", (), abs(behind), "s", values={"late": behind > 0})
