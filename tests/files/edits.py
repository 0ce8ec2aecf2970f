"""Edits of a document at its places."""

import copy
from collections.abc import Callable, Iterator
from typing import Any

Place = tuple[str | int, ...]
#: In place of a value: the key is taken away.
DROP = object()


def places(value: Any, place: Place = ()) -> Iterator[Place]:
    """Every key and entry, the document itself excepted."""
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield (*place, key)
            yield from places(value[key], (*place, key))


def kinds(document: Any) -> list[Place]:
    """One place of each kind: of a matrix's hundred entries the last."""
    return list(
        {tuple(p for p in at if isinstance(p, str)): at for at in places(document)}.values()
    )


def at(document: Any, place: Place) -> Any:
    """The value at a place."""
    for part in place:
        document = document[part]
    return document


def place_of(text: str) -> Place:
    """Of `supports.0.rpy`; the empty text is the document itself."""
    return tuple(int(part) if part.isdigit() else part for part in text.split(".") if part)


def edited(document: dict[str, Any], *changes: tuple[str, Any]) -> dict[str, Any]:
    """A copy with other values at some places; a function makes one of the old value."""
    content = copy.deepcopy(document)
    for where, value in changes:
        *path, last = place_of(where)
        inner = at(content, tuple(path))
        if value is DROP:
            del inner[last]
        else:
            inner[last] = value(inner[last]) if callable(value) else value
    return content


def nudged(by: float) -> Callable[[float], float]:
    """Moves a number."""
    return lambda value: value + by
