"""What messages of ROS 1, ROS 2 and in JSON hold, and paths within them."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from mcap.records import Schema
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.base import TypesysError

from tdfscal.logs.messages.buffer import (
    MAX_DEPTH,
    Leaf,
    Messages,
    Named,
    Path,
    Read,
    has_axes,
    path_text,
    struct_leaf,
)
from tdfscal.logs.messages.cdr import Definitions, Gatherer, element_names
from tdfscal.records import FloatArray

_STAMP: Final[tuple[Path, Path]] = (("header", "stamp", "sec"), ("header", "stamp", "nanosec"))
_SHOWN: Final = 12


class Ros:
    """Messages of a type by its definition; encoding : cdr or ros1."""

    def __init__(self, schema: Schema, encoding: str) -> None:
        self._name, self._encoding = full_name(schema.name), encoding
        self._types = definitions(schema.name, schema.encoding, schema.data.decode("utf-8"))
        try:
            self.stamped = all(map(self.checked, _STAMP))
        except ValueError:
            self.stamped = False

    def leaves(self, first: bytes) -> Iterator[Leaf]:
        """What there is in messages of the type."""
        yield from self._leaves(self._name, (), 0)

    def _leaves(self, name: str, path: Path, depth: int) -> Iterator[Leaf]:
        members = dict(self._types.get(name, ()))
        if has_axes(members.keys()):
            yield struct_leaf(path, name)
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
        """The path as the messages have it: a name that follows a list is that of an element.

        Raises ValueError where it leads nowhere.
        """
        node: Any = (Nodetype.NAME, self._name)
        steps: list[str | int | Named] = []
        for k, step in enumerate(path):
            kind, detail = node
            place = path_text(path[:k]) or self._name
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
        """Return what reads (N, number of paths); with `stamped` the header's time, s, comes first.

        That is NaN with more than 1e9 ns to the second. It raises ValueError or struct.error where
        a message is not of its type or lacks a number.
        """
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


@functools.lru_cache(maxsize=64)
def definitions(name: str, encoding: str, text: str) -> Definitions:
    """Parse a schema's text; the parser is slow, and channels share their schemas.

    Raises ValueError where the text is no message definition, or of an unknown encoding.
    """
    try:
        if encoding == "ros2" and not text:
            types = _standard()
            if full_name(name) not in types:
                raise ValueError(f"the recording has no definition of {name}")
        elif encoding in ("ros2msg", "ros1msg"):
            types = get_types_from_msg(text, name)
        elif encoding == "ros2idl":
            types = get_types_from_idl(text)
        else:
            raise ValueError(f"schema encoding {encoding!r} is not known")
    except (TypesysError, KeyError, IndexError, AttributeError, RecursionError) as error:
        raise ValueError(f"the definition of {name} cannot be read") from error
    result: dict[str, Sequence[tuple[str, Any]]] = {
        key: list(fields) for key, (_, fields) in types.items()
    }
    # What ROS 2 knows without a definition.
    pair = [("sec", (Nodetype.BASE, ("int32", 0))), ("nanosec", (Nodetype.BASE, ("uint32", 0)))]
    for known in ("Time", "Duration"):
        result.setdefault(f"builtin_interfaces/msg/{known}", pair)
    if full_name(name) not in result:
        raise ValueError(f"the definition of {name} is of another message")
    return result


@functools.cache
def _standard() -> Mapping[str, Any]:
    """Definitions of the messages that ROS 2 brings along, for recorders that store none."""
    return get_typestore(Stores.LATEST).fielddefs


def full_name(name: str) -> str:
    """geometry_msgs/Point → geometry_msgs/msg/Point."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


_STAMPS: Final = (("header", "stamp"), ("timestamp",), ("header", "timestamp"))
_PARTS: Final = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"))
_LARGEST: Final = 4 << 20  # bytes


class Json:
    """Messages in JSON; their type does not say whether they have a header with a time."""

    stamped: bool | None = None

    def leaves(self, first: bytes) -> Iterator[Leaf]:
        """What there is in a message."""
        yield from _leaves(_parsed(first), (), 0)

    def checked(self, path: Path) -> Path:
        """The path as the messages have it."""
        return path

    def reader(self, paths: Sequence[Path], *, stamped: bool) -> Read:
        """Return what reads (N, number of paths); with `stamped` the header's time, s, comes first.

        That raises ValueError where a message is none, or lacks a number.
        """

        def read(messages: Messages) -> FloatArray:
            rows = []
            for k in range(messages.offset.size):
                message = _parsed(messages.bytes_of(k))
                time = [_stamp(message)] if stamped else []
                rows.append([*time, *(_required(message, path) for path in paths)])
            return np.array(rows, dtype=np.float64).reshape(len(rows), len(paths) + stamped)

        return read


def _parsed(content: bytes) -> Any:
    if len(content) > _LARGEST:
        raise ValueError(f"it has {len(content)} bytes")
    try:
        return json.loads(content)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def _stamp(message: Any) -> float:
    for path in _STAMPS:
        for parts in _PARTS:
            seconds, rest = (_number(message, (*path, part)) for part in parts)
            if seconds is not None and rest is not None:
                return seconds + rest * 1e-9
    raise ValueError("it has no header.stamp, nor timestamp, with seconds and nanoseconds")


def _required(message: Any, path: Path) -> float:
    number = _number(message, path)
    if number is None:
        raise ValueError(f"it has no number at {path_text(path)}")
    return number


def _number(message: Any, path: Path) -> float | None:
    node = message
    for step in path:
        if isinstance(node, dict) and isinstance(step, str):
            node = node.get(step)
        elif isinstance(node, list) and isinstance(step, int) and step < len(node):
            node = node[step]
        else:
            return None
    if isinstance(node, bool) or not isinstance(node, int | float):
        return None
    return float(node)


def _leaves(value: Any, path: Path, depth: int) -> Iterator[Leaf]:
    if not isinstance(value, dict) or depth == MAX_DEPTH:
        yield Leaf(path, type(value).__name__)
    elif has_axes(value.keys()):
        yield struct_leaf(path, "object")
    else:
        for key, member in value.items():
            yield from _leaves(member, (*path, str(key)), depth + 1)
