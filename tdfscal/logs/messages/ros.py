"""Messages of ROS 1 and 2: what their types hold, and paths within them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from mcap.records import Schema
from rosbags.interfaces import Nodetype

from tdfscal.logs.common.message_path import Named, Path, shown
from tdfscal.logs.messages.buffer import Messages
from tdfscal.logs.messages.cdr import Gatherer, element_names
from tdfscal.logs.messages.encodings import MAX_DEPTH, Encoding, Leaf, Read, has_axes
from tdfscal.logs.messages.ros_types import definitions, full_name
from tdfscal.records import FloatArray

_STAMP: Final[tuple[Path, Path]] = (("header", "stamp", "sec"), ("header", "stamp", "nanosec"))
_SHOWN: Final = 12


class Ros(Encoding):
    """Messages of a type by its definition; encoding : cdr or ros1."""

    def __init__(self, schema: Schema, encoding: str) -> None:
        self._name, self._encoding = schema.name, encoding
        self._types = definitions(schema.name, schema.encoding, schema.data.decode("utf-8"))
        try:
            self.stamped = all(map(self.checked, _STAMP))
        except ValueError:
            self.stamped = False

    def leaves(self, first: bytes) -> Iterator[Leaf]:
        """What there is in messages of the type."""
        yield from self._leaves(full_name(self._name), (), 0)

    def _leaves(self, name: str, path: Path, depth: int) -> Iterator[Leaf]:
        members = dict(self._types.get(name, ()))
        if has_axes(members.keys()):
            yield Leaf.struct(path, name)
            return
        if not members or depth == MAX_DEPTH:
            yield Leaf(path, name)
            return
        for member, (kind, detail) in members.items():
            here = (*path, member)
            if kind == Nodetype.NAME:
                yield from self._leaves(detail, here, depth + 1)
            elif kind == Nodetype.BASE:
                yield Leaf(here, detail[0])
            else:
                (inner, what), _ = detail
                yield Leaf(here, f"{what[0] if inner == Nodetype.BASE else what}[]")

    def names(self, first: bytes) -> Sequence[str]:
        """Texts of the list `name`."""
        return element_names(self._types, self._name, first, self._encoding)

    def checked(self, path: Path) -> Path:
        """As `Encoding.checked`; a name that follows a list is that of one of its elements."""
        node: Any = (Nodetype.NAME, full_name(self._name))
        steps: list[str | int | Named] = []
        for k, step in enumerate(path):
            kind, detail = node
            place = shown(path[:k]) or self._name
            if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
                steps.append(Named(step) if isinstance(step, str) else step)
                node = detail[0]
                continue
            if not isinstance(step, str):
                raise ValueError(f"{place} of {self._name} is no list")
            fields = dict(self._types.get(detail, ())) if kind == Nodetype.NAME else {}
            if step not in fields:
                has = ", ".join(list(fields)[:_SHOWN]) + (", …" if len(fields) > _SHOWN else "")
                raise ValueError(
                    f"no field {step} in {place}; it has {has or 'no fields'}: name a field with "
                    "x, y, z, or three fields"
                )
            steps.append(step)
            node = fields[step]
        return tuple(steps)

    def reader(self, paths: Sequence[Path], *, stamped: bool) -> Read:
        """As `Encoding.reader`; NaN for a time with more than 1e9 ns to the second."""
        whole = [*_STAMP, *paths] if stamped else paths
        gatherer = Gatherer(self._types, self._name, whole, self._encoding)
        if not stamped:
            return gatherer

        def read(messages: Messages) -> FloatArray:
            numbers = gatherer(messages)
            seconds, nanoseconds = numbers[:, 0], numbers[:, 1]
            numbers[:, 1] = np.where(nanoseconds < 1e9, seconds + nanoseconds / 1e9, np.nan)
            return numbers[:, 1:]

        return read
