"""ROS messages: where the wanted numbers are, found once per layout of a message.

A message's layout is fixed by its type and by the contents of a few places: the lengths of its
strings and sequences (the guards). Messages that agree in size and guards with one that was
walked are read by gathering bytes, the others are walked in turn.
ROS 2 writes OMG CDR (XCDR1: primitives aligned to their size, counted from after the
encapsulation), ROS 1 the same without alignment and encapsulation.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from rosbags.interfaces import Nodetype

from tdfscal.logs.messages.buffer import DATA, Messages, Named, Path, gather, path_text
from tdfscal.records import BoolArray, FloatArray, IntArray

Definitions = Mapping[str, Sequence[tuple[str, Any]]]
"""Message type → its fields in order, each as (name, rosbags' description of its type)."""

_ENCAPSULATION: Final = 4
_MAX_DEPTH: Final = 32
_MAX_VISITS: Final = 1 << 18
_MAX_GUARDS: Final = 1 << 12
_MAX_LAYOUTS: Final = 32
_NUMBERS: Final[dict[str, str]] = {
    "bool": "?", "byte": "u1", "octet": "u1", "char": "u1", "int8": "i1", "uint8": "u1",
    "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip


_ANY: Final = Named("")


class Layout:
    """Where the wanted numbers of a message are, found on one way through it.

    places : per wanted path, offset in the message's data and numpy dtype.
    guards : offset and bytes of what must be equal for a message to have this layout.
    size : of the message's data, bytes. names : given to the elements of its lists, as JointState
    does.
    """

    def __init__(
        self, types: Definitions, name: str, paths: Sequence[Path], data: bytes, encoding: str
    ) -> None:
        """Walk one message, encoded as cdr or ros1.

        Raises ValueError or struct.error where it is not of this type, or lacks a path.
        """
        self._aligned = encoding == "cdr"
        begins = data[:2] in (b"\x00\x00", b"\x00\x01") and len(data) >= _ENCAPSULATION
        if self._aligned and not begins:
            raise ValueError("its encapsulation is not plain CDR")
        self._types, self._data, self.size = types, data, len(data)
        self._order = ">" if self._aligned and not data[1] else "<"
        self._by_name = any(isinstance(step, Named) for path in paths for step in path)
        self._visits = 0
        self._position = _ENCAPSULATION if self._aligned else 0
        self._found: dict[int, tuple[int, str]] = {}
        self.guards: list[tuple[int, bytes]] = [(0, data[:2])] if self._aligned else []
        self.names: list[str] = []
        self._visit((Nodetype.NAME, name), dict(enumerate(paths)), {}, 0)
        if not self._position <= self.size <= self._position + (3 if self._aligned else 0):
            raise ValueError(f"it has {self.size} bytes where its type takes {self._position}")
        for k, path in enumerate(paths):
            if k not in self._found and path != (_ANY,):
                raise ValueError(f"it has no number at {path_text(path)}")
        self.places = [self._found[k] for k in sorted(self._found)]

    def _visit(
        self, node: Any, wanted: Mapping[int, Path], siblings: Mapping[str, int], depth: int
    ) -> None:
        """Walk a field. wanted : path's number → the steps of it that are left."""
        self._visits += 1
        if depth > _MAX_DEPTH or self._visits > _MAX_VISITS or len(self.guards) > _MAX_GUARDS:
            raise ValueError("it has too many fields, or too deep ones")
        kind, detail = node
        if kind == Nodetype.BASE:
            self._base(detail[0], wanted)
        elif kind != Nodetype.NAME:
            element, bound = detail
            count = bound if kind == Nodetype.ARRAY else self._count()
            self._elements(element, count, wanted, siblings, depth)
        elif detail not in self._types:
            raise ValueError(f"its type {detail} is not defined")
        else:
            names: dict[str, int] = {}
            for name, member in self._types[detail]:
                inner = {k: rest[1:] for k, rest in wanted.items() if rest and rest[0] == name}
                if name == "name" and _is_list_of_strings(member):
                    self._names(member, names)
                else:
                    self._visit(member, inner, names, depth + 1)

    def _base(self, base: str, wanted: Mapping[int, Path]) -> None:
        if base == "string":
            self._text()
        elif base in _NUMBERS:
            self._numbers(base, 1, {0: wanted})
        else:
            raise ValueError(f"its field type {base} is not supported")

    def _numbers(self, base: str, count: int, chosen: Mapping[int, Mapping[int, Path]]) -> None:
        """Pass so many numbers; chosen : paths by the number that they lead to."""
        dtype = np.dtype(self._order + _NUMBERS[base])
        if count:
            self._align(dtype.itemsize)
        for index, wanted in chosen.items():
            for k, rest in wanted.items():
                if not rest:
                    self._found[k] = (self._position + index * dtype.itemsize, dtype.str)
        self._advance(count * dtype.itemsize)

    def _elements(
        self,
        element: Any,
        count: int,
        wanted: Mapping[int, Path],
        siblings: Mapping[str, int],
        depth: int,
    ) -> None:
        chosen: dict[int, dict[int, Path]] = {}
        for k, (step, *rest) in ((k, path) for k, path in wanted.items() if path):
            index = siblings.get(step.name) if isinstance(step, Named) else step
            if isinstance(index, int) and 0 <= index < count:
                chosen.setdefault(index, {})[k] = tuple(rest)
        kind, detail = element
        if kind == Nodetype.BASE and detail[0] in _NUMBERS:
            self._numbers(detail[0], count, chosen)
            return
        self._check(count)
        for index in range(count):
            before = self._position
            self._visit(element, chosen.get(index, {}), {}, depth + 1)
            if self._position == before:
                raise ValueError("a list has elements without content")

    def _names(self, node: Any, names: dict[str, int]) -> None:
        """Walk a list of strings that names the elements of its siblings; guard its contents."""
        kind, (_, bound) = node
        count = bound if kind == Nodetype.ARRAY else self._count()
        self._check(count)
        if count > _MAX_GUARDS:
            raise ValueError(f"it names {count} elements")
        for index in range(count):
            start, text = self._text()
            if self._by_name:
                self.guards.append((start, text))
                name = text.rstrip(b"\0").decode("utf-8")
                if name in names:
                    raise ValueError(f"it names {name} twice")
                names[name] = index
                self.names.append(name)

    def _check(self, count: int) -> None:
        if count > len(self._data):
            raise ValueError("a list is longer than the message")

    def _text(self) -> tuple[int, bytes]:
        length = self._count()
        start = self._position
        self._advance(length)
        return start, self._data[start : self._position]

    def _count(self) -> int:
        self._align(4)
        start = self._position
        self._advance(4)
        raw = self._data[start : self._position]
        self.guards.append((start, raw))
        (value,) = struct.unpack(self._order + "I", raw)
        return int(value)

    def _align(self, size: int) -> None:
        if self._aligned:
            self._position += (_ENCAPSULATION - self._position) % size

    def _advance(self, size: int) -> None:
        self._position += size
        if self._position > len(self._data):
            raise ValueError("it is shorter than its type")


def _is_list_of_strings(node: Any) -> bool:
    kind, detail = node
    is_list = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
    return is_list and detail[0] == (Nodetype.BASE, ("string", 0))


def element_names(types: Definitions, name: str, data: bytes, encoding: str) -> list[str]:
    """Names that a message gives to the elements of its lists; raises as `Layout`."""
    return Layout(types, name, [(_ANY,)], data, encoding).names


class Gatherer:
    """Reads the wanted numbers of one channel's messages, encoded as cdr or ros1."""

    def __init__(
        self, types: Definitions, name: str, paths: Sequence[Path], encoding: str = "cdr"
    ) -> None:
        self._types, self._name, self._paths = types, name, tuple(paths)
        self._encoding = encoding
        self._recent: Layout | None = None

    def __call__(self, messages: Messages) -> FloatArray:
        """Return (N, number of paths); raises as `Layout`."""
        result = np.empty((messages.offset.size, len(self._paths)))
        left = np.arange(messages.offset.size)
        for _ in range(_MAX_LAYOUTS):
            if left.size == 0:
                return result
            layout = self._recent
            if layout is None or not self._fits(messages, left[:1], layout).all():
                layout = self._recent = self._layout(messages, int(left[0]))
            fits = self._fits(messages, left, layout)
            self._read(messages, left[fits], layout, result)
            left = left[~fits]
        # So many layouts that looking for the next message of each does not pay.
        for k in left:
            self._read(messages, np.array([k]), self._layout(messages, int(k)), result)
        return result

    def _layout(self, messages: Messages, k: int) -> Layout:
        data = messages.bytes_of(k)
        return Layout(self._types, self._name, self._paths, data, self._encoding)

    def _fits(self, messages: Messages, left: IntArray, layout: Layout) -> BoolArray:
        fits: BoolArray = messages.length[left] == layout.size
        if not fits.any():
            return fits
        # A message of another size may end before a guard; its bytes are not looked at.
        start = messages.offset[left[fits]] + DATA
        same = np.ones(start.size, dtype=bool)
        for offset, expected in layout.guards:
            if expected:
                found = gather(messages.data, start + offset, f"V{len(expected)}")
                same &= found == np.void(expected)
        fits[fits] = same
        return fits

    def _read(self, messages: Messages, chosen: IntArray, layout: Layout, out: FloatArray) -> None:
        start = messages.offset[chosen] + DATA
        k = 0
        while k < len(layout.places):
            offset, dtype = layout.places[k]
            size = np.dtype(dtype).itemsize
            # Neighbours of one type, as x, y, z are, come in one gather.
            run = 1
            while k + run < len(layout.places) and layout.places[k + run] == (
                offset + run * size,
                dtype,
            ):
                run += 1
            raw = gather(messages.data, start + offset, f"V{run * size}")
            out[chosen, k : k + run] = raw.view(dtype).reshape(-1, run)
            k += run
