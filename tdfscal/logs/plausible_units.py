"""Units by plausibility: what hinges' distances, weights and sample intervals can be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from tdfscal.files.units import UNITS, Quantity, canonical, unit_factor
from tdfscal.frozen import record
from tdfscal.logs.contents import Column, Contents, Vector
from tdfscal.logs.text.header import split_label
from tdfscal.records import FloatArray, LogMapping, Rig

_APART: Final = (0.01, 100.0)  # m, between which hinges of any rig are apart
_LONGEST: Final = 20.0  # m; hinges further apart are in a smaller unit
_LIGHT: Final = 100.0  # of a terminal's weight in the log's unit; less is kN
_WEIGHT: Final = (1.0, 1e6)  # N, between which any terminal weighs
_INTERVAL: Final = (2e-5, 1.0)  # s, between which recorders take samples
_WHOLE: Final = 0.1  # s; whole numbers that step by more are no seconds
_PATIENCE: Final = 2.0  # s; an interval that is longer is not that of a recording
_SHORTEST: Final = 5.0  # s; no campaign is shorter


@record
class Proposal:
    """A unit to propose. notes : why. problems : why what the file itself says cannot be."""

    unit: str
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()


def resampled(vectors: Sequence[Vector]) -> FloatArray:
    """(n, N, 3) at common times."""
    start = max(float(v.time[0]) for v in vectors)
    end = min(float(v.time[-1]) for v in vectors)
    t = np.linspace(start, end, 400)
    return np.stack(
        [np.column_stack([np.interp(t, v.time, v.value[:, j]) for j in range(3)]) for v in vectors]
    )


def distances(positions: Sequence[Vector]) -> FloatArray:
    """(N, pairs of supports), in the log's unit."""
    return _between(resampled(positions))


def length_unit(positions: Sequence[Vector], rig: Rig | None) -> Proposal:
    """The unit in which the NCPs are as far apart as the rig's hinges, or as hinges can be."""
    far = _middle(distances(positions))
    known = 0.0
    if rig is not None and rig.n == len(positions):
        known = _middle(_between(rig.hinge[:, None, :]))
    fitting = next((u for u in ("m", "mm") if far * UNITS["position"][u] <= _LONGEST), "um")
    hinges = f" and the rig's hinges {known:.4g} m" if known else ""
    return _proposed(
        "position", far, known, fitting, positions[0].unit, "the NCPs are {} apart" + hinges
    )


def force_unit(forces: Sequence[Vector], rig: Rig | None) -> Proposal:
    """The unit in which the forces add up to the terminal's weight, or to what can be one."""
    total = _middle(np.linalg.norm(resampled(forces).sum(axis=0), axis=1))
    weight = 0.0
    if rig is not None and np.isfinite(rig.mass.std):
        weight = float(rig.mass.value) * rig.gravity
    light = "kN" if total < _LIGHT else "N"
    weighs = f" and the terminal weighs {weight:.4g} N" if weight else ""
    check = "" if weight or forces[0].unit else "; check it against the weight"
    said = "the forces add up to {}" + weighs + check
    return _proposed("force", total, weight, light, forces[0].unit, said)


def _proposed(
    quantity: Literal["position", "force"],
    size: float,
    known: float,
    likely: str,
    stated: str | None,
    said: str,
) -> Proposal:
    """The unit of a size in the log's unit.

    known : what it is in SI, 0 where the rig file does not say. likely : unit where it does not.
    stated : by the file itself. said : what the size is, with a place for the number.
    """
    fitting = _nearest(quantity, size, known) if known > 0.0 else likely
    if stated is None:
        key = {"position": "length_unit", "force": "force_unit"}[quantity]
        return Proposal(fitting, (f"{key}: {fitting}, as {said.format(f'{size:.4g} {fitting}')}",))
    unit = canonical(stated)
    value = size * UNITS[quantity][unit]
    limits, si = {"position": (_APART, "m"), "force": (_WEIGHT, "N")}[quantity]
    if size <= 0.0 or (unit == fitting if known else _within(value, limits)):
        return Proposal(unit)
    what = f"{unit}, {said.format(f'{value:.4g} {si}')}"
    return _contradicted(unit, what, fitting, rig=known > 0.0)


