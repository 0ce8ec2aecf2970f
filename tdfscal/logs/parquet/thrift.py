"""Thrift's compact protocol, as far as the footers and page headers of Parquet need it.

A struct is a list of fields, each headed by its number and type, ended by a zero byte.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

TRUE: Final = 1
NUMBER: Final = frozenset({4, 5, 6})
BINARY: Final = 8
LIST: Final = 9
STRUCT: Final = 12
I8: Final = 3
_FALSE, _DOUBLE, _SET = 2, 7, 10
_DEPTH: Final = 16


class Cursor:
    """A place in some bytes. What is read past their end raises IndexError, what is nonsense or
    states a list of more than `most` elements ValueError.
    """

    __slots__ = ("_data", "_most", "position")

    def __init__(self, data: bytes, *, most: int) -> None:
        self._data, self._most = data, most
        self.position = 0

    def fields(self) -> Iterator[tuple[int, int]]:
        """Yield number and type of each field of the struct here; read or skip its value then."""
        field = 0
        data = self._data
        while head := data[self.position]:
            self.position += 1
            field = field + (head >> 4) if head >> 4 else self.number()
            yield field, head & 0x0F
        self.position += 1

    def byte(self) -> int:
        """Read one byte."""
        value = self._data[self.position]
        self.position += 1
        return value

    def number(self) -> int:
        """Read an integer."""
        value = self._varint()
        return (value >> 1) ^ -(value & 1)

    def text(self) -> bytes:
        """Read bytes."""
        length = self._varint()
        begin = self.position
        self.position += length
        if self.position > len(self._data):
            raise IndexError
        return self._data[begin : self.position]

    def items(self) -> tuple[int, int]:
        """Read the head of a list: how many elements follow, of which type."""
        head = self.byte()
        count = self._varint() if head >> 4 == 15 else head >> 4
        if count > self._most:
            raise ValueError(f"a list of {count} elements is stated")
        return count, head & 0x0F

    def skip(self, kind: int, depth: int = 0) -> None:
        """Pass over a value."""
        if depth > _DEPTH:
            raise ValueError("it is nested too deeply")
        if kind in NUMBER:
            self._varint()
        elif kind == BINARY:
            self.text()
        elif kind == STRUCT:
            for _, inner in self.fields():
                self.skip(inner, depth + 1)
        elif kind in (LIST, _SET):
            count, inner = self.items()
            for _ in range(count):
                # Within a list a truth value takes a byte.
                self.skip(I8 if inner in (TRUE, _FALSE) else inner, depth + 1)
        elif kind in (I8, _DOUBLE):
            self.position += 1 if kind == I8 else 8
        elif kind not in (TRUE, _FALSE):
            raise ValueError(f"type {kind} is not known")

    def _varint(self) -> int:
        value = shift = 0
        position = self.position
        while shift < 70:
            byte = self._data[position]
            position += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                self.position = position
                return value
            shift += 7
        raise ValueError("a number is too long")
