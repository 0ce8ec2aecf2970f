"""Frozen records: dataclasses that share their methods.

`dataclass(frozen=True)` writes and compiles six functions for each class, which was a twentieth of
a calibration's time; here only `__init__` is made for each.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import FrozenInstanceError, dataclass, field, replace
from functools import partial
from reprlib import recursive_repr
from textwrap import shorten
from typing import Any, dataclass_transform

__all__ = ["FrozenInstanceError", "field", "record", "replace"]


def _set(self: Any, name: str, value: object) -> None:
    if name in self.__dict__ or name not in self.__dataclass_fields__:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")
    self.__dict__[name] = value


def _delete(self: Any, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _compared(self: Any) -> tuple[object, ...]:
    return tuple(getattr(self, f.name) for f in self.__dataclass_fields__.values() if f.compare)


def _equal(self: Any, other: object) -> bool:
    return _same(_compared(self), _compared(other)) if type(other) is type(self) else NotImplemented


def _same(a: Any, b: Any) -> bool:
    """Equal, arrays by their shapes and elements."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if hasattr(a, "shape") and hasattr(b, "shape"):
        return a.shape == b.shape and bool((a == b).all())
    return a is b or bool(a == b)


def _hash(self: Any) -> int:
    return hash(tuple(map(_token, _compared(self))))


def _token(value: Any) -> object:
    """What equal values have in common and can be hashed: of an array its shape."""
    if isinstance(value, tuple):
        return tuple(map(_token, value))
    if isinstance(value, Hashable):
        return value
    return value.shape if hasattr(value, "shape") else len(value)


@recursive_repr()
def _repr(self: Any) -> str:
    shown = (f.name for f in self.__dataclass_fields__.values() if f.repr)
    inside = ", ".join(f"{name}={_shown(getattr(self, name))}" for name in shown)
    return f"{type(self).__qualname__}({inside})"


def _shown(value: Any) -> str:
    """Of an array its shape, all else as it is, shortened."""
    if shape := getattr(value, "shape", ()):
        return f"<array {'×'.join(map(str, shape))}>"
    return shorten(repr(value), 200)


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def record(cls: Any = None, /, *, eq: bool = True, kw_only: bool = False) -> Any:
    """Make a class a frozen record; eq=False: it equals itself alone."""
    if cls is None:
        return partial(record, eq=eq, kw_only=kw_only)
    shared: dict[str, object] = {"__setattr__": _set, "__delattr__": _delete, "__repr__": _repr}
    if eq:
        shared |= {"__eq__": _equal, "__hash__": _hash}
    for name, method in shared.items():
        if not any(name in vars(base) for base in cls.__mro__[:-1]):
            setattr(cls, name, method)
    return dataclass(repr=False, eq=False, kw_only=kw_only)(cls)
