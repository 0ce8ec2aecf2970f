"""Messages that a library decodes one by one, as JSON: the wanted numbers of each."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

import numpy as np

from tdfscal.logs.common.message_path import Named, Path, shown
from tdfscal.logs.messages.buffer import Messages
from tdfscal.records import FloatArray

_STAMPS: Final = (("header", "stamp"), ("timestamp",), ("header", "timestamp"))
_PARTS: Final = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"))
_LARGEST: Final = 4 << 20  # bytes

Inner = Callable[[Any, str | int | Named, Any], Any]
"""(node, step, the node above) → what the step leads to, None where it leads nowhere."""


class ReadNumbers(Protocol):
    """Reads (N, number of paths), float64; with `stamped` the header's time in s comes first.

    Raises ValueError where a message cannot be decoded, or has no number at a path.
    """

    def __call__(self, messages: Messages, paths: Sequence[Path], *, stamped: bool) -> FloatArray:
        """Read the wanted numbers of each message."""
        ...


def content_of(messages: Messages, k: int) -> bytes:
    """Return the data of message k; raises ValueError where it is too large to decode."""
    if messages.length[k] > _LARGEST:
        raise ValueError(f"it has {messages.length[k]} bytes")
    return messages.bytes_of(k)


def read_rows(
    messages: Messages,
    paths: Sequence[Path],
    decode: Callable[[bytes], Any],
    inner: Inner,
    *,
    stamped: bool,
) -> FloatArray:
    """Return (N, number of paths), float64; with `stamped` the header's time in s comes first.

    Raises
    ------
    ValueError : a message cannot be decoded, or has no number at a path.
    """
    rows: list[list[float]] = []
    for k in range(messages.offset.size):
        message = decode(content_of(messages, k))
        row = [_stamp(message, inner)] if stamped else []
        for path in paths:
            number = _number(message, path, inner)
            if number is None:
                raise ValueError(f"it has no number at {shown(path)}")
            row.append(number)
        rows.append(row)
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(paths) + stamped)


def _stamp(message: Any, inner: Inner) -> float:
    for path in _STAMPS:
        for whole, part in _PARTS:
            seconds = _number(message, (*path, whole), inner)
            rest = None if seconds is None else _number(message, (*path, part), inner)
            if seconds is not None and rest is not None:
                return seconds + rest * 1e-9
    raise ValueError("it has no header.stamp, nor timestamp, with seconds and nanoseconds")


def _number(message: Any, path: Path, inner: Inner) -> float | None:
    node, above = message, None
    for step in path:
        node, above = inner(node, step, above), node
    if isinstance(node, bool) or not isinstance(node, int | float):
        return None
    return float(node)


def read_json(messages: Messages, paths: Sequence[Path], *, stamped: bool) -> FloatArray:
    """As `ReadNumbers`, of JSON."""
    return read_rows(messages, paths, json_of, _inner_of_json, stamped=stamped)


def json_of(content: bytes) -> Any:
    """Parse a message; raises ValueError where it is no JSON."""
    try:
        return json.loads(content)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def _inner_of_json(node: Any, step: str | int | Named, above: Any) -> Any:
    if isinstance(step, str) and isinstance(node, list):
        step = Named(step)
    if isinstance(step, str):
        return node.get(step) if isinstance(node, dict) else None
    if not isinstance(node, list):
        return None
    index = _index(above, step.name) if isinstance(step, Named) else step
    return node[index] if index is not None and index < len(node) else None


def _index(parent: Any, name: str) -> int | None:
    """Return where the list's sibling `name` has the name, if exactly once."""
    names = parent.get("name") if isinstance(parent, dict) else None
    if not isinstance(names, list) or names.count(name) != 1:
        return None
    return int(names.index(name))
