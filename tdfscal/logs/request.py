"""What is wanted of a log, and the pieces that the readers of all formats give."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np

from tdfscal.errors import DataError, RigError
from tdfscal.files.rig.recorders import UNITS, Dimension, canonical, unit_factor
from tdfscal.files.yaml import shorten
from tdfscal.frozen import record, replace
from tdfscal.records import BoolArray, FloatArray, LogMapping


@record
class Signal:
    """One vector signal of one support, as the file has it.

    fields : three names, or one that has the members x, y, z; of a temperature, one name thrice.
    factors : of x, y, z, from the file's unit and sign to SI and tdfscal's sign.
    unit : of the file; None where the mapping states factors in its place.
    measured : which of x, y, z there are; where one is not, the field named is another that is read
        anyway, and its values mean nothing.
    """

    support: str
    quantity: Literal["position", "force", "temperature"]
    fields: tuple[str, ...]
    factors: tuple[float, float, float]
    unit: str | None = None
    measured: tuple[bool, bool, bool] = (True, True, True)

    @property
    def components(self) -> tuple[str, ...]:
        """The three fields by name."""
        if len(self.fields) == 1:
            return tuple(f"{self.fields[0]}.{axis}" for axis in "xyz")
        return self.fields

    @property
    def own(self) -> tuple[str, ...]:
        """Fields that are measured, each once."""
        pairs = zip(self.components, self.measured, strict=True)
        return tuple(dict.fromkeys(name for name, there in pairs if there))

    def lacking(self, axes: BoolArray, instead: Signal) -> Signal:
        """The signal without axes: what is not measured is read from what is there instead."""
        x, y, z = (bool(axis) for axis in axes)
        there = [name for name, axis in zip(self.components, axes, strict=True) if axis]
        other = (there or instead.components)[0]
        names = [name if axis else other for name, axis in zip(self.components, axes, strict=True)]
        return replace(self, fields=tuple(names), measured=(x, y, z))


@record
class Request:
    """What is wanted of the files of one recorder.

    numbers : of each signal: 2i the position of support i, 2i + 1 its force; those of the
    temperatures, one or one per support, come last, from 2n on.
    declared : the rig has a `log` block; without one, a unit that the file names is honoured.
    """

    supports: tuple[str, ...]
    signals: tuple[Signal, ...]
    numbers: tuple[int, ...]
    mapping: LogMapping
    declared: bool


@record
class Block:
    """New samples of the signals that share one clock.

    clock : what the clock is called in messages: a column or a topic.
    time : (N,), s, as recorded: not yet checked to ascend.
    value : signal's number → (N, 3), SI, tdfscal's sign, finite.
    """

    clock: str
    time: FloatArray
    value: Mapping[int, FloatArray]

    def at(self, rows: slice | BoolArray) -> Block:
        """Some of the samples."""
        return Block(self.clock, self.time[rows], {s: v[rows] for s, v in self.value.items()})


Piece = tuple[Block, ...]


def make_request(
    mapping: LogMapping | None, supports: Sequence[str], axes: BoolArray | None = None
) -> Request:
    """Resolve the mapping, or the default field names, for the supports wanted.

    axes : (n, 3), what their sensors measure; no field of another axis is looked at.

    Raises RigError for a support without fields, or a unit that is not known.
    """
    declared = mapping is not None
    if mapping is None:
        mapping = LogMapping.default(tuple(supports))
    declarations: tuple[tuple[Dimension, str, str], ...] = (
        ("position", mapping.length_unit, "length_unit"),
        ("force", mapping.force_unit, "force_unit"),
        ("time", mapping.time_unit, "time.unit"),
    )
    for quantity, unit, place in declarations:
        if unit_factor(quantity, unit) is None:
            hint = f"use one of {', '.join(UNITS[quantity])}"
            raise RigError(f"unknown unit {unit!r}", where=f"log.{place}", hint=hint)
    signals: dict[int, Signal] = {}
    for number, name in enumerate(supports):
        if name not in mapping.supports:
            raise RigError(
                f"the log block names no fields for support {name}",
                where="log.supports",
                hint=f"add {name} with its position and force",
            )
        i = mapping.supports.index(name)
        measured = np.ones(3, dtype=np.bool_) if axes is None else axes[number]
        moves = signal_of(mapping, "position", i, mapping.position[i])
        # Without a sensor it reads 0, at the times of the positions.
        loads = signal_of(
            mapping, "force", i, mapping.force[i] if measured.any() else mapping.position[i]
        )
        if moves.fields:
            signals[2 * number] = moves
        if loads.fields:
            whole = bool(measured.all())
            signals[2 * number + 1] = loads if whole else loads.lacking(measured, moves)
    for k, (field, owner) in enumerate(zip(mapping.temperature, supports, strict=False)):
        name = owner if len(mapping.temperature) > 1 else "the rig"
        signals[2 * len(supports) + k] = Signal(name, "temperature", (field,) * 3, (1.0,) * 3)
    return Request(tuple(supports), tuple(signals.values()), tuple(signals), mapping, declared)


def signal_of(
    mapping: LogMapping, quantity: Literal["position", "force"], i: int, fields: tuple[str, ...]
) -> Signal:
    """The signal of support i, with factors where the mapping states them in place of its unit."""
    name = mapping.supports[i]
    if len(fields) not in (0, 1, 3):
        raise RigError(
            f"expected three fields, or one with members x, y, z, got {len(fields)}",
            where=f"log.supports.{name}",
        )
    unit, scales = mapping.length_unit, mapping.position_scale
    if quantity == "force":
        unit, scales = mapping.force_unit, mapping.force_scale
    stated = scales[i] if scales else None
    x, y, z = stated or (UNITS[quantity][canonical(unit)],) * 3
    sign = -1.0 if quantity == "force" and mapping.force_on == "sensor" else 1.0
    factors = (sign * x, sign * y, sign * z)
    return Signal(name, quantity, fields, factors, None if stated else unit)


def missing_fields(missing: Sequence[str], present: Iterable[str], *, kind: str) -> DataError:
    """Build the error for fields that a file does not have, with the nearest names it has."""
    names = list(dict.fromkeys(map(shorten, filter(None, present))))
    shown = ", ".join(missing[:4]) + (f" and {len(missing) - 4} more" if len(missing) > 4 else "")
    near = list(dict.fromkeys(n for m in missing[:4] for n in _nearest(m, names)))
    if near:
        nearest = f"the nearest that it has: {', '.join(near[:6])}"
    elif names:
        nearest = f"it has {', '.join(names[:8])}{', …' if len(names) > 8 else ''}"
    else:
        nearest = "it has none"
    return DataError(
        f"no {kind} {shown}; {nearest}",
        hint="name the fields in the log block of rig.yaml as the recorder names them",
        fields=missing,
    )


def _nearest(name: str, names: list[str]) -> list[str]:
    """Names like it; of a list of that very name, its elements."""
    elements = [n for n in names if n.startswith(f"{name}[")]
    return elements or difflib.get_close_matches(name, names)


def with_cure(error: DataError, request: Request) -> DataError:
    """The error, where it names fields, with what to do where no sensor measures them."""
    for signal in request.signals:
        whole = len(signal.fields) == 1 and signal.fields[0] in error.fields
        gone = {name for name in signal.own if whole or name in error.fields}
        if gone and signal.quantity == "force":
            each = zip("xyz", signal.components, signal.measured, strict=True)
            left = [axis for axis, name, there in each if there and name not in gone]
            line = f"`axes: [{', '.join(left)}]` for {signal.support} in rig.yaml"
            cure = f"where the sensor does not measure it, write {line}"
            return error.restated(hint=f"{error.hint}; {cure}" if error.hint else cure)
    return error
