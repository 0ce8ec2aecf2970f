"""ROS message definitions as recorded with the messages, and paths within them."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, Final

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.base import TypesysError

from tdfscal.errors import DataError
from tdfscal.logs.common.message_path import Named, Path, shown

Definitions = Mapping[str, Sequence[tuple[str, Any]]]
"""Message type → its fields in order, each as (name, rosbags' description of its type)."""

ROS: Final = frozenset({"cdr", "ros1"})
"""Encodings of ROS 2's and ROS 1's messages."""
_LONGEST: Final = 1 << 18
_SHOWN: Final = 12


@functools.lru_cache(maxsize=64)
def definitions(name: str, encoding: str, text: str) -> Definitions:
    """Parse a schema's text; the parser is slow, and channels share their schemas.

    Raises
    ------
    ValueError : the text is no message definition, or of an unknown encoding.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"the definition of {name} has {len(text)} characters")
    try:
        if encoding == "ros2" and not text:
            types = _standard()
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
    for key, fields in result.items():
        names = [n for n, _ in fields]
        if len(set(names)) < len(names):
            raise ValueError(f"the definition of {key} has a field twice")
    return result


@functools.cache
def _standard() -> Mapping[str, Any]:
    """Definitions of the messages that ROS 2 brings along, for recorders that store none."""
    return get_typestore(Stores.LATEST).fielddefs


def full_name(name: str) -> str:
    """geometry_msgs/Point → geometry_msgs/msg/Point."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def expand_vector(types: Definitions, name: str, path: Path, where: str) -> list[Path]:
    """Turn the path of a field that has x, y, z into three paths.

    Raises
    ------
    DataError : the path leads nowhere, or to something without x, y, z.
    """
    fields = _fields_at(types, full_name(name), path, where)
    missing = [m for m in "xyz" if m not in fields]
    if missing:
        has = _has(fields) if fields else "it is a number or a text"
        raise DataError(
            f"{shown(path) or 'the message'} of {name} has no member {missing[0]}; {has}",
            where=where,
            hint="name a field with x, y, z, or three fields",
        )
    return [(*path, member) for member in "xyz"]


def settled(types: Definitions, name: str, path: Path) -> Path:
    """A path in which a name that follows a list is that of one of its elements."""
    node: Any = (Nodetype.NAME, full_name(name))
    steps: list[str | int | Named] = []
    for step in path:
        kind, detail = node
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            steps.append(Named(step) if isinstance(step, str) else step)
            node = detail[0]
            continue
        steps.append(step)
        node = dict(types.get(detail, ())).get(str(step), (Nodetype.BASE, ("", 0)))
    return tuple(steps)


def check_path(types: Definitions, name: str, path: Path, where: str) -> None:
    """Raise DataError where a path leads nowhere."""
    _fields_at(types, full_name(name), path, where)


def _fields_at(types: Definitions, name: str, path: Path, where: str) -> list[str]:
    node: Any = (Nodetype.NAME, name)
    for k, step in enumerate(path):
        kind, detail = node
        if isinstance(step, str):
            fields = dict(types.get(detail, ())) if kind == Nodetype.NAME else {}
            if step not in fields:
                has = _has(list(fields)) if fields else "it has no fields"
                raise DataError(f"no field {step} in {shown(path[:k]) or name}; {has}", where=where)
            node = fields[step]
        elif kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            node = detail[0]
        else:
            raise DataError(f"{shown(path[:k])} of {name} is no list", where=where)
    kind, detail = node
    return [n for n, _ in types.get(detail, ())] if kind == Nodetype.NAME else []


def _has(fields: Sequence[str]) -> str:
    return f"it has {', '.join(fields[:_SHOWN])}{', …' if len(fields) > _SHOWN else ''}"
