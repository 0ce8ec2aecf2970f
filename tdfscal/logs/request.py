"""What is wanted of a log, and the pieces that the readers of all formats hand back."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tdfscal.errors import DataError, RigError
from tdfscal.files.yaml import shorten
from tdfscal.logs import units
from tdfscal.records import BoolArray, FloatArray, LogMapping, Scale


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
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

    def part(self, k: int, parts: int) -> Block:
        """One of so many parts of about the same length."""
        n = len(self.time)
        return self.at(slice(n * k // parts, n * (k + 1) // parts))


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
    length = _factor("position", mapping.length_unit, "length_unit")
    force = _factor("force", mapping.force_unit, "force_unit")
    _factor("time", mapping.time_unit, "time.unit")
    sign = -1.0 if mapping.force_on == "sensor" else 1.0
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
        moves = Signal(name, "position", mapping.position[i], (length,) * 3, mapping.length_unit)
        loads = Signal(name, "force", mapping.force[i], (sign * force,) * 3, mapping.force_unit)
        if moves.fields:
            signals[2 * number] = _scaled(moves, mapping.position_scale[i : i + 1], 1.0)
        if not measured.any():
            loads = replace(loads, fields=moves.fields)  # no sensor: it reads 0 at their times
        if loads.fields:
            loads = _scaled(loads, mapping.force_scale[i : i + 1], sign)
            lacks = not measured.all()
            signals[2 * number + 1] = loads.lacking(measured, moves) if lacks else loads
    for k, (field, owner) in enumerate(zip(mapping.temperature, supports, strict=False)):
        name = owner if len(mapping.temperature) > 1 else "the rig"
        signals[2 * len(supports) + k] = Signal(name, "temperature", (field,) * 3, (1.0,) * 3)
    return Request(tuple(supports), tuple(signals.values()), tuple(signals), mapping, declared)


def _factor(quantity: units.Quantity, unit: str, place: str) -> float:
    if not units.measures(quantity, unit):
        raise RigError(
            f"unknown unit {unit!r}",
            where=f"log.{place}",
            hint=f"use one of {', '.join(units.known_units(quantity))}",
        )
    return units.factor(quantity, unit)


def _scaled(signal: Signal, stated: Sequence[Scale | None], sign: float) -> Signal:
    """The signal, checked, with factors where the mapping states them in place of its unit."""
    if len(signal.fields) not in (1, 3):
        raise RigError(
            f"expected three fields, or one with members x, y, z, got {len(signal.fields)}",
            where=f"log.supports.{signal.support}",
        )
    for scale in stated:
        if scale is not None:
            x, y, z = scale
            return replace(signal, factors=(sign * x, sign * y, sign * z), unit=None)
    return signal


def missing_fields(missing: Sequence[str], present: Iterable[str], *, kind: str) -> DataError:
    """Build the error for fields that a file does not have, with the nearest names it has."""
    names = list(dict.fromkeys(map(shorten, filter(None, present))))
    shown = ", ".join(missing[:4]) + (f" and {len(missing) - 4} more" if len(missing) > 4 else "")
    near = list(dict.fromkeys(n for m in missing[:4] for n in difflib.get_close_matches(m, names)))
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


def without_axis(error: DataError, request: Request) -> DataError:
    """The error; where it names a component of a force, with the line by which that is left out."""
    for signal in request.signals:
        whole = len(signal.fields) == 1 and signal.fields[0] in error.fields
        gone = {name for name in signal.own if whole or name in error.fields}
        if signal.quantity == "force" and gone:
            each = zip("xyz", signal.components, signal.measured, strict=True)
            left = [axis for axis, name, there in each if there and name not in gone]
            line = (
                f"where the sensor does not measure it, write `axes: [{', '.join(left)}]` for "
                f"{signal.support} in rig.yaml"
            )
            return error.restated(hint=f"{error.hint}; {line}" if error.hint else line)
    return error


def join(pieces: Sequence[Piece]) -> Piece:
    """Put consecutive pieces together, clock by clock."""
    if len(pieces) == 1:
        return pieces[0]
    by_clock: dict[str, list[Block]] = {}
    for piece in pieces:
        for block in piece:
            by_clock.setdefault(block.clock, []).append(block)
    return tuple(
        Block(
            clock,
            np.concatenate([b.time for b in blocks]),
            {s: np.concatenate([b.value[s] for b in blocks]) for s in blocks[0].value},
        )
        for clock, blocks in by_clock.items()
    )
