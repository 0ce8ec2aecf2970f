"""JSON messages: the wanted numbers, message by message."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from tdfscal.logs.common.message_path import Named, Path
from tdfscal.logs.messages.buffer import Messages
from tdfscal.logs.messages.decoded import read_rows
from tdfscal.records import FloatArray


def read_numbers(messages: Messages, paths: Sequence[Path], *, stamped: bool) -> FloatArray:
    """Return (N, number of paths), float64; with `stamped` the header's time in s comes first.

    Raises
    ------
    ValueError : a message is no JSON, or has no number at a path.
    """
    return read_rows(messages, paths, decode, _inner, stamped=stamped)


def decode(content: bytes) -> Any:
    """Parse a message; raises ValueError where it is no JSON."""
    try:
        return json.loads(content)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def _inner(node: Any, step: str | int | Named, above: Any) -> Any:
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
