"""Log → dwells: rows that are postures already, or the search; temperatures; why none was found."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from scipy.special import ndtri

from tdfscal.dwells.bins import Bins, reduce_to_bins, zeros
from tdfscal.dwells.clock_offset import misaligned, motion_offset, with_offset
from tdfscal.dwells.dwell_means import Extent, Moments, Thermometer, dwell_moments, still_since
from tdfscal.dwells.field import SHORTEST, Field, prepare, within
from tdfscal.dwells.noise_level import runs
from tdfscal.dwells.search import WRONG, search
from tdfscal.errors import DataError, expect
from tdfscal.findings import Finding, Value
from tdfscal.records import Absence, BoolArray, Dwells, FloatArray, IntArray, LeftOut, Log
from tdfscal.significance import DRIFT_PER_LOG

_SAMPLE = 60  # rests that the first two rounds look at


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
        offset = motion_offset(bins, found)
        if late := misaligned(bins, found, offset):
            raise DataError(late)
        found = with_offset(found, offset)
    return replace(
        found,
        findings=(*said, *found.findings),
        temperature=thermometer.at(found.start, found.end, len(found.supports)),
    )


def dwells_of_bins(bins: Bins) -> Dwells:
    """The same from bins; how the clocks of forces and positions stand is not looked at.

    The search runs three times: the first round shows the noise of the dwells without settling,
    and that of long means, which the next weigh against the bias that settling leaves. A sample of
    the stops is enough for the first two.
    """
    field = prepare(bins)
    # A first guess, from the longest windows whose noise was measured.
    width = 2 ** (len(field.noise.difference) - 1)
    long_run = field.noise.of_mean(width) * np.sqrt(width)
    extents, left_out = search(field, long_run, rough=True, some=_SAMPLE)
    for some in (_SAMPLE, None):
        if extents:
            field = within(field, extents)
            # Of a bin as it counts in a long mean.
            density = np.median(dwell_moments(bins, extents).density, axis=0)
            found = np.sqrt((density / (bins.width / bins.period)[:, None]).ravel())
            long_run = np.where(found > 0, found, long_run)
        extents, left_out = search(field, long_run, some=some)
    dwells = _with_statistics(field, extents, left_out)
    if not len(dwells):
        return replace(dwells, absence=explain(bins, field.moving, field.shortest * bins.width))
    if dropped := zeros(bins):
        dwells = replace(dwells, findings=(*dwells.findings, dropped))
    return dwells


def _with_statistics(field: Field, extents: list[Extent], left_out: list[LeftOut]) -> Dwells:
    bins, n = field.bins, len(field.bins.supports)
    moments = dwell_moments(bins, extents)
    found = _drifts(field, extents, moments)
    middle, low, high = (x.transpose(1, 2, 0) for x in (bins.mean[:, n:], bins.low, bins.high))
    if wrong := [out.start for out in left_out if out.reason.code in WRONG]:
        found.append(Finding("readings-return", size=len(wrong), values={"first": min(wrong)}))
    return Dwells(
        supports=bins.supports,
        start=np.array([field.time(extent.begin) for extent in extents]),
        end=np.array([field.time(extent.end - 1) + bins.width for extent in extents]),
        position=moments.mean[:, :n],
        position_cov=moments.cov[:, :n],
        force=moments.mean[:, n:],
        force_cov=moments.cov[:, n:],
        force_min=moments.low,
        force_max=moments.high,
        count=moments.count[:, n:],
        effective=moments.effective[:, n:],
        left_out=tuple(sorted(left_out, key=lambda out: out.start)),
        findings=tuple(found),
        force_range=np.stack([np.nanmin(middle + low, axis=2), np.nanmax(middle + high, axis=2)]),
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


_DIGITS = range(9, 1, -1)  # after the point, that files are rounded to in m and N
_EPS = 1e-12


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
    """Rows of all files to keep, each once, and what to say of the others.

    Rows are compared as far as the file with the fewest digits resolves each column.
    """
    files = [
        np.concatenate(of, axis=1).reshape(len(of[0]), -1)
        for of in zip(position, force, strict=True)
    ]
    value = np.concatenate(files)
    resolution = np.max([_resolution(own) for own in files], axis=0)
    resolution = np.maximum(resolution, _EPS * (1.0 + np.abs(value).max(axis=0)))
    steps = np.round(value / resolution)
    first, group = np.unique(steps, axis=0, return_index=True, return_inverse=True)[1:]
    earlier = first[group.ravel()]
    later = np.flatnonzero(earlier < np.arange(len(value)))
    if not len(later):
        return np.arange(len(value)), ()
    values: dict[str, Value] = {
        "postures": len(value),
        "later": int(later[0]) + 1,
        "earlier": int(earlier[later[0]]) + 1,
    }
    return np.sort(first), (Finding("postures-repeated", size=len(later), values=values),)


def _resolution(value: FloatArray) -> FloatArray:
    """Power of ten (6n,) that all readings (K, 6n) of a column are multiples of; 0 for none."""
    resolution = np.zeros(value.shape[1])
    for digits in _DIGITS:
        rest = np.abs(np.round(value, digits) - value)
        coarse = (rest <= _EPS * (1.0 + np.abs(value))).all(axis=0)
        resolution[coarse] = 10.0**-digits
    return resolution


_SAMPLES = 20  # per stop: ten for the shortest dwell, as many for what is kept clear of moves
_STOP = 2.0  # s, that a stop should last at least


def no_dwell(dwells: Dwells) -> DataError:
    """The error for a log without any dwell."""
    absence = dwells.absence or Absence(
        "the NCPs never rest with settled forces", "hold each posture for at least two seconds"
    )
    return DataError(f"no static dwell was found: {absence.seen}", where="log", hint=absence.advice)


def explain(bins: Bins, moving: BoolArray, shortest: float) -> Absence:
    """Say why no stretch of the log passes.

    moving : (B,), where the search sees the NCPs move. shortest : s, of a dwell.
    """
    if found := zeros(bins):
        return Absence(
            f"the {found.values['signal']} of {found.subject[0]} drops to 0, 0, 0 and returns, at "
            f"{100 * (found.size or 0.0):.2g} % of the samples, as if the recorder wrote zeros "
            "where it had no reading",
            "let the recorder leave such cells empty, or repeat the last reading",
        )
    begin, end = runs(~moving)
    rest, period = float((end - begin).max(initial=0) * bins.width), float(bins.period.max())
    if _SAMPLES / 2 * period >= max(rest, SHORTEST):
        stop, rate = _rounded_up(_SAMPLES * period), _rounded_up(_SAMPLES / max(rest, _STOP))
        return Absence(
            f"sampled too slowly: there is a sample every {period:.3g} s, a dwell takes "
            f"{_SAMPLES / 2:.0f} of them, and the NCPs rest for {rest:.2g} s at most",
            f"record at {rate:g} Hz or more, or hold each posture for at least {stop:g} s",
            stop,
        )
    if not len(begin):
        return Absence(
            "the NCPs never rest: their positions change from the first sample to the last",
            f"hold each posture for at least {_STOP:g} s, and check that the position fields are "
            "those of the NCPs, unfiltered",
        )
    if rest < shortest:
        return Absence(
            f"the stops are too short: the NCPs rest {len(begin)} times, for {rest:.2g} s at most, "
            f"and a dwell takes {shortest:.2g} s of settled forces",
            f"hold each posture for at least {_STOP:g} s",
            _STOP,
        )
    stop = _rounded_up(2.0 * rest + _STOP)
    return Absence(
        f"the NCPs rest for up to {rest:.2g} s, and the forces never settle meanwhile: a smoothing "
        "filter, slow settling, or a touch",
        "switch the smoothing of sensor, amplifier or recorder off, look whether something touches "
        f"the terminal, or hold each posture for at least {stop:g} s",
        stop,
    )


def _rounded_up(value: float) -> float:
    """To two digits, never less."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(np.ceil(value / digit - 1e-9) * digit)
