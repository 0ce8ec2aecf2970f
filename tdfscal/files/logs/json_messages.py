"""JSON messages: the wanted numbers, message by message."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from tdfscal.files.logs.chunk import Messages
from tdfscal.files.logs.message_path import Named, Path, shown
from tdfscal.records import FloatArray

_STAMPS = (("header", "stamp"), ("timestamp",))


def read_numbers(messages: Messages, paths: Sequence[Path], *, stamped: bool) -> FloatArray:
    """Return (N, number of paths), float64; with `stamped` the header's time in s comes first.

    Raises
    ------
    ValueError : a message is no JSON, or has no number at a path.
    """
    rows: list[list[float]] = []
    for k in range(messages.offset.size):
        try:
            message = json.loads(messages.bytes_of(k))
        except RecursionError as error:
            raise ValueError("it is nested too deeply") from error
        row = [_stamp(message)] if stamped else []
        row += [_number(message, path) for path in paths]
        rows.append(row)
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(paths) + stamped)


def _stamp(message: Any) -> float:
    for path in _STAMPS:
        stamp: Any = message
        for key in path:
            stamp = stamp.get(key) if isinstance(stamp, dict) else None
        if isinstance(stamp, dict) and "sec" in stamp:
            sub = "nanosec" if "nanosec" in stamp else "nsec"
            return _number(stamp, ("sec",)) + _number(stamp, (sub,)) * 1e-9
    raise ValueError("it has no header.stamp with sec and nanosec")


def _number(message: Any, path: Path) -> float:
    node, parent = message, None
    for step in path:
        inner: Any = None
        if isinstance(step, str):
            inner = node.get(step) if isinstance(node, dict) else None
        elif isinstance(node, list):
            index = _index(parent, step.name) if isinstance(step, Named) else step
            inner = node[index] if index is not None and index < len(node) else None
        parent, node = node, inner
    if isinstance(node, bool) or not isinstance(node, int | float):
        raise ValueError(f"it has no number at {shown(path)}")
    return float(node)


def _index(parent: Any, name: str) -> int | None:
    """Return where the list's sibling `name` has the name, if exactly once."""
    names = parent.get("name") if isinstance(parent, dict) else None
    if not isinstance(names, list) or names.count(name) != 1:
        return None
    return int(names.index(name))
