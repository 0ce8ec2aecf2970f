"""What is wanted of a log, and the pieces that the readers of all formats hand back."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from tdfscal.errors import DataError, RigError
from tdfscal.files.yaml import shorten
from tdfscal.findings import Finding
from tdfscal.logs.common import units
from tdfscal.logs.common.contents import Contents
from tdfscal.records import BoolArray, FloatArray, IntArray, Integrity, LogMapping, Scale

_FEW_ROWS = 16
_OFTEN = 0.1
"""Share of the first rows that a slow stream leaves empty at least; a hole is rarer."""


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
    describe : the reader notes what else is in the file, too.
    """

    supports: tuple[str, ...]
    signals: tuple[Signal, ...]
    numbers: tuple[int, ...]
    mapping: LogMapping
    declared: bool
    describe: bool = False


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


Piece = tuple[Block, ...]
Reached = Callable[[int], None]
"""Told how many bytes of a file are read, now and then."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a reader has to say when a file is at its end.

    contents : where it is to describe it. cut_at : byte at which a file that was cut short stops
    being whole; None of one that is whole.
    """

    integrity: Integrity
    findings: tuple[Finding, ...] = ()
    contents: Contents | None = None
    cut_at: int | None = None


Items = Generator[Piece | Outcome, None, None]


class Reader(Protocol):
    """A format's reader: yields pieces of bounded size, and last the outcome.

    What is whole of a file that was cut short is read. Raises DataError on whatever is wrong
    within; it names the place, and leaves the file's name to its caller (`damage.placed`).
    """

    def __call__(self, path: Path, request: Request, *, reached: Reached) -> Items:
        """Read one file."""
        ...


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


def columns_of(request: Request, present: Sequence[str]) -> dict[str, int]:
    """Where each wanted column of a table is; without the time where postures have none.

    Raises DataError where one is missing or there twice, RigError where the mapping names a field
    twice: two sensors would read the same numbers.
    """
    seen: dict[str, Signal] = {}
    for signal in request.signals:
        for name in signal.own:
            other = seen.setdefault(name, signal)
            if other is not signal and {other.quantity, signal.quantity} != {"temperature"}:
                raise RigError(
                    f"field {name} is named twice, for the {other.quantity} of {other.support} "
                    f"and for the {signal.quantity} of {signal.support}",
                    where="log.supports",
                )
    wanted = dict.fromkeys(name for signal in request.signals for name in signal.components)
    mapping = request.mapping
    if mapping.rows == "timeseries" or mapping.time_field in present:
        wanted = {mapping.time_field: None} | wanted
    if missing := [name for name in wanted if name not in present]:
        raise missing_fields(missing, present, kind="column")
    for name in wanted:
        if (times := present.count(name)) > 1:
            what = f"column {name} is there {times} times"
            raise DataError(what, hint="give each column its own name", fields=(name,))
    return {name: present.index(name) for name in wanted}


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


def split(piece: Piece, limit: int) -> list[Piece]:
    """Cut a piece so that no stream has more than `limit` samples in one part."""
    longest = max((len(block.time) for block in piece), default=0)
    parts = max(-(-longest // limit), 1)

    def part(block: Block, k: int) -> Block:
        n = len(block.time)
        return block.at(slice(n * k // parts, n * (k + 1) // parts))

    return [tuple(part(block, k) for block in piece) for k in range(parts)]


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


def table_piece(
    request: Request,
    vectors: FloatArray,
    factors: Sequence[tuple[float, float, float]],
    time: FloatArray | None,
    row: int,
    *,
    sparse: bool,
) -> Piece:
    """The next rows of a table.

    vectors : (signals, 3, N), as recorded; scaled in place. factors : of each signal, to SI.
    time : (N,), s; None where rows are counted, from `row` on. sparse : streams have times of their
    own, and NaN stands where a signal has no values.
    """
    vectors *= np.array(factors)[:, :, None]
    value = {number: vector.T for number, vector in enumerate(vectors)}
    if time is None:
        return (Block("row", np.arange(row, row + vectors.shape[2], dtype=np.float64), value),)
    clock = f"column {request.mapping.time_field}"
    if not sparse:
        return (Block(clock, time, value),)
    parts = []
    for number, vector in value.items():
        there = ~np.isnan(vector[:, 0])
        signal = request.signals[number]
        name = f"{clock} for the {signal.quantity} of {signal.support}"
        parts.append(Block(name, time[there], {number: vector[there]}))
    return tuple(parts)


def takes_turns(filled: IntArray) -> bool:
    """Whether a table is of streams with times of their own, by the cells of its first rows.

    filled : (signals, rows), how many of x, y, z are there. Two signals stand in for each other,
    or one is absent from many rows. A signal that is absent now and then is a hole.
    """
    there, absent = filled == 3, filled == 0
    alone = (there.astype(int) @ absent.T.astype(int)) > 0
    often = filled.shape[1] >= _FEW_ROWS and bool(absent.mean(axis=1).max() >= _OFTEN)
    return bool(np.any(alone & alone.T)) or often
