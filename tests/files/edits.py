"""Edits of a document: as told, or at random of a number, a word, a switch, a key, an order."""

import copy
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

Place = tuple[str | int, ...]
#: In place of a value: the key is taken away.
DROP = object()


@dataclass(frozen=True)
class Edit:
    """An edited copy of a document: what was done, and where."""

    kind: str
    place: Place
    document: dict[str, Any]


def places(value: Any, place: Place = ()) -> Iterator[Place]:
    """Every key and entry, the document itself excepted."""
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield (*place, key)
            yield from places(value[key], (*place, key))


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


def edits(document: dict[str, Any], count: int, seed: int) -> Iterator[Edit]:
    """Edits that change the document, one each; keys of all depths are equally likely."""
    rng = random.Random(seed)
    known: dict[tuple[str, ...], list[Place]] = {}
    for place in places(document):  # one of a matrix's hundred entries, not a hundred of them
        known.setdefault(tuple(p for p in place if isinstance(p, str)), []).append(place)
    while count:
        place = rng.choice(rng.choice(list(known.values())))
        other = copy.deepcopy(document)
        inner = at(other, place[:-1])
        kind, value = _other(inner[place[-1]], rng)
        if kind == "dropped":
            del inner[place[-1]]
        else:
            inner[place[-1]] = value
        if other != document:
            count -= 1
            yield Edit(kind, place, other)


def _other(value: Any, rng: random.Random) -> tuple[str, Any]:
    if rng.random() < 0.15:
        return "dropped", None
    if value is None:
        return "null", rng.choice([0.0, 1.0])
    if isinstance(value, bool):
        return "switch", not value
    if isinstance(value, int) and abs(value) > 1e300:
        return "number", value + 1
    if isinstance(value, int | float):
        factor = 1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-6, 0)
        return "number", rng.choice([value * factor, -value, value + 1, 0, value / 1000])
    if isinstance(value, str):
        words = ["", value + "x", value[:-1], value[::-1], "accepted", "2020-01-01T00:00:00Z"]
        return "text", rng.choice(words)
    if isinstance(value, list) and len(value) > 1:
        a, b = rng.sample(range(len(value)), 2)
        value[a], value[b] = value[b], value[a]
        return "swapped", value
    return "emptied", type(value)()
