"""Builds a YAML document from the parser's events, with the line of every value.

Stricter than YAML 1.1 and without its traps: scalars follow the YAML 1.2 core schema (`1e-5` is a
number; `on`, `1:30` and dates are text), keys are text, a repeated key is an error. No constructor
runs, so no tag can make an object; depth and the expansion of aliases are bounded.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass, field
from typing import Any, NoReturn

import yaml

from tdfscal.errors import TdfscalError
from tdfscal.files.yaml.scalars import plain_scalar, shorten

Place = tuple[str | int, ...]
"""Keys and indices from the top of a document to a value."""

MAX_VALUES = 500_000
MAX_DEPTH = 32

_CORE = ("str", "int", "float", "bool", "null", "timestamp", "seq", "map")
_TAGS = {"!"} | {f"tag:yaml.org,2002:{name}" for name in _CORE}


@dataclass(frozen=True, slots=True)
class _Node:
    """A value; size and height count its aliases in full."""

    value: Any
    size: int = 1
    height: int = 0


@dataclass(slots=True)
class YamlBuilder:
    """Turns one YAML text into plain values.

    source : the file's name for messages. error : the class to raise.
    lines : after `build`, the line of each value, counted from 1.
    """

    source: str
    error: type[TdfscalError]
    lines: dict[Place, int] = field(default_factory=dict)
    _anchors: dict[str, _Node] = field(default_factory=dict)

    def build(self, text: str) -> Any:
        """Return the document's value; None for an empty text. Raises `error`."""
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        events, root = yaml.parse(text, Loader=loader), None
        try:
            for event in events:
                if isinstance(event, yaml.NodeEvent):
                    root = self._node(event, events, ())
                elif isinstance(event, yaml.DocumentStartEvent) and root is not None:
                    self._fail("holds more than one document", event, "remove the line `---`")
        except yaml.YAMLError as fault:
            raise self._syntax(fault, text) from fault
        return None if root is None else root.value

    def _node(self, event: yaml.NodeEvent, events: Iterator[Any], place: Place) -> _Node:
        """The value that begins with an event, its own events taken."""
        self.lines[place] = _line(event)
        if isinstance(event, yaml.AliasEvent):
            return self._aliased(event, len(place))
        tag = getattr(event, "tag", None)
        if tag is not None and tag not in _TAGS:
            self._fail(f"the tag {shorten(tag)} is not read", event, "write a plain value")
        if isinstance(event, yaml.ScalarEvent):
            node = _Node(self._scalar(event))
        else:
            if len(place) >= MAX_DEPTH:
                self._too_deep(event)
            self._anchors.pop(event.anchor or "", None)
            node = self._collection(event, events, place)
        if event.anchor is not None:
            self._anchors[event.anchor] = node
        return node

    def _collection(self, start: yaml.NodeEvent, events: Iterator[Any], place: Place) -> _Node:
        """The mapping or list that has begun, up to its end."""
        mapping = isinstance(start, yaml.MappingStartEvent)
        content: dict[str | int, Any] = {}  # a list's by their place
        size, height = 1, 1
        for event in events:
            if not isinstance(event, yaml.NodeEvent):  # the end
                break
            key = self._key(event, content) if mapping else len(content)
            node = self._node(next(events) if mapping else event, events, (*place, key))
            content[key] = node.value
            size, height = size + node.size, max(height, node.height + 1)
            if size > MAX_VALUES:
                self._fail(
                    f"holds more than {MAX_VALUES} values", event, "write out what is needed"
                )
        return _Node(content if mapping else list(content.values()), size, height)

    def _key(self, event: yaml.NodeEvent, known: Container[str | int]) -> str:
        if not isinstance(event, yaml.ScalarEvent):
            self._fail("a key must be plain text", event, "write `key: value`")
        key: str = event.value
        if key == "<<" and event.implicit[0]:
            self._fail("merge keys (`<<`) are not read", event, "write the keys out")
        if key in known:
            self._fail(f"the key `{shorten(key)}` occurs twice", event, "keep one of them")
        return key

    def _scalar(self, event: yaml.ScalarEvent) -> Any:
        if not event.implicit[0]:
            return event.value
        try:
            return plain_scalar(event.value)
        except OverflowError as fault:
            self._fail(str(fault), event, "check the number")

    def _aliased(self, event: yaml.AliasEvent, depth: int) -> _Node:
        node = self._anchors.get(event.anchor or "")
        if node is None:
            name = shorten(event.anchor or "")
            what = f"the alias `*{name}` refers to nothing before it, or to itself"
            self._fail(what, event, "write the value out")
        if depth + node.height > MAX_DEPTH:
            self._too_deep(event)
        return node

    def _too_deep(self, event: yaml.Event) -> NoReturn:
        self._fail(f"is nested deeper than {MAX_DEPTH} levels", event, "check that it is this file")

    def _fail(self, what: str, event: yaml.Event, hint: str) -> NoReturn:
        raise self.error(what, where=f"{self.source}, line {_line(event)}", hint=hint)

    def _syntax(self, fault: yaml.YAMLError, text: str) -> TdfscalError:
        if not isinstance(fault, yaml.MarkedYAMLError) or (mark := fault.problem_mark) is None:
            return self.error(
                "holds a character that YAML does not allow",
                where=self.source,
                hint="check that it is a text file",
            )
        rows = text.split("\n")
        row = rows[mark.line] if mark.line < len(rows) else ""
        tab = "\t" in row[: len(row) - len(row.lstrip())]
        problem = fault.problem or "bad syntax"
        return self.error(
            "a tab stands where YAML wants spaces" if tab else f"is not YAML: {problem}",
            where=f"{self.source}, line {mark.line + 1}, column {mark.column + 1}",
            hint="indent with spaces" if tab else "correct the indentation or the syntax there",
        )


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark is not None else 0
