"""Log → dwells, with statistics, temperatures and what is left out; also of averaged postures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np
from scipy.special import ndtri

from tdfscal.dwells.bins import Bins, reduce_to_bins, zeros
from tdfscal.dwells.clock_offset import misaligned, motion_offset
from tdfscal.dwells.dwell_means import (
    Extent,
    Moments,
    dwell_moments,
    force_extremes,
    still_since,
    whole_range,
)
from tdfscal.dwells.field import Field, prepare, within
from tdfscal.dwells.search import INTERRUPTED, search
from tdfscal.errors import DataError, expect
from tdfscal.findings import Finding, Value
from tdfscal.records import Dwells, FloatArray, IntArray, LeftOut, Log
from tdfscal.significance import DRIFT_PER_LOG

_SAMPLE = 60  # rests that the first two rounds look at
_DIGITS = range(9, 1, -1)  # after the point, that files are rounded to in m and N
_EPS = 1e-12
_STEP = 0.5  # s; a temperature changes slowly, and is kept as means over this time


def find_dwells(pieces: Log | Iterable[Log]) -> Dwells:
    """Static dwells of a log: NCPs at rest, forces settled.

    Parameters
    ----------
    pieces : one log, or its consecutive pieces; streams may differ in rate. It is read once and
        reduced to bins on the way, so memory does not grow with the log. With rows == "postures"
        each row is one dwell, without scatter.

    Raises
    ------
    DataError
        for an empty log, times that step back, readings that are not numbers, or forces seconds
        behind the positions. A log without a dwell is no error here: `left_out` says why.
    """
    expect("pieces", pieces, Iterable | Log, "what read_log returns, or its consecutive pieces")
    stream = iter([pieces] if isinstance(pieces, Log) else pieces)
    first = next(stream, None)
    if first is None:
        raise DataError("the log is empty", hint="give a log with recorded samples")
    expect("pieces", first, Log, "what read_log returns")
    said: list[Finding] = []
    thermometer = Thermometer()

    def noted() -> Iterator[Log]:
        for piece in chain([first], stream):
            said.extend(finding for finding in piece.findings if finding not in said)
            yield piece

    rest = thermometer.passing(noted())
    if first.rows == "postures":
        found = postures_as_dwells(rest)
    else:
        bins = reduce_to_bins(rest)
        found = dwells_of_bins(bins)
        if late := misaligned(bins, found):
            raise DataError(late)
    return replace(
        found,
        findings=(*said, *found.findings),
        temperature=thermometer.at(found.start, found.end, len(found.supports)),
    )


def dwells_of_bins(bins: Bins) -> Dwells:
    """The same from bins.

    The search runs three times: the first round shows the noise of the dwells without settling,
    and that of long means, which the next weigh against the bias that settling leaves. A sample of
    the stops is enough for the first two.
    """
    field = prepare(bins)
    long_run = field.long_run
    extents, left_out = search(field, long_run, rough=True, some=_SAMPLE)
    for some in (_SAMPLE, None):
        if extents:
            field = within(field, extents)
            # Of a bin as it counts in a long mean.
            density = np.median(dwell_moments(bins, extents).density, axis=0)
            found = np.sqrt((density / (bins.width / bins.period)[:, None]).ravel())
            long_run = np.where(found > 0, found, field.long_run)
        extents, left_out = search(field, long_run, some=some)
    dwells = _with_statistics(field, extents, left_out)
    if not len(dwells):
        from tdfscal.dwells.absence import explain  # of logs without any

        return replace(dwells, absence=explain(bins, field.moving, field.shortest * bins.width))
    if dropped := zeros(bins):
        dwells = replace(dwells, findings=(*dwells.findings, dropped))
    offset = motion_offset(bins, dwells)
    if offset is not None and offset.large:
        return replace(dwells, findings=(*dwells.findings, offset.finding))
    return dwells


def _with_statistics(field: Field, extents: list[Extent], left_out: list[LeftOut]) -> Dwells:
    bins, n = field.bins, len(field.bins.supports)
    moments = dwell_moments(bins, extents)
    found = _drifts(field, extents, moments)
    if wrong := [out.start for out in left_out if out.reason.code == INTERRUPTED]:
        found.append(Finding("readings-return", size=len(wrong), values={"first": min(wrong)}))
    low, high = force_extremes(bins, extents)
    return Dwells(
        supports=bins.supports,
        start=np.array([field.time(extent.begin) for extent in extents]),
        end=np.array([field.time(extent.end - 1) + bins.width for extent in extents]),
        position=moments.mean[:, :n],
        position_cov=moments.cov[:, :n],
        force=moments.mean[:, n:],
        force_cov=moments.cov[:, n:],
        force_min=low,
        force_max=high,
        count=moments.count[:, n:],
        effective=moments.effective[:, n:],
        left_out=tuple(sorted(left_out, key=lambda out: out.start)),
        findings=tuple(found),
        force_range=whole_range(bins),
        force_still=still_since(bins),
    )


def _drifts(field: Field, extents: list[Extent], moments: Moments) -> list[Finding]:
    """Dwells with a line that their noise does not explain."""
    if not extents:
        return []
    bins, n = field.bins, len(field.bins.supports)
    z = float(-ndtri(0.5 * DRIFT_PER_LOG / moments.drift.size))
    limit = z * moments.drift_std + 1.001 * bins.quantum + 1e-12 * np.abs(moments.mean)
    significant = np.abs(moments.drift) > limit
    found: list[Finding] = []
    for k, extent in enumerate(extents):
        if significant[k].any():
            strength = np.where(significant[k], np.abs(moments.drift[k]) / limit[k], 0.0)
            stream, axis = np.unravel_index(int(np.argmax(strength)), strength.shape)
            found.append(
                Finding(
                    "dwell-drifts" if stream < n else "dwell-force-drifts",
                    (bins.supports[stream % n],),
                    float(moments.drift[k, stream, axis]),
                    "m" if stream < n else "N",
                    values={
                        "begin": field.time(extent.begin),
                        "end": field.time(extent.end),
                        "axis": "xyz"[axis],
                    },
                )
            )
    return found


def postures_as_dwells(pieces: Iterable[Log]) -> Dwells:
    """Each row is one dwell: mean as recorded, covariance zero, one sample.

    A row that repeats an earlier one is the same recording (a copy of a file, an export to a second
    format, doubled rows); it counts once, and a warning says so.

    Raises
    ------
    DataError
        where the streams have different numbers of rows, or a reading is not a number.
    """
    logs = list(pieces)
    supports = logs[0].supports
    if any(log.supports != supports for log in logs):
        raise DataError("the logs name different supports", hint="give logs of one rig")
    time, position, force = [], [], []
    for log in logs:
        rows = {len(series.time) for series in (*log.position, *log.force)}
        if len(rows) != 1:
            raise DataError(
                f"the streams hold different numbers of postures, {sorted(rows)}",
                hint="give one row per posture with every position and force",
            )
        time.append(log.force[0].time)
        position.append(np.stack([s.value for s in log.position], axis=1))
        force.append(np.stack([s.value for s in log.force], axis=1))
    t, p, f = np.concatenate(time), np.concatenate(position), np.concatenate(force)
    if not len(t):
        raise DataError("the log holds no posture", hint="give one row per posture")
    for row in np.flatnonzero(~(np.isfinite(p) & np.isfinite(f)).all(axis=(1, 2))):
        raise DataError(
            "a reading is not a number", where=f"posture {row + 1}", hint="leave this posture out"
        )
    keep, found = _once(position, force)
    t, p, f = t[keep], p[keep], f[keep]
    zero = np.zeros((*f.shape, 3))
    return Dwells(
        supports=supports,
        start=t,
        end=t.copy(),
        position=p,
        position_cov=zero,
        force=f,
        force_cov=zero.copy(),
        force_min=f.copy(),
        force_max=f.copy(),
        count=np.ones(f.shape[:2], dtype=np.int64),
        effective=np.ones(f.shape[:2]),
        findings=found,
        force_range=np.stack([f.min(axis=0), f.max(axis=0)]),
    )


def _once(
    position: list[FloatArray], force: list[FloatArray]
) -> tuple[IntArray, tuple[Finding, ...]]:
    """Rows of all files to keep, each once, and what to say of the others."""
    files = list(zip(position, force, strict=True))
    value = np.concatenate([np.concatenate(of, axis=1).reshape(len(of[0]), -1) for of in files])
    resolution = np.concatenate([np.tile(_resolution(*of), (len(of[0]), 1)) for of in files])
    repeats = _repeated(value, resolution)
    if not repeats:
        return np.arange(len(value)), ()
    later, earlier = min(repeats.items())
    values: dict[str, Value] = {
        "postures": len(value),
        "later": later + 1,
        "earlier": earlier + 1,
    }
    said = Finding("postures-repeated", size=len(repeats), values=values)
    return np.setdiff1d(np.arange(len(value)), list(repeats)), (said,)


def _resolution(position: FloatArray, force: FloatArray) -> FloatArray:
    """Power of ten (6n,) that all readings of a file's columns are multiples of; 0 for none."""
    value = np.concatenate([position, force], axis=1).reshape(len(position), -1)
    resolution = np.zeros(value.shape[1])
    for digits in _DIGITS:
        rest = np.abs(np.round(value, digits) - value)
        coarse = (rest <= _EPS * (1.0 + np.abs(value))).all(axis=0)
        resolution[coarse] = 10.0**-digits
    return resolution