def time_unit(column: Column, suffix: str) -> Proposal:
    """The unit in which the samples' interval is a recorder's; suffix: the name's last word."""
    fitting = fitting_time_unit(column)
    step = f"the step of {column.name} is {column.step:.4g}"
    if column.unit is not None and unit_factor("time", column.unit) is not None:
        unit = canonical(column.unit)
        if fitting is None or _recordable(column, unit):
            return Proposal(unit)
        what = f"{step} {unit}, which is no recorder's interval"
        return _contradicted(unit, what, fitting, rig=False)
    named = canonical(suffix)
    if named in UNITS["time"] and (fitting is None or _recordable(column, named)):
        return Proposal(named)
    if fitting is None:
        return Proposal("s", (f"the unit of {column.name} is unclear; s is taken",))
    doubt = f", though its name says {named}" if named in UNITS["time"] else ""
    return Proposal(fitting, (f"time unit: {fitting}, as {step} {fitting}{doubt}",))


def fitting_time_unit(column: Column) -> str | None:
    """The first of s, ms, us, ns in which the column can be a recording's time, if any."""
    whole = bool((column.value == np.rint(column.value)).all())
    span = float(column.value[-1] - column.value[0])
    for unit in UNITS["time"]:
        factor = UNITS["time"][unit]
        longest = _WHOLE if whole and unit == "s" else _INTERVAL[1]
        long_enough = unit == "s" or span * factor >= _SHORTEST
        if long_enough and _within(column.step * factor, (_INTERVAL[0], longest)):
            return unit
    return None


def declared_time(contents: Contents, mapping: LogMapping) -> list[str]:
    """Say where a mapping's unit of time makes of a table something that no recorder writes."""
    if mapping.rows != "timeseries":
        return []
    name, unit = split_label(mapping.time_field)[0], mapping.time_unit
    column = next((c for c in contents.columns if c.name in (name, mapping.time_field)), None)
    kinds = {f.name: f.kind for stream in contents.streams for f in stream.fields}
    # A column that is a time by its type has its own unit.
    if column is None or "time" in kinds[column.name] or kinds[column.name] == "int96":
        return []
    fitting = fitting_time_unit(column)
    if fitting in (None, unit) or _recordable(column, unit):
        return []
    step = column.step * UNITS["time"][canonical(unit)]
    return [
        f"by the mapping's `unit: {unit}` the samples of {column.name} are {step:.4g} s apart, "
        f"which is no recorder's interval; `unit: {fitting}` would fit"
    ]


def _contradicted(unit: str, what: str, fitting: str, *, rig: bool) -> Proposal:
    """The header's unit, and why it cannot be; rig : whether the rig file says so."""
    check = "check the header and the rig file" if rig else "check the header"
    problem = f"by the header's unit, {what}; {fitting} would fit: {check}"
    return Proposal(unit, problems=(problem,))


def _recordable(column: Column, unit: str) -> bool:
    """Can a log be recorded at the column's step in this unit?"""
    return _within(column.step * UNITS["time"][canonical(unit)], (_INTERVAL[0], _PATIENCE))


def _between(points: FloatArray) -> FloatArray:
    """Distances (N, pairs) of points (n, N, 3)."""
    i, j = np.triu_indices(len(points), 1)
    return np.asarray(np.linalg.norm(points[i] - points[j], axis=2).T)


def _middle(value: FloatArray) -> float:
    """Median of what is finite; 0 where nothing is."""
    finite = value[np.isfinite(value)]
    return float(np.median(finite)) if finite.size else 0.0


def _nearest(quantity: Quantity, value: float, known: float) -> str:
    """The unit in which a value comes nearest to what it should be, by ratio."""

    def off(unit: str) -> float:
        return abs(float(np.log(max(value, 1e-9) * UNITS[quantity][unit] / known)))

    return min(UNITS[quantity], key=off)


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
