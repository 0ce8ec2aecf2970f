"""Logs as text: CSV, TSV and what recorders make of them."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from typing import Final, cast

import numpy as np
import pyarrow as pa

from tdfscal.errors import DataError
from tdfscal.logs.common.damage import damage
from tdfscal.logs.common.read_ahead import mapped
from tdfscal.logs.common.request import (
    Block,
    Outcome,
    Piece,
    Reached,
    Request,
    by_signal,
    split,
)
from tdfscal.logs.text.contents import TextLook
from tdfscal.logs.text.file import open_text
from tdfscal.logs.text.header import Header, find_header
from tdfscal.logs.text.rows import RowParser, Rows
from tdfscal.records import FloatArray

_THREADS: Final = 2
_MAX_SAMPLES: Final = 1 << 16


def read_text(
    path: Path, request: Request, *, salvage: bool, reached: Reached
) -> Generator[Piece, None, Outcome]:
    """Read a text log in pieces; see `request.Reader`."""
    with damage(path, pa.ArrowException), open_text(path, salvage=salvage) as file:
        header = find_header(file.text, request)
        parser = RowParser(header, file.newline, request.decimal)
        look = TextLook(file) if request.describe else None
        line = header.lines + 1
        rows_before, faults = 0, 0
        warnings: list[str] = []

        def parsed(given: tuple[memoryview, bool]) -> tuple[memoryview, bool, Rows | None]:
            return (*given, parser.fast(given[0]))

        spare: list[bytearray] = []
        with closing(mapped(parsed, file.blocks(header.lines, spare), _THREADS)) as results:
            for block, whole, fast in results:
                if look is not None:
                    look.note(block, whole=whole)
                if not whole and request.rows == "timeseries":
                    warnings.append("the last line has no end and may be cut short; it is left out")
                    continue
                rows = fast or parser.slow(block, line, salvage=salvage)
                spare.append(cast(bytearray, block.obj))
                piece = _piece(rows, header, request, rows_before)
                rows_before += rows.count
                faults += rows.faults
                line += rows.lines
                reached(file.position)
                yield from split(piece, _MAX_SAMPLES)
    if rows_before == 0 and warnings:
        raise DataError(
            "the only row below the header has no end and may be cut short",
            hint="record the log again, or end the line if the row is whole",
        )
    if rows_before == 0:
        raise DataError("the file has a header and no rows", hint="record the log again")
    warnings += file.lost
    if faults:
        warnings.append(f"{faults} lines cannot be read and are left out")
    integrity = "salvaged" if salvage and warnings else file.integrity
    # Where the rig file's columns begin elsewhere, the rows were not all seen.
    seen = look.contents(path) if look is not None and look.skipped == header.lines else None
    return Outcome(integrity, tuple(warnings), seen)


def _piece(rows: Rows, header: Header, request: Request, rows_before: int) -> Piece:
    value: dict[int, FloatArray] = {}
    for number, factor in enumerate(header.factors):
        vector = rows.value[3 * number : 3 * number + 3]
        scale = request.signals[number].scale
        if scale is not None:
            vector *= np.array(scale)[:, None]
        elif factor != 1.0:
            vector *= factor
        value[number] = vector.T
    if header.time is None:
        time = np.arange(rows_before, rows_before + rows.count, dtype=np.float64)
        return (Block("row", time, value),)
    time, clock = rows.value[-1] * header.time_factor, f"column {request.time_field}"
    if not header.sparse:
        return (Block(clock, time, value),)
    return by_signal(clock, time, value, request)
