"""The footer of a Parquet file, read by ourselves and checked against itself.

No checksum covers a footer, and pyarrow believes it: it may abort the process over a damaged one,
or allocate what it states. What is stated twice must agree, here, before pyarrow opens the file.
Field numbers are those of parquet-format's parquet.thrift.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tdfscal.logs.parquet.thrift import BINARY, I8, LIST, NUMBER, STRUCT, TRUE, Cursor

MAX_FOOTER: Final = 16 << 20
"""Largest footer, in bytes, that is read; that of a day at 1 kHz has a few MB at most."""
MAX_LIST: Final = 1 << 20
"""Longest list in a footer."""

_MAGIC: Final = b"PAR1"
_MOST_NODES, _DEEPEST, _LONGEST = 1 << 16, 32, 1000
_ROWS_PER_BYTE: Final = 4
_REQUIRED, _REPEATED = 0, 2
_WIDTH: Final = {1: 4, 2: 8, 3: 12, 4: 4, 5: 8}  # of INT32, INT64, INT96, FLOAT, DOUBLE
_FIXED: Final = 7  # FIXED_LEN_BYTE_ARRAY
_WIDEST: Final = 32
_DATA_PAGES: Final = (0, 3)
_DECIMAL, _TIMESTAMP, _INTEGER = 5, 8, 10
_CONVERTED: Final[dict[int, tuple[int, ...]]] = {
    5: (_DECIMAL,),
    9: (_TIMESTAMP, 1),
    10: (_TIMESTAMP, 2),
    **{11 + 4 * signed + k: (_INTEGER, 8 << k, signed) for signed in (0, 1) for k in range(4)},
}


@dataclass(frozen=True, slots=True)
class Leaf:
    """A column of the schema.

    kind : physical type. width : bytes of a value, None where they vary. required : neither it nor
    what is above it can be missing. repeated : it or something above it is a list.
    """

    path: str
    kind: int
    width: int | None
    required: bool
    repeated: bool

    @property
    def small(self) -> bool:
        """Whether it can hold numbers, so that a row of it takes no more than a few bytes."""
        return not self.repeated and self.width is not None and self.width <= _WIDEST

    @property
    def holds(self) -> str:
        """What it holds where that is not small."""
        return "a list" if self.repeated else {0: "bool", 6: "string"}.get(self.kind, "bytes")


@dataclass(frozen=True, slots=True)
class Part:
    """A column within a row group: its pages are bytes [begin, end) of the file.

    encodings : of data pages, with how many pages have it where that is stated.
    """

    leaf: Leaf
    values: int
    compressed: bool
    begin: int
    end: int
    encodings: dict[int, int | None]


@dataclass(frozen=True, slots=True)
class Group:
    """A row group, with one part per leaf."""

    rows: int
    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class Footer:
    """Columns and row groups of a file."""

    leaves: tuple[Leaf, ...]
    groups: tuple[Group, ...]
    rows: int


@dataclass(slots=True)
class _Node:
    """An element of the schema.

    converted, scale : what the old way of stating a type says. logical : what the new one says.
    """

    name: str = ""
    children: int = 0
    kind: int | None = None
    length: int = -1
    repetition: int = _REQUIRED
    converted: int | None = None
    scale: int | None = None
    logical: tuple[int, ...] | None = None


def read_footer(path: Path) -> Footer:
    """Read and check the footer.

    Raises
    ------
    OSError : the file cannot be read.
    ValueError : it is no Parquet file, or its footer is damaged or absurd.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(4) != _MAGIC or size < 12:
            raise ValueError("it does not begin as a Parquet file")
        file.seek(size - 8)
        length, magic = struct.unpack("<I4s", file.read(8))
        if magic != _MAGIC:
            raise ValueError("it does not end as a Parquet file")
        if length > min(size - 12, MAX_FOOTER):
            raise ValueError(f"a footer of {length} bytes is stated")
        file.seek(size - 8 - length)
        data = file.read(length)
    try:
        footer = _footer(Cursor(data, most=MAX_LIST), size - 8 - length)
    except IndexError:
        raise ValueError("the footer is cut short") from None
    if footer.rows > _ROWS_PER_BYTE * size:
        raise ValueError(f"{footer.rows} rows are stated in a file of {size} bytes")
    return footer


