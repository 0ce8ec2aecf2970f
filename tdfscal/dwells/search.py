"""The search for dwells on bins: rest of the NCPs, then settled stretches within each rest."""

from __future__ import annotations

from functools import partial

import numpy as np

from tdfscal.dwells.dwell_means import Extent, evenly
from tdfscal.dwells.field import Field
from tdfscal.dwells.noise_level import runs
from tdfscal.dwells.settling import Stretch, one_level, settled_part
from tdfscal.findings import Finding, Value
from tdfscal.records import FloatArray, IntArray, LeftOut
from tdfscal.significance import SAME_LEVEL

_WRONG = Finding("stop-interrupted")  # readings that are left out amid a dwell
_JOLT = Finding("stop-jolted")
WRONG = (_WRONG.code, _JOLT.code)

_MENTIONED = 0.1  # s; shorter moments of rest within a move are not worth a line
_BRIEF = 1.0  # s; pauses between stretches of rest that are looked at together
_UNSETTLED = 1.0  # bias / standard error that a dwell may not exceed
_TRANSIENT = 0.6  # s; a level held for less, and left again, is the crest of an oscillation
_CLEAR = 0.1  # largest share of a rest that is kept clear of each neighbouring move
_ONSET = 25  # bins looked at to see how a move begins


def search(
    field: Field,
    long_run: FloatArray,
    *,
    rough: bool = False,
    some: int | None = None,
) -> tuple[list[Extent], list[LeftOut]]:
    """Dwells of all stretches of rest, and what is left out.

    some : look at so many rests at most, evenly over the log.
    rough : take what may still be biased by the end of settling, for a first look at the noise.
    long_run : (6n,), positions first; see `Stretch`.
    """
    axes = len(field.positions)
    extents: list[Extent] = []
    left_out: list[LeftOut] = []
    first, last = runs(~field.moving)
    named = (last - first) * field.bins.width >= _MENTIONED
    first, last = first[named], last[named]
    chosen = evenly(len(first), some or len(first))
    first, last = first[chosen], last[chosen]
    clear = first + _kept_clear(field, first, last, after=True)
    latest = last - _kept_clear(field, first, last, after=False)
    rests = np.stack([first, last, clear, latest], axis=1)
    apart = np.flatnonzero(first[1:] - last[:-1] > _BRIEF / field.bins.width) + 1
    for part in np.split(np.arange(len(first)), apart) if len(first) else ():
        bins = slice(int(first[part[0]]), int(last[part[-1]]))
        value = field.signals.value[:, bins]
        stretch = Stretch.of(bins.start, value, field.noise, axes, long_run, field.bins.width)
        found: list[Extent] = []
        for begin, end, *inner in rests[part].tolist():
            kept, out = _within_rest(field, stretch, begin, end, inner, rough)
            found += kept
            left_out += out
        stops, out = _whole_stops(field, stretch, found)
        extents += stops
        left_out += out
    return extents, left_out


def _whole_stops(
    field: Field, stretch: Stretch, extents: list[Extent]
) -> tuple[list[Extent], list[LeftOut]]:
    """Join dwells of one stop: the NCPs stayed between them, and all levels are what they were.

    Wrong readings of a position part them, as does a hand on the terminal. Two dwells of one stop
    share the errors of its posture, and would be counted as independent.
    """
    joined: list[Extent] = []
    out: list[LeftOut] = []
    for later in extents:
        earlier = joined[-1] if joined else None
        if (
            earlier is None
            or not _stays(field, earlier, later)
            or not one_level(stretch, earlier.ends[1], later.ends[0], SAME_LEVEL)
        ):
            joined.append(later)
            continue
        away = _leaves(stretch, earlier.ends[1], later.begin)
        joined[-1] = earlier.followed_by(later, between=not away)
        if away:
            moved = field.moving[earlier.end : later.begin].any()
            out.append(field.out(earlier.end, later.begin, _WRONG if moved else _JOLT))
    return joined, out


def _stays(field: Field, earlier: Extent, later: Extent) -> bool:
    """Do the NCPs stay from one dwell to the next, by a third of the readings at least?"""
    value, start = field.positions, field.bins.start
    pause = later.begin - earlier.end
    if (
        (np.abs(value[:, later.begin] - value[:, earlier.end - 1]) > field.visible).any()
        or pause > 2 * ((earlier.end - earlier.begin) + (later.end - later.begin))
        or np.diff(start[earlier.end - 1 : later.begin + 1]).max() > 1.5 * field.bins.width
        or (field.bins.count[earlier.end : later.begin] == 0).any()
    ):
        return False
    last = earlier.ends[1]
    level = value[:, last.begin : last.end].mean(axis=1)
    away = np.abs(value[:, earlier.end : later.begin] - level[:, None])
    return not pause or bool((np.quantile(away, 1 / 3, axis=1) <= field.visible).all())