def _repeated(value: FloatArray, resolution: FloatArray) -> dict[int, int]:
    """Rows (K, A) that equal an earlier one as far as both are resolved: row → that one."""
    repeats: dict[int, int] = {}
    lively = int(np.argmax([len(np.unique(column)) for column in value.T]))
    key = value[:, lively]
    order = np.argsort(key, kind="stable")
    reach = 1.02 * float(resolution[:, lively].max()) + _EPS * float(np.abs(key).max())
    for step in range(1, len(value)):
        a, b = order[:-step], order[step:]
        close = key[b] - key[a] <= reach
        if not close.any():
            break
        a, b = a[close], b[close]
        limit = 0.51 * (resolution[a] + resolution[b]) + _EPS * np.abs(value[a])
        same = (np.abs(value[a] - value[b]) <= limit).all(axis=1)
        for one, other in zip(a[same].tolist(), b[same].tolist(), strict=True):
            first, second = sorted((one, other))
            repeats[second] = min(first, repeats.get(second, first))
    return repeats


@dataclass(slots=True)
class Thermometer:
    """Lets pieces of a log pass and keeps their temperatures as means over short steps.

    time, value : per field, pieces of (steps,), s and °C.
    """

    rows: bool = False
    time: list[list[FloatArray]] = field(default_factory=list)
    value: list[list[FloatArray]] = field(default_factory=list)

    def passing(self, pieces: Iterable[Log]) -> Iterator[Log]:
        """Pass pieces on."""
        for piece in pieces:
            self.rows = piece.rows == "postures"
            self.time = self.time or [[] for _ in piece.temperature]
            self.value = self.value or [[] for _ in piece.temperature]
            for series, time, value in zip(piece.temperature, self.time, self.value, strict=True):
                known = np.isfinite(series.value[:, 0])
                if known.any():
                    stamps, celsius = series.time[known], series.value[known, 0]
                    step = np.floor(stamps / _STEP) if not self.rows else stamps
                    first = np.flatnonzero(np.append(True, np.diff(step) > 0))
                    count = np.diff(np.append(first, len(step)))
                    time.append(np.add.reduceat(stamps, first) / count)
                    value.append(np.add.reduceat(celsius, first) / count)
            yield piece

    def at(self, start: FloatArray, end: FloatArray, n: int) -> FloatArray | None:
        """Mean temperature (K, n), °C, over K stretches at n sensors; None where none is recorded.

        A stretch without a sample gets what lies between its neighbours. Raises DataError where a
        field holds no number.
        """
        if not self.time:
            return None
        columns = []
        for times, values in zip(self.time, self.value, strict=True):
            if not times:
                raise DataError(Finding("temperature-unreadable"))
            time, value = np.concatenate(times), np.concatenate(values)
            total = np.append(0.0, np.cumsum(value))
            first, last = np.searchsorted(time, start), np.searchsorted(time, end, side="right")
            count = last - first
            between = np.interp((start + end) / 2, time, value)
            mean = (total[last] - total[first]) / np.maximum(count, 1)
            columns.append(np.where(count > 0, mean, between))
        return np.stack(columns if len(columns) > 1 else columns * n, axis=1)