def _footer(cursor: Cursor, end: int) -> Footer:
    leaves: tuple[Leaf, ...] = ()
    groups: list[Group] = []
    rows = -1
    for number, kind in cursor.fields():
        if number == 2 and kind == LIST:
            leaves = _leaves([_node(cursor) for _ in range(_items(cursor))])
        elif number == 3 and kind in NUMBER:
            rows = cursor.number()
        elif number == 4 and kind == LIST:
            groups = [_group(cursor, leaves, end) for _ in range(_items(cursor))]
        else:
            cursor.skip(kind)
    if rows != sum(group.rows for group in groups):
        raise ValueError("the footer contradicts itself about the number of rows")
    return Footer(leaves, tuple(groups), rows)


def _items(cursor: Cursor, kinds: frozenset[int] = frozenset({STRUCT})) -> int:
    count, kind = cursor.items()
    if kind not in kinds:
        raise ValueError("the footer lists something else than it should")
    return count


def _node(cursor: Cursor) -> _Node:
    node = _Node()
    for number, kind in cursor.fields():
        if number == 4 and kind == BINARY:
            node.name = cursor.text().decode("utf-8")
        elif number == 10 and kind == STRUCT:
            node.logical = _logical(cursor)
        elif kind in NUMBER:
            value = cursor.number()
            match number:
                case 1:
                    node.kind = value
                case 2:
                    node.length = value
                case 3:
                    node.repetition = value
                case 5:
                    node.children = value
                case 6:
                    node.converted = value
                case 7:
                    node.scale = value
        else:
            cursor.skip(kind)
    return node


def _logical(cursor: Cursor) -> tuple[int, ...] | None:
    """Return (DECIMAL, scale), (TIMESTAMP, unit), (INTEGER, bits, signed); None for others."""
    found: tuple[int, ...] | None = None
    for number, kind in cursor.fields():
        if kind != STRUCT:
            cursor.skip(kind)
            continue
        said: dict[int, int] = {}
        for inner, what in cursor.fields():
            if what in NUMBER:
                said[inner] = cursor.number()
            elif what == I8:
                said[inner] = cursor.byte()
            elif what == STRUCT and number == _TIMESTAMP:
                for unit, empty in cursor.fields():
                    said[inner] = unit
                    cursor.skip(empty)
            else:
                said[inner] = int(what == TRUE)
                cursor.skip(what)
        match number:
            case 5:
                found = (_DECIMAL, said.get(1, 0))
            case 8:
                found = (_TIMESTAMP, said.get(2, 0))
            case 10:
                found = (_INTEGER, said.get(1, 0), said.get(2, 0))
    return found


def _leaves(nodes: list[_Node]) -> tuple[Leaf, ...]:
    """Leaves of the tree that the nodes are, listed depth first."""
    if not nodes or len(nodes) > _MOST_NODES:
        raise ValueError(f"a schema of {len(nodes)} elements is stated")
    found: list[Leaf] = []
    # Nodes whose children are still to come: how many, path, required, repeated.
    above: list[tuple[int, str, bool, bool]] = [(nodes[0].children, "", True, False)]
    for node in nodes[1:]:
        while above and not above[-1][0]:
            above.pop()
        if not above or len(above) > _DEEPEST:
            raise ValueError("the footer's schema is no tree")
        left, parent, required, repeated = above.pop()
        above.append((left - 1, parent, required, repeated))
        path = f"{parent}.{node.name}" if parent else node.name
        if len(path) > _LONGEST:
            raise ValueError("a column's name is too long")
        _check_type(node)
        required &= node.repetition == _REQUIRED
        repeated |= node.repetition == _REPEATED
        if node.children > 0:
            above.append((node.children, path, required, repeated))
        elif node.kind is None:
            raise ValueError(f"the footer lacks the type of column {path}")
        else:
            width = node.length if node.kind == _FIXED else _WIDTH.get(node.kind)
            found.append(Leaf(path, node.kind, width, required, repeated))
    if any(left for left, *_ in above):
        raise ValueError("the footer's schema is no tree")
    return tuple(found)


