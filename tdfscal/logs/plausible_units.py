"""Units by plausibility: what hinges' distances, weights and sample intervals can be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from tdfscal.files.rig.recorders import UNITS, canonical, unit_factor
from tdfscal.frozen import record
from tdfscal.logs.contents import Column, Contents, Vector
from tdfscal.logs.text_table import split_label
from tdfscal.records import FloatArray, LogMapping, Rig

_LONGEST: Final = 20.0  # m; hinges further apart are in a smaller unit
_LIGHT: Final = 100.0  # of a terminal's weight in the log's unit; less is kN
_PLAUSIBLE: Final = {"position": (0.01, 100.0, "m"), "force": (1.0, 1e6, "N")}
"""Between what hinges of any rig are apart, and any terminal weighs."""
_INTERVAL: Final = (2e-5, 1.0)  # s, between which recorders take samples
_WHOLE: Final = 0.1  # s; whole numbers that step by more are no seconds
_PATIENCE: Final = 2.0  # s; an interval that is longer is not that of a recording
_SHORTEST: Final = 5.0  # s; no campaign is shorter


@record
class Proposal:
    """A unit to propose. note : why. problem : why what the file itself says cannot be."""

    unit: str
    note: str = ""
    problem: str = ""


def resampled(vectors: Sequence[Vector]) -> FloatArray:
    """(n, N, 3) at common times."""
    start = max(float(v.time[0]) for v in vectors)
    end = min(float(v.time[-1]) for v in vectors)
    t = np.linspace(start, end, 400)
    return np.stack(
        [np.column_stack([np.interp(t, v.time, v.value[:, j]) for j in range(3)]) for v in vectors]
    )


def length_unit(positions: Sequence[Vector], rig: Rig | None) -> Proposal:
    """The unit in which the NCPs are as far apart as the rig's hinges, or as hinges can be."""
    far = _middle(_distances(resampled(positions)))
    known = 0.0
    if rig is not None and rig.n == len(positions):
        known = _middle(_distances(rig.hinge[:, None, :]))
    fitting = next((u for u in ("m", "mm") if far * UNITS["position"][u] <= _LONGEST), "um")
    hinges = f" and the rig's hinges {known:.4g} m" if known else ""
    said = "the NCPs are {} apart" + hinges
    return _proposed("position", (far, known), fitting, positions[0].unit, said)


def force_unit(forces: Sequence[Vector], rig: Rig | None) -> Proposal:
    """The unit in which the forces add up to the terminal's weight, or to what can be one."""
    total = _middle(np.linalg.norm(resampled(forces).sum(axis=0), axis=1))
    weight = 0.0
    if rig is not None and np.isfinite(rig.mass.std):
        weight = float(rig.mass.value) * rig.gravity
    weighs = f" and the terminal weighs {weight:.4g} N" if weight else ""
    check = "" if weight or forces[0].unit else "; check it against the weight"
    said = "the forces add up to {}" + weighs + check
    light = "kN" if total < _LIGHT else "N"
    return _proposed("force", (total, weight), light, forces[0].unit, said)


def _proposed(
    quantity: Literal["position", "force"],
    sizes: tuple[float, float],
    likely: str,
    stated: str | None,
    said: str,
) -> Proposal:
    """The unit of a quantity.

    sizes : in the log's unit, and what it is in SI, 0 where the rig file does not say. likely : the
    unit then. stated : by the file itself. said : what the size is, with a place for the number.
    """
    size, known = sizes
    units, (low, high, si) = UNITS[quantity], _PLAUSIBLE[quantity]
    if known > 0.0:
        likely = min(units, key=lambda unit: abs(np.log(max(size, 1e-9) * units[unit] / known)))
    if stated is None:
        key = {"position": "length_unit", "force": "force_unit"}[quantity]
        return Proposal(likely, f"{key}: {likely}, as {said.format(f'{size:.4g} {likely}')}")
    unit = canonical(stated)
    value = size * units[unit]
    if size <= 0.0 or (unit == likely if known else low <= value <= high):
        return Proposal(unit)
    return _contradicted(unit, f"{unit}, {said.format(f'{value:.4g} {si}')}", likely)


def time_unit(column: Column, suffix: str) -> Proposal:
    """The unit in which the samples' interval is a recorder's; suffix: the name's last word."""
    fitting = _fitting_time_unit(column)
    stated = column.unit is not None and unit_factor("time", column.unit) is not None
    named = canonical(column.unit if column.unit is not None and stated else suffix)
    step = f"the step of {column.name} is {column.step:.4g}"
    doubt = ""
    if named in UNITS["time"]:
        if fitting is None or _recordable(column, named):
            return Proposal(named)
        if stated:
            what = f"{step} {named}, which is no recorder's interval"
            return _contradicted(named, what, fitting)
        doubt = f", though its name says {named}"
    if fitting is None:
        return Proposal("s", f"the unit of {column.name} is unclear; s is taken")
    return Proposal(fitting, f"time unit: {fitting}, as {step} {fitting}{doubt}")


def declared_time(contents: Contents, mapping: LogMapping) -> list[str]:
    """Say where a mapping's unit of time makes of a table something that no recorder writes."""
    name, unit = split_label(mapping.time_field)[0], mapping.time_unit
    column = next((c for c in contents.columns if c.name in (name, mapping.time_field)), None)
    kinds = {f.name: f.kind for stream in contents.streams for f in stream.fields}
    # A column that is a time by its type has its own unit.
    timed = column is None or "time" in kinds[column.name] or kinds[column.name] == "int96"
    if column is None or timed or mapping.rows != "timeseries":
        return []
    fitting = _fitting_time_unit(column)
    if fitting in (None, unit) or _recordable(column, unit):
        return []
    step = column.step * UNITS["time"][canonical(unit)]
    return [
        f"by the mapping's `unit: {unit}` the samples of {column.name} are {step:.4g} s apart, "
        f"which is no recorder's interval; `unit: {fitting}` would fit"
    ]


def _fitting_time_unit(column: Column) -> str | None:
    """The first of s, ms, us, ns in which the column can be a recording's time, if any."""
    whole = bool((column.value == np.rint(column.value)).all())
    span = float(column.value[-1] - column.value[0])
    for unit, factor in UNITS["time"].items():
        longest = _WHOLE if whole and unit == "s" else _INTERVAL[1]
        long_enough = unit == "s" or span * factor >= _SHORTEST
        if long_enough and _INTERVAL[0] <= column.step * factor <= longest:
            return unit
    return None


def _contradicted(unit: str, what: str, fitting: str) -> Proposal:
    """The header's unit, and why it cannot be."""
    problem = f"by the header's unit, {what}; {fitting} would fit: check the header"
    return Proposal(unit, problem=problem)


def _recordable(column: Column, unit: str) -> bool:
    """Can a log be recorded at the column's step in this unit?"""
    return _INTERVAL[0] <= column.step * UNITS["time"][canonical(unit)] <= _PATIENCE


def _distances(points: FloatArray) -> FloatArray:
    """Distances (N, pairs) of points (n, N, 3)."""
    i, j = np.triu_indices(len(points), 1)
    return np.asarray(np.linalg.norm(points[i] - points[j], axis=2).T)


def _middle(value: FloatArray) -> float:
    """Median of what is finite; 0 where nothing is."""
    finite = value[np.isfinite(value)]
    return float(np.median(finite)) if finite.size else 0.0
