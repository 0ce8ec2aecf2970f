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
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from rosbags.interfaces import Nodetype

from tdfscal.logs.common.message_path import Named, Path, shown
from tdfscal.logs.messages.buffer import DATA, Messages, gather
from tdfscal.logs.messages.ros_types import Definitions, full_name
from tdfscal.records import BoolArray, FloatArray, IntArray

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


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the wanted numbers of a message are.

    places : per wanted path, offset in the message's data and numpy dtype.
    guards : offset and bytes of what must be equal for a message to have this layout.
    size : of the message's data, bytes.
    """

    places: tuple[tuple[int, str], ...]
    guards: tuple[tuple[int, bytes], ...]
    size: int


def layout_of(
    types: Definitions, name: str, paths: Sequence[Path], data: bytes, encoding: str = "cdr"
) -> Layout:
    """Walk one message and note where the paths lead.

    encoding : cdr or ros1.

    Raises
    ------
    ValueError, struct.error : the message is not of this type, or lacks a path.
    """
    walk = _walk(types, data, dict(enumerate(paths)), encoding)
    walk.visit((Nodetype.NAME, full_name(name)), dict.fromkeys(walk.paths, 0), {}, 0)
    padding = 3 if encoding == "cdr" else 0
    if not walk.position <= len(data) <= walk.position + padding:
        raise ValueError(f"it has {len(data)} bytes where its type takes {walk.position}")
    for k, path in walk.paths.items():
        if k not in walk.places:
            raise ValueError(f"it has no number at {shown(path)}")
    places = tuple(walk.places[k] for k in range(len(paths)))
    guards = ((0, data[:2]), *walk.guards) if encoding == "cdr" else tuple(walk.guards)
    return Layout(places, guards, len(data))


def _walk(types: Definitions, data: bytes, paths: dict[int, Path], encoding: str) -> _Walk:
    """Begin a walk; raises ValueError where a message does not begin as its encoding does."""
    if encoding != "cdr":
        return _Walk(types, data, "<", paths, position=0, aligned=False)
    if len(data) < _ENCAPSULATION or data[:2] not in (b"\x00\x00", b"\x00\x01"):
        raise ValueError("its encapsulation is not plain CDR")
    return _Walk(types, data, "<" if data[1] else ">", paths)


def element_names(types: Definitions, name: str, data: bytes, encoding: str) -> list[str]:
    """Names that a message gives to the elements of its lists, as JointState does.

    Raises
    ------
    ValueError, struct.error : the message is not of this type.
    """
    walk = _walk(types, data, {0: (Named(""),)}, encoding)
    walk.visit((Nodetype.NAME, full_name(name)), {}, {}, 0)
    return walk.names


@dataclass(slots=True)
class _Walk:
    types: Definitions
    data: bytes
    order: str
    paths: dict[int, Path]
    position: int = _ENCAPSULATION
    aligned: bool = True
    places: dict[int, tuple[int, str]] = field(default_factory=dict)
    guards: list[tuple[int, bytes]] = field(default_factory=list)
    visits: int = 0
    names: list[str] = field(default_factory=list)

    def visit(
        self, node: Any, wanted: Mapping[int, int], siblings: Mapping[str, int], depth: int
    ) -> None:
        """Walk a field. wanted : path's number → how many of its steps lead here."""
        self.visits += 1
        if depth > _MAX_DEPTH or self.visits > _MAX_VISITS or len(self.guards) > _MAX_GUARDS:
            raise ValueError("it has too many fields, or too deep ones")
        kind, detail = node
        if kind == Nodetype.NAME:
            if detail not in self.types:
                raise ValueError(f"its type {detail} is not defined")
            names: dict[str, int] = {}
            for name, member in self.types[detail]:
                inner = {k: d + 1 for k, d in wanted.items() if self._step(k, d) == name}
                if name == "name" and self._is_list_of_strings(member):
                    self._names(member, names)
                else:
                    self.visit(member, inner, names, depth + 1)
        elif kind == Nodetype.BASE:
            self._base(detail[0], wanted)
        else:
            element, bound = detail
            count = bound if kind == Nodetype.ARRAY else self._count()
            self._elements(element, count, wanted, siblings, depth)

    def _base(self, base: str, wanted: Mapping[int, int]) -> None:
        if base == "string":
            self._text()
            return
        if base not in _NUMBERS:
            raise ValueError(f"its field type {base} is not supported")
        dtype = np.dtype(self.order + _NUMBERS[base])
        self._align(dtype.itemsize)
        for k, depth in wanted.items():
            if depth == len(self.paths[k]):
                self.places[k] = (self.position, dtype.str)
        self._advance(dtype.itemsize)

    def _elements(
        self,
        element: Any,
        count: int,
        wanted: Mapping[int, int],
        siblings: Mapping[str, int],
        depth: int,
    ) -> None:
        chosen: dict[int, dict[int, int]] = {}
        for k, d in wanted.items():
            step = self._step(k, d)
            index = siblings.get(step.name) if isinstance(step, Named) else step
            if isinstance(index, int) and 0 <= index < count:
                chosen.setdefault(index, {})[k] = d + 1
        kind, detail = element
        if kind == Nodetype.BASE and detail[0] in _NUMBERS:
            dtype = np.dtype(self.order + _NUMBERS[detail[0]])
            if count:
                self._align(dtype.itemsize)
            for index, here in chosen.items():
                for k, d in here.items():
                    if d == len(self.paths[k]):
                        self.places[k] = (self.position + index * dtype.itemsize, dtype.str)
            self._advance(count * dtype.itemsize)
            return
        if count > len(self.data):
            raise ValueError("a list is longer than the message")
        for index in range(count):
            before = self.position
            self.visit(element, chosen.get(index, {}), {}, depth + 1)
            if self.position == before:
                raise ValueError("a list has elements without content")

    def _names(self, node: Any, names: dict[str, int]) -> None:
        """Walk a list of strings that names the elements of its siblings; guard its contents."""
        kind, (_, bound) = node
        count = bound if kind == Nodetype.ARRAY else self._count()
        if count > len(self.data):
            raise ValueError("a list is longer than the message")
        by_name = any(isinstance(step, Named) for path in self.paths.values() for step in path)
        if count > _MAX_GUARDS:
            raise ValueError(f"it names {count} elements")
        for index in range(count):
            start, text = self._text()
            if by_name:
                self.guards.append((start, text))
                name = text.rstrip(b"\0").decode("utf-8")
                if name in names:
                    raise ValueError(f"it names {name} twice")
                names[name] = index
                self.names.append(name)

    def _text(self) -> tuple[int, bytes]:
        length = self._count()
        start = self.position
        self._advance(length)
        return start, self.data[start : self.position]

    def _count(self) -> int:
        self._align(4)
        start = self.position
        self._advance(4)
        raw = self.data[start : self.position]
        self.guards.append((start, raw))
        (value,) = struct.unpack(self.order + "I", raw)
        return int(value)

    def _align(self, size: int) -> None:
        if self.aligned:
            self.position += (_ENCAPSULATION - self.position) % size

    def _advance(self, size: int) -> None:
        self.position += size
        if self.position > len(self.data):
            raise ValueError("it is shorter than its type")

    def _step(self, k: int, depth: int) -> Any:
        path = self.paths[k]
        return path[depth] if depth < len(path) else None

    @staticmethod
    def _is_list_of_strings(node: Any) -> bool:
        kind, detail = node
        return kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) and detail[0] == (
            Nodetype.BASE,
            ("string", 0),
        )


class Gatherer:
    """Reads the wanted numbers of one channel's messages.

    Parameters
    ----------
    types, name : the channel's message definitions and type.
    paths : the wanted numbers.
    encoding : cdr or ros1.
    """

    def __init__(
        self, types: Definitions, name: str, paths: Sequence[Path], encoding: str = "cdr"
    ) -> None:
        self._types, self._name, self._paths = types, name, tuple(paths)
        self._encoding = encoding
        self._recent: Layout | None = None

    def __call__(self, messages: Messages) -> FloatArray:
        """Return (N, number of paths), float64.

        Raises
        ------
        ValueError, struct.error : a message is not of its type.
        """
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
        return layout_of(self._types, self._name, self._paths, data, self._encoding)

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
