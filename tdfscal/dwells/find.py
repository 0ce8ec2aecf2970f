"""Log → dwells, with statistics, temperatures and what is left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from scipy.special import ndtri

from tdfscal.dwells.averaged_postures import postures_as_dwells
from tdfscal.dwells.bins import Bins, reduce_to_bins, zeros
from tdfscal.dwells.clock_offset import misaligned, motion_offset
from tdfscal.dwells.dwell_means import (
    Extent,
    Moments,
    dwell_moments,
    still_since,
    whole_range,
)
from tdfscal.dwells.field import Field, prepare, within
from tdfscal.dwells.search import INTERRUPTED, search
from tdfscal.dwells.thermometer import Thermometer
from tdfscal.errors import DataError, expect
from tdfscal.findings import Finding
from tdfscal.records import Dwells, LeftOut, Log
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
