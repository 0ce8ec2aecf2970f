"""Messages by topic in one buffer, as an MCAP file has them; paths to their numbers; JSON.

The paths are Foxglove's: `/topic.field.sub`, `[0]` for an element, `[name]` for a joint. `.0` and
`.name` say the same and need no quotes in YAML.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from typing import Any, Final

import numpy as np

from tdfscal.errors import RigError
from tdfscal.frozen import record
from tdfscal.records import BoolArray, FloatArray, IntArray

RECORD: Final = struct.Struct("<BQ")
"""Kind of a record, and bytes that follow."""
MESSAGE_HEAD: Final = 22
"""Channel, sequence, log time and publish time, in bytes."""
DATA: Final = RECORD.size + MESSAGE_HEAD
"""From the start of a message's record to its data, in bytes."""


@record
class Messages:
    """Messages within a buffer of records, in file order.

    data : the buffer. offset : (N,), where each message's record starts.
    length : (N,), bytes of message data. channel : (N,).
    """

    data: bytes
    offset: IntArray
    length: IntArray
    channel: IntArray

    def of(self, channel: int) -> Messages:
        """Return the messages of one channel."""
        return self.at(self.channel == channel)

    def at(self, k: int | slice | BoolArray) -> Messages:
        """Return message k alone, or those of a slice or mask."""
        some = slice(k, k + 1) if isinstance(k, int) else k
        return Messages(self.data, self.offset[some], self.length[some], self.channel[some])

    def log_time(self) -> IntArray:
        """(N,), ns."""
        return gather(self.data, self.offset + 15, "<u8").astype(np.int64)

    def publish_time(self) -> IntArray:
        """(N,), ns."""
        return gather(self.data, self.offset + 23, "<u8").astype(np.int64)

    def bytes_of(self, k: int) -> bytes:
        """Return the data of message k."""
        start = int(self.offset[k]) + DATA
        return self.data[start : start + int(self.length[k])]

    def counts(self) -> dict[int, int]:
        """Messages by channel."""
        found = np.bincount(self.channel)
        return {int(c): int(found[c]) for c in np.flatnonzero(found)}


def gather(data: bytes, offset: IntArray, dtype: str) -> np.ndarray[Any, Any]:
    """Read one value of `dtype` at each byte offset, aligned or not.

    Raises ValueError for an offset outside the buffer.
    """
    kind = np.dtype(dtype)
    places = len(data) - kind.itemsize + 1
    if offset.size == 0:
        return np.empty(0, dtype=kind)
    if places <= 0 or int(offset.min()) < 0 or int(offset.max()) >= places:
        raise ValueError("an offset lies outside its chunk")
    return np.ndarray((places,), kind, data, 0, (1,))[offset]


MAX_DEPTH: Final = 8
"""Of what is listed of a message."""
_PLAIN = re.compile(r"[A-Za-z_]\w*")
_STEP = re.compile(
    r"\.(?P<field>[A-Za-z_]\w*)|\.(?P<place>\d{1,9})(?=[.\[]|$)|\[(?P<index>\d{1,9})\]|\[(?P<key>[^\[\]]+)\]"
)


@record
class Named:
    """An element found by its name in the message's sibling list `name` (JointState)."""

    name: str


Path = tuple[str | int | Named, ...]
"""Names of fields, and numbers or names of elements."""
Read = Callable[[Messages], FloatArray]
"""Messages of one channel → (N, number of paths)."""


@record
class Leaf:
    """A number or a list in a message, or what has three axes: paths to x, y, z.

    label : name that says what it is, where that is not the path.
    """

    path: Path
    kind: str
    axes: tuple[Path, ...] = ()
    label: str = ""


def struct_leaf(path: Path, kind: str) -> Leaf:
    """A field that has x, y, z."""
    return Leaf(path, kind, tuple((*path, axis) for axis in "xyz"))


def has_axes(members: Set[str]) -> bool:
    """Tell whether fields of these names make a vector, which a quaternion is not."""
    return {"x", "y", "z"} <= members and "w" not in members


def topic_of(path: str, topics: Iterable[str]) -> str | None:
    """Return the longest topic that the path begins with; topics can contain dots."""
    fits = [t for t in topics if path.startswith(t) and path[len(t) : len(t) + 1] in (".", "[", "")]
    return max(fits, key=len, default=None)


def parse_steps(rest: str, whole: str) -> Path:
    """Parse what follows the topic; raises RigError where it is no message path."""
    steps: list[str | int | Named] = []
    position = 0
    while position < len(rest):
        match = _STEP.match(rest, position)
        if match is None:
            raise RigError(
                f"{whole} is no message path",
                where="log.supports",
                hint="write /topic.field.sub, with [0] for an element",
            )
        if match["field"] is not None:
            steps.append(match["field"])
        elif (index := match["index"] or match["place"]) is not None:
            steps.append(int(index))
        else:
            steps.append(Named(match["key"].strip("\"'")))
        position = match.end()
    return tuple(steps)


def path_text(steps: Path) -> str:
    """Return steps as text."""
    names = [step.name if isinstance(step, Named) else None for step in steps]
    return "".join(
        f".{step if name is None else name}"
        if name is None or _PLAIN.fullmatch(name)
        else f"[{name}]"
        for step, name in zip(steps, names, strict=True)
    )


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
