"""How the messages of a channel are read, by their encoding; JSON and protobuf one by one.

Paths within them are Foxglove's: `/topic.field.sub`, `[0]` for an element, `[name]` for a joint.
`.0` and `.name` say the same and need no quotes in YAML.
"""

from __future__ import annotations

import json
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from importlib import import_module
from typing import Any, Final

import numpy as np

from tdfscal.errors import RigError
from tdfscal.frozen import record
from tdfscal.logs.messages.buffer import Messages
from tdfscal.records import FloatArray

Step = str | int
"""A field's name, or an element's number."""

_PLAIN = re.compile(r"[A-Za-z_]\w*")
_STEP = re.compile(
    r"\.(?P<field>[A-Za-z_]\w*)|\.(?P<place>\d{1,9})(?=[.\[]|$)|\[(?P<index>\d{1,9})\]|\[(?P<key>[^\[\]]+)\]"
)


@record
class Named:
    """An element found by its name in the message's sibling list `name` (JointState)."""

    name: str


Path = tuple[Step | Named, ...]


def topic_of(path: str, topics: Iterable[str]) -> str | None:
    """Return the longest topic that the path begins with; topics can contain dots."""
    fits = [t for t in topics if path.startswith(t) and path[len(t) : len(t) + 1] in (".", "[", "")]
    return max(fits, key=len, default=None)


def parse_steps(rest: str, whole: str) -> Path:
    """Parse what follows the topic; raises RigError where it is no message path."""
    steps: list[Step | Named] = []
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
    return "".join(map(_shown, steps))


def _shown(step: Step | Named) -> str:
    if isinstance(step, Named):
        return f".{step.name}" if _PLAIN.fullmatch(step.name) else f"[{step.name}]"
    return f".{step}"


MAX_DEPTH: Final = 8
"""Of what is listed of a message."""
_STAMPS: Final = (("header", "stamp"), ("timestamp",), ("header", "timestamp"))
_PARTS: Final = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"))
_LARGEST: Final = 4 << 20  # bytes

Read = Callable[[Messages], FloatArray]


@record
class Leaf:
    """A number or a list in a message, or what has three axes: paths to x, y, z.

    label : name that says what it is, where that is not the path.
    """

    path: Path
    kind: str
    axes: tuple[Path, ...] = ()
    label: str = ""

    @classmethod
    def struct(cls, path: Path, kind: str) -> Leaf:
        """A field that has x, y, z."""
        return cls(path, kind, tuple((*path, axis) for axis in "xyz"))


def has_axes(members: Set[str]) -> bool:
    """Tell whether fields of these names make a vector, which a quaternion is not."""
    return {"x", "y", "z"} <= members and "w" not in members


class Encoding(ABC):
    """Messages of one type.

    stamped : whether the type has a header with a time; None where it does not say.
    """

    stamped: bool | None = None

    @abstractmethod
    def leaves(self, first: bytes) -> Iterator[Leaf]:
        """What there is in a message."""

    @abstractmethod
    def reader(self, paths: Sequence[Path], *, stamped: bool) -> Read:
        """Return what reads (N, number of paths); with `stamped` the header's time, s, comes first.

        That raises ValueError or struct.error where a message is not of its type or lacks a number.
        """

    def names(self, first: bytes) -> Sequence[str]:
        """Names that a message gives to the elements of its lists, as JointState does."""
        return ()

    def checked(self, path: Path) -> Path:
        """The path as the messages have it; raises ValueError where it leads nowhere."""
        return path


class OneByOne(Encoding):
    """Messages that a library decodes one by one."""

    @abstractmethod
    def decode(self, content: bytes) -> Any:
        """Decode a message; raises ValueError where it is none."""

    @abstractmethod
    def inner(self, node: Any, step: str | int | Named, above: Any) -> Any:
        """What a step leads to from a node, None where nowhere; above : the node above that one."""

    def reader(self, paths: Sequence[Path], *, stamped: bool) -> Read:
        """As `Encoding.reader`."""

        def read(messages: Messages) -> FloatArray:
            rows = [
                self._row(self.message(messages.bytes_of(k)), paths, stamped=stamped)
                for k in range(messages.offset.size)
            ]
            return np.array(rows, dtype=np.float64).reshape(len(rows), len(paths) + stamped)

        return read

    def message(self, content: bytes) -> Any:
        """As `decode`, of what is not too large for that."""
        if len(content) > _LARGEST:
            raise ValueError(f"it has {len(content)} bytes")
        return self.decode(content)

    def _row(self, message: Any, paths: Sequence[Path], *, stamped: bool) -> list[float]:
        row = [self._stamp(message)] if stamped else []
        for path in paths:
            number = self._number(message, path)
            if number is None:
                raise ValueError(f"it has no number at {path_text(path)}")
            row.append(number)
        return row

    def _stamp(self, message: Any) -> float:
        for path in _STAMPS:
            for parts in _PARTS:
                seconds, rest = (self._number(message, (*path, part)) for part in parts)
                if seconds is not None and rest is not None:
                    return seconds + rest * 1e-9
        raise ValueError("it has no header.stamp, nor timestamp, with seconds and nanoseconds")

    def _number(self, message: Any, path: Path) -> float | None:
        node, above = message, None
        for step in path:
            node, above = self.inner(node, step, above), node
        if isinstance(node, bool) or not isinstance(node, int | float):
            return None
        return float(node)