def _check_type(node: _Node) -> None:
    """Refuse a type that is stated in both ways, differently."""
    if node.logical is None:
        return
    old = _CONVERTED.get(node.converted) if node.converted is not None else None
    if old == (_DECIMAL,):
        old = (_DECIMAL, node.scale or 0)
    if node.converted is not None and old != node.logical:
        raise ValueError(f"the footer contradicts itself about the type of column {node.name}")


def _group(cursor: Cursor, leaves: tuple[Leaf, ...], end: int) -> Group:
    parts: list[Part] = []
    rows = -1
    for number, kind in cursor.fields():
        if number == 1 and kind == LIST:
            count = _items(cursor)
            if count != len(leaves):
                raise ValueError("the footer contradicts itself about the number of columns")
            parts = [_part(cursor, leaf, end) for leaf in leaves]
        elif number == 3 and kind in NUMBER:
            rows = cursor.number()
        else:
            cursor.skip(kind)
    if rows < 0 or len(parts) < len(leaves):
        raise ValueError("the footer lacks what describes a row group")
    if any(part.values != rows for part in parts if not part.leaf.repeated):
        raise ValueError("the footer contradicts itself about the number of rows")
    return Group(rows, tuple(parts))


def _part(cursor: Cursor, leaf: Leaf, end: int) -> Part:
    part: Part | None = None
    for number, kind in cursor.fields():
        if number == 3 and kind == STRUCT:
            part = _metadata(cursor, leaf, end)
        elif number == 1:
            raise ValueError("a column is said to lie in another file")
        else:
            cursor.skip(kind)
    if part is None:
        raise ValueError(f"the footer lacks what describes column {leaf.path}")
    return part


def _metadata(cursor: Cursor, leaf: Leaf, end: int) -> Part:
    number_of: dict[int, int] = {}
    path = ""
    plain: list[int] = []
    counted: dict[int, int | None] = {}
    for number, kind in cursor.fields():
        if kind in NUMBER:
            number_of[number] = cursor.number()
        elif number == 3 and kind == LIST:
            count = _items(cursor, frozenset({BINARY}))
            path = ".".join(cursor.text().decode("utf-8") for _ in range(count))
        elif number == 2 and kind == LIST:
            plain = [cursor.number() for _ in range(_items(cursor, NUMBER))]
        elif number == 13 and kind == LIST:
            counted = _page_counts(cursor)
        else:
            cursor.skip(kind)
    try:
        kind, codec, values = number_of[1], number_of[4], number_of[5]
        length, begin = number_of[7], number_of[9]
    except KeyError:
        raise ValueError(f"the footer lacks what describes column {leaf.path}") from None
    if (path, kind) != (leaf.path, leaf.kind):
        raise ValueError(f"the footer contradicts itself about column {leaf.path}")
    dictionary = number_of.get(11, 0)
    if 0 < dictionary < begin:
        begin = dictionary
    if values == 0:
        begin, length = len(_MAGIC), 0  # without rows there need not be a page
    if not (len(_MAGIC) <= begin and 0 <= length <= end - begin and values >= 0):
        raise ValueError(f"column {leaf.path} is said to lie outside the file")
    encodings = counted or dict.fromkeys(plain)
    return Part(leaf, values, codec != 0, begin, begin + length, encodings)


def _page_counts(cursor: Cursor) -> dict[int, int | None]:
    """Data pages by encoding; empty where they are not stated."""
    found: dict[int, int | None] = {}
    for _ in range(_items(cursor)):
        stated: dict[int, int] = {}
        for number, kind in cursor.fields():
            if kind in NUMBER:
                stated[number] = cursor.number()
            else:
                cursor.skip(kind)
        if stated.get(1) in _DATA_PAGES:
            found[stated.get(2, -1)] = (found.get(stated.get(2, -1)) or 0) + stated.get(3, 0)
    return found
