"""Foxglove's message paths: `/topic.field.sub`, `[0]` for an element, `[name]` for a joint.

`.0` and `.name` say the same and need no quotes in YAML.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from tdfscal.errors import RigError

Step = str | int
"""A field's name, or an element's number."""

_PLAIN = re.compile(r"[A-Za-z_]\w*")
_STEP = re.compile(
    r"\.(?P<field>[A-Za-z_]\w*)|\.(?P<place>\d{1,9})(?=[.\[]|$)|\[(?P<index>\d{1,9})\]|\[(?P<key>[^\[\]]+)\]"
)


@dataclass(frozen=True, slots=True)
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


def shown(steps: Path) -> str:
    """Return steps as text."""
    return "".join(map(_shown, steps))


def _shown(step: Step | Named) -> str:
    if isinstance(step, Named):
        return f".{step.name}" if _PLAIN.fullmatch(step.name) else f"[{step.name}]"
    return f".{step}"
