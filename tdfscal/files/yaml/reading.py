"""YAML and JSON documents with the place of every value, read within stated limits."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import select
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

from tdfscal.errors import TdfscalError, UsageError
from tdfscal.files.yaml.events import MAX_DEPTH, Place, YamlBuilder
from tdfscal.files.yaml.scalars import decimal, integer, shorten

Format = Literal["json", "yaml"]

MAX_BYTES = 4_000_000
#: Seconds without anything from a pipe.
_PATIENCE = 10.0


@dataclass(frozen=True, slots=True)
class Document:
    """A parsed file.

    content : dict, list, str, float, int, bool or None, nested. lines : place → line, from 1; empty
    for JSON. source : the file's name for messages. sha256 : of the file as it lies there.
    """

    content: Any
    lines: Mapping[Place, int]
    source: str
    sha256: str

    def where(self, place: Place = ()) -> str:
        """File, line and place in it: `rig.yaml, line 12, supports[1].hinge`."""
        known = next((place[:k] for k in range(len(place), 0, -1) if place[:k] in self.lines), None)
        line = f"line {self.lines[known]}" if known else ""
        return ", ".join(part for part in (self.source, line, dotted(place)) if part)


def dotted(place: Place) -> str:
    """`('supports', 1, 'hinge')` → `supports[1].hinge`."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{shorten(part)}" for part in place)
    return "".join(parts).removeprefix(".")


def read_document(path: Path, error: type[TdfscalError]) -> Document:
    """Read a YAML or JSON file (JSON where the suffix is .json).

    Raises UsageError where there is no such file or it cannot be read, and `error` for what is
    wrong in it.
    """
    try:
        raw = _content(path)
    except (OSError, ValueError) as fault:
        raise unreadable(path, fault) from fault
    return parse_document(
        raw, str(path), error, "json" if path.suffix.lower() == ".json" else "yaml"
    )


def _content(path: Path) -> bytes:
    """Read a file, no more than a document may have; a pipe is waited for, but not for ever."""
    if not path.is_fifo():
        with path.open("rb") as file:
            return file.read(MAX_BYTES + 1)
    content = b""
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb", buffering=0) as pipe:
        while len(content) <= MAX_BYTES:
            if not select.select([pipe], [], [], _PATIENCE)[0]:
                raise OSError(errno.ETIMEDOUT, "nothing comes through this pipe")
            part = pipe.read(1 << 16)
            if not part:
                break
            content += part
    return content


def parse_document(
    raw: bytes, source: str, error: type[TdfscalError], form: Format = "yaml"
) -> Document:
    """Parse the bytes of a document; source names it in messages.

    Raises `error` for anything that is not one well-formed document within the limits.
    """
    if len(raw) > MAX_BYTES:
        raise error(
            f"is larger than {MAX_BYTES // 1_000_000} MB",
            where=source,
            hint="such a file is small: check that it is the one you mean",
        )
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = raw[: fault.start].count(b"\n") + 1
        raise error(
            f"byte 0x{raw[fault.start]:02x} is not UTF-8 text",
            where=f"{source}, line {line}",
            hint="save the file as UTF-8",
        ) from fault
    digest = hashlib.sha256(raw).hexdigest()
    if form == "json":
        return Document(_parse_json(text, source, error), {}, source, digest)
    builder = YamlBuilder(source, error)
    return Document(builder.build(text), builder.lines, source, digest)


def unreadable(path: Path, fault: OSError | ValueError) -> UsageError:
    """Say why a file cannot be read."""
    where = shorten(str(path), 300)
    if isinstance(fault, FileNotFoundError):
        return UsageError("there is no such file", where=where, hint="check the path")
    if isinstance(fault, IsADirectoryError):
        return UsageError("is a folder, not a file", where=where, hint="name a file in it")
    reason = fault.strerror if isinstance(fault, OSError) and fault.strerror else "no file's name"
    return UsageError(f"cannot be read: {reason}", where=where, hint="check the path")


def _parse_json(text: str, source: str, error: type[TdfscalError]) -> Any:
    def constant(name: str) -> NoReturn:
        raise error(f"{name} is not JSON", where=source, hint="leave it out or write null")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        content = dict(pairs)
        if len(content) < len(pairs):
            twice = next(k for k, count in Counter(k for k, _ in pairs).items() if count > 1)
            what = f"the key `{shorten(twice)}` occurs twice in one object"
            raise error(what, where=source, hint="keep one of them")
        return content

    try:
        content = json.loads(
            text,
            parse_constant=constant,
            parse_float=decimal,
            parse_int=integer,
            object_pairs_hook=unique,
        )
        too_deep = _deeper_than(MAX_DEPTH, content)
    except json.JSONDecodeError as fault:
        raise error(
            f"is not JSON: {fault.msg}",
            where=f"{source}, line {fault.lineno}, column {fault.colno}",
            hint="correct the syntax there",
        ) from fault
    except OverflowError as fault:
        raise error(str(fault), where=source, hint="check the number") from fault
    except RecursionError:
        too_deep = True
    if too_deep:
        what = f"is nested deeper than {MAX_DEPTH} levels"
        raise error(what, where=source, hint="check that it is the file you mean")
    return content


def _deeper_than(limit: int, content: Any) -> bool:
    if not isinstance(content, (dict, list)):
        return False
    inner = content.values() if isinstance(content, dict) else content
    return limit == 0 or any(_deeper_than(limit - 1, value) for value in inner)
