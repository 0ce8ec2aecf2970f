"""A campaign whose positions and forces were recorded apart, each by a clock of its own."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.files.saving import to_yaml
from tdfscal.files.writers.campaign import rig_document
from tdfscal.records import Log, Rig, Series


@dataclass(frozen=True)
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


def write_apart(folder: Path, rig: Rig, moves: Log, loads: Log) -> None:
    """Write rig.yaml, cnc.csv (ms, mm, semicolons, decimal commas) and daq.csv (s, kN).

    moves : with the positions alone. loads : with the forces alone, on a clock of its own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    places = {name: [f"X{i}", f"Y{i}", f"Z{i}"] for i, name in enumerate(rig.supports, 1)}
    forces = {name: [f"F{i}{a}" for a in "xyz"] for i, name in enumerate(rig.supports, 1)}
    with (folder / "cnc.csv").open("w", encoding="ascii") as file:
        file.write(";".join(["t", *(c for own in places.values() for c in own)]) + "\n")
        values = np.hstack([series.value for series in moves.position]) * 1e3
        for time, row in zip(moves.position[0].time, values, strict=True):
            line = ";".join([f"{1e3 * time:.3f}", *(f"{value:.4f}" for value in row)])
            file.write(line.replace(".", ",") + "\n")
    with (folder / "daq.csv").open("w", encoding="ascii") as file:
        file.write(",".join(["Time", *(c for own in forces.values() for c in own)]) + "\n")
        values = np.hstack([series.value for series in loads.force]) / 1e3
        for time, row in zip(loads.force[0].time, values, strict=True):
            file.write(",".join([f"{time:.6f}", *(f"{value:.6f}" for value in row)]) + "\n")
    blocks: list[dict[str, Any]] = [
        {
            "files": "cnc*.csv",
            "time": {"field": "t", "unit": "ms"},
            "length_unit": "mm",
            "decimal": ",",
            "supports": {name: {"position": own} for name, own in places.items()},
        },
        {
            "files": "daq*.csv",
            "time": {"field": "Time", "unit": "s"},
            "force_unit": "kN",
            "supports": {name: {"force": own} for name, own in forces.items()},
        },
    ]
    document = rig_document(rig) | {"log": blocks}
    (folder / "rig.yaml").write_text(to_yaml(document), encoding="utf-8")
