"""How the messages of a channel are read, by their encoding; those of JSON one by one."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tdfscal.logs.common.message_path import Named, Path, shown
from tdfscal.logs.messages.buffer import Messages
from tdfscal.records import FloatArray

MAX_DEPTH: Final = 8
"""Of what is listed of a message."""
_STAMPS: Final = (("header", "stamp"), ("timestamp",), ("header", "timestamp"))
_PARTS: Final = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"))
_LARGEST: Final = 4 << 20  # bytes

Read = Callable[[Messages], FloatArray]


@dataclass(frozen=True, slots=True)
class Leaf:
    """A number or a list in a message, or what has three axes: paths to them, in the order x, y, z.

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
                raise ValueError(f"it has no number at {shown(path)}")
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
        except (json.JSONDecodeError, UnicodeDecodeError):
            raise
        except ValueError as error:  # Python's own limit for integers
            raise ValueError("it has a number of thousands of digits") from error

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
