"""Clocks of recorders that ran apart: how far one is from the other, by what both have seen.

Positions show when the terminal moves; the forces change then too, and balance at every instant
(theory, section 15). The moves name the lags that may be; the balance tells them apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.clocks.search import CLEAR, SAME, Search
from tdfscal.clocks.tracks import Tracks
from tdfscal.errors import DataError, NotIdentifiableError
from tdfscal.findings import Finding, Value
from tdfscal.records import ClockPrior, RecorderClock


def find_clocks(
    first: Tracks, others: Sequence[tuple[str, Tracks, ClockPrior]]
) -> list[RecorderClock]:
    """Find the clocks of all other recorders (name, what it holds, what is stated) by the first's.

    Each beside those found before it, as the balance wants the forces of all; forces that were
    found by forces alone are looked at again by the positions. Raises as `find_clock` does.
    """
    clocks: list[RecorderClock] = []
    tracks = [own for _, own, _ in others]
    for name, own, prior in others:
        found = first.joined(zip(tracks, clocks, strict=False))
        clocks.append(find_clock(found, own, prior, name))
    for k, (name, own, prior) in enumerate(others):
        if not any(each.positions for each in (first, *tracks[: k + 1])):
            rest = list(zip(tracks, clocks, strict=True))
            clocks[k] = find_clock(first.joined(rest[:k] + rest[k + 1 :]), own, prior, name)
    return clocks


def find_clock(first: Tracks, second: Tracks, prior: ClockPrior, name: str) -> RecorderClock:
    """Find the clock of the second of two recorders against the first one's.

    Parameters
    ----------
    first, second : what the two hold; the supports' positions and forces, all together.
    prior : what is stated of the second's clock.
    name : of the second recorder.

    Raises
    ------
    DataError
        The two do not overlap by what is stated, their moves contradict it, or the moves of one
        are not found in the other.
    NotIdentifiableError
        Two lags explain both alike.
    """
    search = Search(first, second, prior).wired()
    if np.isfinite(search.std):
        _check_statement(search, name)
    if prior.exact:
        return RecorderClock(name, first.begin, float(prior.offset.value), 0.0, 0.0, 0.0)
    return search.refined(search.chosen(name), name)


def _check_statement(search: Search, name: str) -> None:
    """Raise DataError where the recorders do not overlap by it, or their moves contradict it.

    That they do takes a lag which the recordings tell clearly without the statement; if by
    their balance, this is far worse at all lags which the statement allows.
    """
    alone = Search(search.first, search.second, ClockPrior(rate_std=search.prior.rate_std))
    try:
        best = alone.chosen(name)
    except (DataError, NotIdentifiableError):
        best = None
    allowed = search.found
    shift = search.second.begin - search.first.begin
    values: dict[str, Value] = {
        "begin": -search.stated, "end": search.spans[1] - search.stated, "span": search.spans[0],
        "offset": float(search.prior.offset.value), "std": search.std,
    }  # fmt: skip
    if best is not None:
        told, stated = shift + best.lag, float(search.prior.offset.value)
        values |= {"found": True, "likelier": told}
        values["reversed"] = abs(stated + told) <= max(search.reach, SAME)
    if not allowed:
        raise DataError(Finding("recorders-overlap-nowhere", (name,), values=values))
    if best is None or abs(best.lag - search.stated) <= max(search.reach, SAME):
        return
    by_moves = best.model is None
    if by_moves or min(c.misfit for c in allowed) > CLEAR * best.misfit:
        raise DataError(Finding("recorder-clock-misstated", (name,), values=values))
