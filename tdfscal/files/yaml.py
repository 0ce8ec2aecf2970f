"""YAML and JSON documents with the place of every value, read within stated limits.

YAML is stricter than 1.1: scalars follow the YAML 1.2 core schema (`1e-5` is a number; `on`, `1:30`
and dates are text), keys are text that occurs once, there are no anchors, and no tag makes an
object.
"""

from __future__ import annotations

import difflib
import errno
import hashlib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NoReturn

import yaml

from tdfscal.errors import TdfscalError, UsageError
from tdfscal.frozen import record

Format = Literal["json", "yaml"]
Place = tuple[str | int, ...]
"""Keys and indices from the top of a document to a value."""
Scalar = str | float | int | bool | None

MAX_BYTES = 4_000_000
MAX_DEPTH = 32
_TOO_DEEP = f"is nested deeper than {MAX_DEPTH} levels"
_THIS_FILE = "check that it is the file that you mean"

_INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
#: A number that is not quoted.
NUMBER = re.compile(rf"{_INTEGER.pattern}|[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_SPECIAL = {".nan": math.nan, "+.inf": math.inf, ".inf": math.inf, "-.inf": -math.inf}
_CONSTANTS: dict[str, bool | None] = {"": None, "~": None, "null": None}
_CONSTANTS |= {"true": True, "false": False}


@record
class Document:
    """A parsed file.

    content : dict, list, str, float, int, bool or None, nested. lines : place → line of its key,
    from 1; empty for JSON. source : the file's name for messages. sha256 : of the file as it is.
    """

    content: Any
    lines: Mapping[Place, int]
    source: str
    text: str
    sha256: str

    def where(self, place: Place = ()) -> str:
        """File, line and place in it: `rig.yaml, line 12, supports[1].hinge`."""
        known = next((place[:k] for k in range(len(place), 0, -1) if place[:k] in self.lines), None)
        line = f"line {self.lines[known]}" if known else ""
        parts = (f"[{part}]" if isinstance(part, int) else f".{shorten(part)}" for part in place)
        dotted = "".join(parts).removeprefix(".")
        return ", ".join(part for part in (self.source, line, dotted) if part)


def read_document(path: Path, error: type[TdfscalError]) -> Document:
    """Read a YAML or JSON file (JSON where the suffix is .json).

    Raises UsageError where there is no such file or it cannot be read, and `error` for what is
    wrong in it.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as fault:
        raise unreadable(path, fault) from fault
    form: Format = "json" if path.suffix.lower() == ".json" else "yaml"
    return parse_document(raw, str(path), error, form)


def parse_document(
    raw: bytes, source: str, error: type[TdfscalError], form: Format = "yaml"
) -> Document:
    """Parse the bytes of a document; source names it in messages.

    Raises `error` for anything that is not one well-formed document within the limits.
    """
    builder = _Builder(source, error)
    if len(raw) > MAX_BYTES:
        builder.fail(f"is larger than {MAX_BYTES // 1_000_000} MB", _THIS_FILE)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = raw[: fault.start].count(b"\n") + 1
        what = f"byte 0x{raw[fault.start]:02x} is not UTF-8 text"
        if raw.startswith((b"\xff\xfe", b"\xfe\xff", b"\0\0\xfe\xff")):
            what, line = "the text is UTF-16 or UTF-32", 1
        builder.fail(what, "save the file as UTF-8", line)
    content = builder.from_json(text) if form == "json" else builder.from_yaml(text)
    return Document(content, builder.lines, source, text, hashlib.sha256(raw).hexdigest())


def as_path(given: str | PathLike[str]) -> Path:
    """Return a path. Raises UsageError for what names no file."""
    if str(given).startswith("~/"):
        what, hint = "`~` stands for no folder here", "write the path out, or use Path.expanduser"
        raise UsageError(what, where=shorten(str(given), 300), hint=hint)
    if given == "":  # as a path it would be the folder of now
        raise UsageError("a path is empty", hint="name the file or folder")
    try:
        path = Path(given)
        path.lstat()
    except TypeError:
        raise UsageError(f"{as_written(given)} names no file", hint="give a path") from None
    except (ValueError, OSError) as fault:
        if isinstance(fault, ValueError) or fault.errno == errno.ENAMETOOLONG:
            raise unreadable(path, fault) from fault
    # One that a shell opened has no name of its own, and a writer.
    if path.is_fifo() and path.resolve().is_fifo():
        hint = "copy it to a file"
        raise UsageError("is a pipe, which may never end", where=str(path), hint=hint)
    return path


def unreadable(path: Path, fault: OSError | ValueError) -> UsageError:
    """Say why a file cannot be read."""
    where = shorten(str(path), 300)
    if isinstance(fault, FileNotFoundError):
        return UsageError("there is no such file", where=where, hint="check the path")
    if isinstance(fault, IsADirectoryError):
        return UsageError("is a folder, not a file", where=where, hint="name a file in it")
    reason = fault.strerror if isinstance(fault, OSError) and fault.strerror else "no file's name"
    return UsageError(f"cannot be read: {reason}", where=where, hint="check the path")


#: What parsers say, in words of ours.
_SYNTAX = {
    "Expecting value": "a value is missing",
    "Expecting ',' delimiter": "a comma is missing",
    "Expecting ':' delimiter": "a colon is missing",
    "Expecting property name enclosed in double quotes": "a key in double quotes is missing",
    "Extra data": "more follows behind its end",
    "Unterminated string starting at": "a text is not closed",
    "did not find expected node content": "a value is missing",
    "did not find expected key": "a key is missing",
    "could not find expected ':'": "a colon is missing",
    "did not find expected ',' or ']'": "a bracket is not closed",
    "did not find expected ',' or '}'": "a brace is not closed",
    "mapping values are not allowed in this context": "a colon stands where none may",
    "found unexpected end of stream": "a text is not closed",
    "exceeded maximum nesting depth": _TOO_DEEP,
}


def _wrong(form: str, problem: str) -> str:
    told = _SYNTAX.get(problem)
    return f"is not {form}: {told}" if told else f"is not {form}"


@dataclass(slots=True)
class _Builder:
    """Makes plain values of a text. lines : of each value of YAML, from 1."""

    source: str
    error: type[TdfscalError]
    lines: dict[Place, int] = field(default_factory=dict)

    def fail(self, what: str, hint: str, line: int = 0, column: int = 0) -> NoReturn:
        where = f"{self.source}, line {line}" if line else self.source
        raise self.error(what, where=f"{where}, column {column}" if column else where, hint=hint)

    def _at(self, event: Any, what: str, hint: str) -> NoReturn:
        self.fail(what, hint, event.start_mark.line + 1)

    def from_yaml(self, text: str) -> Any:
        """Return a YAML document's value; None for an empty text."""
        events = yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        found: list[Any] = []
        try:
            for event in events:
                if isinstance(event, yaml.NodeEvent):
                    found.append(self._node(event, events, ()))
                elif isinstance(event, yaml.DocumentStartEvent) and found:
                    self._at(event, "holds more than one document", "remove the line `---`")
        except yaml.MarkedYAMLError as fault:
            mark, hint = fault.problem_mark, "correct the indentation or the syntax there"
            where = (mark.line + 1, mark.column + 1) if mark else ()
            row = [*text.splitlines(), ""][mark.line] if mark else ""
            what = _wrong("YAML", str(fault.problem))
            if "\t" in row[: len(row) - len(row.lstrip())]:
                what, hint = "a tab stands where YAML wants spaces", "indent with spaces"
            self.fail(what, hint, *where)
        except yaml.YAMLError:
            self.fail("holds a character that YAML does not allow", _THIS_FILE)
        return found[0] if found else None

    def _node(self, event: Any, events: Iterator[Any], place: Place) -> Any:
        """The value that begins with an event, its own events taken."""
        self.lines.setdefault(place, event.start_mark.line + 1)
        if event.anchor is not None:
            self._at(event, "anchors and aliases are not read", "write the value out")
        if event.tag not in (None, "!"):
            self._at(event, f"the tag {shorten(event.tag)} is not read", "write a plain value")
        if isinstance(event, yaml.ScalarEvent):
            return plain_scalar(event.value) if event.implicit[0] else event.value
        if len(place) >= MAX_DEPTH:
            self._at(event, _TOO_DEEP, _THIS_FILE)
        inner = takewhile(lambda one: isinstance(one, yaml.NodeEvent), events)
        if isinstance(event, yaml.SequenceStartEvent):
            return [self._node(each, events, (*place, k)) for k, each in enumerate(inner)]
        content: dict[str, Any] = {}
        for each in inner:
            line = each.start_mark.line + 1
            if not isinstance(each, yaml.ScalarEvent):
                self._at(each, "a key must be plain text", "write `key: value`")
            if each.value in content:
                self._at(each, f"the key `{shorten(each.value)}` occurs twice", "keep one of them")
            self.lines[*place, each.value] = line
            content[each.value] = self._node(next(events), events, (*place, each.value))
        return content

    def from_json(self, text: str) -> Any:
        """Return a JSON document's value."""
        read = json.JSONDecoder(
            parse_float=number, parse_int=number, object_pairs_hook=self._object
        ).decode
        try:
            content = read(text)
            too_deep = _deeper_than(MAX_DEPTH, content)
        except json.JSONDecodeError as fault:
            what, hint = _wrong("JSON", fault.msg), "correct the syntax there"
            self.fail(what, hint, fault.lineno, fault.colno)
        except RecursionError:
            too_deep = True
        if too_deep:
            self.fail(_TOO_DEEP, _THIS_FILE)
        return content

    def _object(self, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        content = dict(pairs)
        if len(content) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            what = f"the key `{shorten(twice)}` occurs twice in one object"
            self.fail(what, "keep one of them")
        return content


def _deeper_than(limit: int, content: Any) -> bool:
    if not isinstance(content, dict | list):
        return False
    inner = content.values() if isinstance(content, dict) else content
    return limit == 0 or any(_deeper_than(limit - 1, value) for value in inner)


def plain_scalar(text: str) -> Scalar:
    """Return the value of an unquoted YAML 1.2 scalar."""
    lower = text.lower()
    if lower in _CONSTANTS and text in (lower, lower.capitalize(), lower.upper()):
        return _CONSTANTS[lower]
    if lower in _SPECIAL:
        return _SPECIAL[lower]
    return number(text) if NUMBER.fullmatch(text) else text


def number(text: str) -> str | int | float:
    """Value of the digits of a number; the text itself beyond double precision, never infinity.

    Above 2⁵³ a double does not hold integers exactly anyway, and huge ones are slow to convert.
    """
    if len(text) <= 20 and _INTEGER.fullmatch(text):
        return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
    value = math.inf if text[:2] in ("0o", "0x") else float(text)
    return value if math.isfinite(value) else text


def shorten(text: str, limit: int = 40) -> str:
    """Text cut for a message, without line breaks or characters that do not print."""
    clean = "".join(letter if letter.isprintable() else "·" for letter in text[: limit + 1])
    return clean if len(clean) <= limit else clean[: limit - 1] + "…"


def as_written(value: object, limit: int = 40) -> str:
    """A value as a file has it, cut for a message."""
    if isinstance(value, str):
        return f"'{shorten(value, limit)}'"
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    return shorten(repr(value), limit)


def nearest(name: str, known: Sequence[str], cutoff: float = 0.6) -> str | None:
    """Return the known name most like `name`, None where none resembles it."""
    folded = {key.lower(): key for key in reversed(known)}
    found = difflib.get_close_matches(name.lower(), list(folded), n=1, cutoff=cutoff)
    return folded[found[0]] if found else None
