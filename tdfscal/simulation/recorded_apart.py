"""One campaign as two recorders write it: with clocks, rates, jitter and a gap of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.records import Log, Series


@dataclass(frozen=True, slots=True)
class Apart:
    """The forces' clock against the positions': s, relative; rates in Hz of both recorders.

    offset : of the stamps at the positions' first stamp. late : s, by which the forces' recorder
    begins later. jitter : s, of its stamps. gap : (begin, end), s, in which it lost all samples.
    """

    offset: float = 3.7
    rate: float = 0.0
    late: float = 0.0
    jitter: float = 0.0
    gap: tuple[float, float] | None = None
    position_rate: float | None = None
    force_rate: float | None = None


def recorded_apart(log: Log, how: Apart, rng: np.random.Generator) -> tuple[Log, Log]:
    """The positions' recording and the forces', each without the other's streams."""
    begin = log.position[0].time[0]

    def thinned(series: Series, rate: float | None) -> Series:
        if rate is None:
            return series
        every = max(round(1.0 / (rate * float(np.median(np.diff(series.time))))), 1)
        return Series(series.time[::every], series.value[::every])

    def clocked(series: Series) -> Series:
        since = series.time - begin
        kept = since >= how.late
        if how.gap is not None:
            kept &= (since < how.gap[0]) | (since > how.gap[1])
        since = since[kept]
        stamp = begin + how.offset + since * (1.0 + how.rate)
        shake = how.jitter * rng.uniform(-1.0, 1.0, len(since))
        return Series(np.maximum.accumulate(stamp + shake), series.value[kept])

    nothing = tuple(Series(np.empty(0), np.empty((0, 3))) for _ in log.supports)
    positions = tuple(thinned(series, how.position_rate) for series in log.position)
    forces = tuple(clocked(thinned(series, how.force_rate)) for series in log.force)
    return replace(log, position=positions, force=nothing), replace(
        log, position=nothing, force=forces
    )
