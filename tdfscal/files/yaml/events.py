"""Builds a YAML document from the parser's events, with the line of every value.

Stricter than YAML 1.1 and without its traps: scalars follow the YAML 1.2 core schema (`1e-5` is a
number; `on`, `1:30` and dates are text), keys are text, a repeated key is an error. No constructor
runs, so no tag can make an object; depth and the expansion of aliases are bounded.
"""

from __future__ import annotations

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
class _Done:
    """A complete value; size and height count its aliases in full."""

    value: Any
    size: int = 1
    height: int = 0


@dataclass(slots=True)
class _Open:
    """A collection whose end has not been read yet."""

    value: dict[str, Any] | list[Any]
    anchor: str | None
    place: Place
    size: int = 1
    height: int = 1
    key: str | None = None

    @property
    def wants_key(self) -> bool:
        return isinstance(self.value, dict) and self.key is None

    def add(self, done: _Done) -> None:
        self.size += done.size
        self.height = max(self.height, done.height + 1)
        if isinstance(self.value, list):
            self.value.append(done.value)
        elif self.key is not None:
            self.value[self.key], self.key = done.value, None


@dataclass(slots=True)
class YamlBuilder:
    """Turns one YAML text into plain values, without recursion.

    source : the file's name for messages. error : the class to raise.
    lines : after `build`, the line of each value, counted from 1.
    """

    source: str
    error: type[TdfscalError]
    lines: dict[Place, int] = field(default_factory=dict)
    _stack: list[_Open] = field(default_factory=list)
    _anchors: dict[str, _Done] = field(default_factory=dict)
    _root: Any = None
    _documents: int = 0

    def build(self, text: str) -> Any:
        """Return the document's value; None for an empty text. Raises `error`."""
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        try:
            for event in yaml.parse(text, Loader=loader):
                self._take(event)
        except yaml.YAMLError as fault:
            raise self._syntax(fault, text) from fault
        return self._root

    def _take(self, event: yaml.Event) -> None:
        if isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                self._fail("holds more than one document", event, "remove the line `---`")
        elif isinstance(event, yaml.NodeEvent):
            if self._stack and self._stack[-1].wants_key:
                self._key(self._stack[-1], event)
            else:
                self._value(event)
        elif isinstance(event, yaml.CollectionEndEvent):
            done = self._stack.pop()
            self._finish(_Done(done.value, done.size, done.height), done.anchor, event)

    def _key(self, parent: _Open, event: yaml.NodeEvent) -> None:
        if not isinstance(event, yaml.ScalarEvent):
            self._fail("a key must be plain text", event, "write `key: value`")
        if event.value == "<<" and event.implicit[0]:
            self._fail("merge keys (`<<`) are not read", event, "write the keys out")
        if event.value in parent.value:
            name = shorten(event.value)
            self._fail(f"the key `{name}` occurs twice", event, "keep one of them")
        parent.key = event.value

    def _value(self, event: yaml.NodeEvent) -> None:
        place = self._place()
        self.lines[place] = _line(event)
        if isinstance(event, yaml.AliasEvent):
            self._finish(self._aliased(event), None, event)
            return
        tag = getattr(event, "tag", None)
        if tag is not None and tag not in _TAGS:
            self._fail(f"the tag {shorten(tag)} is not read", event, "write a plain value")
        if isinstance(event, yaml.ScalarEvent):
            self._finish(_Done(self._scalar(event)), event.anchor, event)
        elif len(self._stack) >= MAX_DEPTH:
            self._too_deep(event)
        else:
            if event.anchor is not None:
                self._anchors.pop(event.anchor, None)
            empty: dict[str, Any] | list[Any] = (
                {} if isinstance(event, yaml.MappingStartEvent) else []
            )
            self._stack.append(_Open(empty, event.anchor, place))

    def _scalar(self, event: yaml.ScalarEvent) -> Any:
        if not event.implicit[0]:
            return event.value
        try:
            return plain_scalar(event.value)
        except OverflowError as fault:
            self._fail(str(fault), event, "check the number")

    def _aliased(self, event: yaml.AliasEvent) -> _Done:
        done = self._anchors.get(event.anchor or "")
        if done is None:
            name = shorten(event.anchor or "")
            self._fail(
                f"the alias `*{name}` refers to nothing before it, or to itself",
                event,
                "write the value out",
            )
        if len(self._stack) + done.height > MAX_DEPTH:
            self._too_deep(event)
        return done

    def _finish(self, done: _Done, anchor: str | None, event: yaml.Event) -> None:
        """Hand a complete value to the collection it stands in."""
        if anchor is not None:
            self._anchors[anchor] = done
        if not self._stack:
            self._root = done.value
            return
        self._stack[-1].add(done)
        if self._stack[-1].size > MAX_VALUES:
            self._fail(f"holds more than {MAX_VALUES} values", event, "write out what is needed")

    def _place(self) -> Place:
        if not self._stack:
            return ()
        parent = self._stack[-1]
        last = len(parent.value) if isinstance(parent.value, list) else parent.key
        return parent.place if last is None else (*parent.place, last)

    def _too_deep(self, event: yaml.Event) -> NoReturn:
        self._fail(f"is nested deeper than {MAX_DEPTH} levels", event, "check that it is this file")

    def _fail(self, what: str, event: yaml.Event, hint: str) -> NoReturn:
        raise self.error(what, where=f"{self.source}, line {_line(event)}", hint=hint)

    def _syntax(self, fault: yaml.YAMLError, text: str) -> TdfscalError:
        mark = fault.problem_mark if isinstance(fault, yaml.MarkedYAMLError) else None
        if mark is None:
            return self.error(
                "holds a character that YAML does not allow",
                where=self.source,
                hint="check that it is a text file",
            )
        rows = text.split("\n")
        row = rows[mark.line] if mark.line < len(rows) else ""
        tab = "\t" in row[: len(row) - len(row.lstrip())]
        problem = getattr(fault, "problem", None) or "bad syntax"
        return self.error(
            "a tab stands where YAML wants spaces" if tab else f"is not YAML: {problem}",
            where=f"{self.source}, line {mark.line + 1}, column {mark.column + 1}",
            hint="indent with spaces" if tab else "correct the indentation or the syntax there",
        )


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark is not None else 0
