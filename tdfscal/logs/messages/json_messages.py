"""Messages in JSON, parsed one by one."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from tdfscal.logs.messages.buffer import Messages
from tdfscal.logs.messages.paths import (
    MAX_DEPTH,
    Leaf,
    Path,
    Read,
    has_axes,
    path_text,
    struct_leaf,
)
from tdfscal.records import FloatArray

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