def _leaves(stretch: Stretch, earlier: Extent, end: int) -> bool:
    """Does any bin from a stretch at rest to `end`, or all of them together, leave its level?

    Else chance has made a change of level where none was.
    """
    bins = np.arange(earlier.end, end)
    begin, after = np.append(bins, earlier.end), np.append(bins + 1, end)
    difference = stretch.mean(begin, after) - stretch.mean(earlier.begin, earlier.end)
    variance = stretch.noise.of_mean(after - begin) ** 2
    variance = variance + stretch.noise.of_mean(earlier.end - earlier.begin) ** 2
    return bool(stretch.misfit(difference, variance, SAME_LEVEL / len(begin)).any())


def _kept_clear(field: Field, begin: IntArray, end: IntArray, *, after: bool) -> IntArray:
    """Bins at the end of each rest (after: of the move's end at its begin) to keep clear of a move.

    A smooth move begins like t³, unseen at first. It needs as long to stand out of the noise as
    from there to eight times as far.
    """
    bins = len(field.bins)
    edge, way = (begin, 1) if after else (end - 1, -1)
    held = edge[:, None] + way * np.arange(5)
    outside = edge[:, None] - way * np.arange(-1, _ONSET + 1)
    inside = (held >= 0) & (held < bins)
    known = (outside >= 0) & (outside < bins)
    held, outside = np.clip(held, 0, bins - 1), np.clip(outside, 0, bins - 1)
    excursion = np.zeros(outside.shape)
    for value, visible in zip(field.positions, field.visible, strict=True):
        mean = np.where(inside, value[held], 0.0).sum(axis=1) / inside.sum(axis=1)
        away = np.abs(value[outside] - mean[:, None]) / max(visible, np.finfo(np.float64).tiny)
        np.maximum(excursion, away, out=excursion, where=known)
    seen, far = excursion > 1.0, excursion > 8.0
    onset = np.where(far.any(axis=1), far.argmax(axis=1) - seen.argmax(axis=1) + 1, 3)
    onset[known.sum(axis=1) <= 2] = 0  # the log begins or ends at rest
    return np.minimum(onset, np.maximum((_CLEAR * (end - begin)).astype(np.int64), 1))


def _within_rest(
    field: Field, stretch: Stretch, begin: int, end: int, inner: list[int], rough: bool
) -> tuple[list[Extent], list[LeftOut]]:
    """Settled stretches within one stretch of rest [begin, end), and what is left out.

    inner : begin and end of what is clear of the moves.
    """
    length = (end - begin) * field.bins.width
    if end - begin < field.shortest:
        wanted = field.shortest * field.bins.width
        reason = Finding("stop-too-short", size=length, unit="s", values={"wanted": wanted})
        return [], [field.out(begin, end, reason)]
    clear, latest = inner
    held = round(_TRANSIENT / field.bins.width)
    calm_from = begin + runs(~field.disturbed[begin:end])[0]
    kept, unsettled, origin = list[Extent](), list[LeftOut](), begin
    for calm, stop in (found := _calm(field, begin, end)):
        start, last = max(calm, clear), min(stop, latest)
        if last - start < field.shortest:
            continue
        # What precedes is settling after the move; after a settled level it is a burst.
        left = partial(field.ringing.left, begin) if field.ringing is not None else None
        part = settled_part(stretch, start, last, origin, field.shortest, left=left, rough=rough)
        if part is None or part.ratio > _UNSETTLED:
            unsettled.append(field.out(start, last, Finding("stop-changing")))
            continue
        if part.end - part.begin >= held or stop == found[-1][1]:
            kept.append(Extent(part.begin, part.end, np.ones(part.end - part.begin, np.bool_)))
        origin = min(calm_from[calm_from >= stop], default=end)
    if kept:
        return kept, unsettled
    rings: dict[str, Value] = {}
    if field.ringing:
        rings = {"constant": field.ringing.constant, "frequency": field.ringing.frequency}
    reason = Finding("stop-unsettled", size=length, unit="s", values=rings)
    return [], [field.out(begin, end, reason)]


def _calm(field: Field, begin: int, end: int) -> list[tuple[int, int]]:
    """Stretches of [begin, end) without change of force, the crests of oscillations left out."""
    first, last = runs(~field.disturbed[begin:end])
    calm = [(begin + int(a), begin + int(b)) for a, b in zip(first, last, strict=True)]
    held = round(_TRANSIENT / field.bins.width)
    kept = []
    crest = 0
    for k, (start, stop) in enumerate(calm):
        length = stop - start
        if k + 1 < len(calm) and (length < held or length < calm[k + 1][0] - stop):
            crest = max(crest, length)
        elif k + 1 < len(calm) or length >= 2 * crest:
            kept.append((start, stop))
    return kept