class Json(OneByOne):
    """Messages in JSON."""

    def decode(self, content: bytes) -> Any:
        """Parse a message."""
        try:
            return json.loads(content)
        except RecursionError as error:
            raise ValueError("it is nested too deeply") from error

    def leaves(self, first: bytes) -> Iterator[Leaf]:
        """What there is in a message."""
        yield from _leaves(self.message(first), (), 0)

    def names(self, first: bytes) -> Sequence[str]:
        """Texts of the list `name`."""
        names = self.message(first)["name"]
        return names if all(isinstance(name, str) for name in names) else ()

    def inner(self, node: Any, step: str | int | Named, above: Any) -> Any:
        """As `OneByOne.inner`; a name that follows a list is that of one of its elements."""
        if isinstance(node, dict):
            return node.get(step) if isinstance(step, str) else None
        if not isinstance(node, list):
            return None
        index = step if isinstance(step, int) else _index(above, step)
        return node[index] if index is not None and index < len(node) else None


def _index(parent: Any, step: str | Named) -> int | None:
    """Return where the list's sibling `name` has the name, if exactly once."""
    name = step if isinstance(step, str) else step.name
    names = parent.get("name") if isinstance(parent, dict) else None
    if not isinstance(names, list) or names.count(name) != 1:
        return None
    return int(names.index(name))


def _leaves(value: Any, path: Path, depth: int) -> Iterator[Leaf]:
    if not isinstance(value, dict) or depth == MAX_DEPTH:
        yield Leaf(path, type(value).__name__)
    elif has_axes(value.keys()):
        yield Leaf.struct(path, "object")
    else:
        for key, member in value.items():
            yield from _leaves(member, (*path, str(key)), depth + 1)


class Protobuf(OneByOne):
    """Messages of a type whose definition, a FileDescriptorSet, is recorded with them.

    Raises ValueError where the library is not installed, or the schema does not describe the type.
    """

    def __init__(self, name: str, schema: bytes) -> None:
        try:
            descriptor_pb2, descriptor_pool, message, message_factory = (
                import_module(f"google.protobuf.{module}")
                for module in ("descriptor_pb2", "descriptor_pool", "message", "message_factory")
            )
        except ImportError as error:
            raise ValueError(
                "messages are encoded as 'protobuf', which needs a library that is not installed; "
                'install it with `pip install "tdfscal[protobuf]"`'
            ) from error
        try:
            files = descriptor_pb2.FileDescriptorSet.FromString(schema)
            pool = descriptor_pool.DescriptorPool()
            waiting = {file.name: file for file in files.file}
            while waiting:
                ready = [f for f in waiting.values() if not waiting.keys() & set(f.dependency)]
                if not ready:
                    raise ValueError("its files depend on each other in a circle")
                for file in ready:
                    pool.Add(waiting.pop(file.name))
            self._kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
        except (message.DecodeError, KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"the definition of {name} cannot be read") from error
        self._broken = message.DecodeError

    def decode(self, content: bytes) -> Any:
        """Parse a message."""
        try:
            return self._kind.FromString(content)
        except self._broken as error:
            raise ValueError("it is no message of its type") from error

    def leaves(self, first: bytes) -> Iterator[Leaf]:
        """What there is in messages of the type."""
        yield from _described(self._kind.DESCRIPTOR, (), 0)

    def inner(self, node: Any, step: str | int | Named, above: Any) -> Any:
        """As `OneByOne.inner`; a number that is zero is not written, yet it is there."""
        if isinstance(step, str):
            field = getattr(node, "DESCRIPTOR", None) and node.DESCRIPTOR.fields_by_name.get(step)
            there = field is not None and (
                field.message_type is None or field.is_repeated or node.HasField(step)
            )
            return getattr(node, step) if there else None
        if isinstance(step, Named) or not hasattr(node, "__len__") or step >= len(node):
            return None
        return node[step]


def _described(descriptor: Any, path: Path, depth: int) -> Iterator[Leaf]:
    if has_axes(descriptor.fields_by_name.keys()):
        yield Leaf.struct(path, str(descriptor.full_name))
        return
    for field in descriptor.fields:
        here = (*path, str(field.name))
        if field.is_repeated or field.message_type is None:
            yield Leaf(here, "list" if field.is_repeated else "value")
        elif depth < MAX_DEPTH:
            yield from _described(field.message_type, here, depth + 1)
