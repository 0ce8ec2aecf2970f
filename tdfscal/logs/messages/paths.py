"""Paths to the numbers of a message, and what lies at their ends.

They are Foxglove's: `/topic.field.sub`, `[0]` for an element, `[name]` for a joint. `.0` and
`.name` say the same and need no quotes in YAML.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Set
from typing import Final

from tdfscal.errors import RigError
from tdfscal.frozen import record
from tdfscal.logs.messages.buffer import Messages
from tdfscal.records import FloatArray

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
