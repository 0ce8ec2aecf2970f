"""ROS message definitions as recorded with the messages."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, Final

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.base import TypesysError

Definitions = Mapping[str, Sequence[tuple[str, Any]]]
"""Message type → its fields in order, each as (name, rosbags' description of its type)."""

_LONGEST: Final = 1 << 18


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
