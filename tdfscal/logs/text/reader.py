"""Logs as text: CSV, TSV and what recorders make of them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Final

import pyarrow as pa

from tdfscal.errors import DataError
from tdfscal.logs.common.damage import damage
from tdfscal.logs.common.read_ahead import mapped
from tdfscal.logs.common.request import (
    Items,
    Outcome,
    Reached,
    Request,
    split,
    table_piece,
)
from tdfscal.logs.text.contents import TextLook
from tdfscal.logs.text.file import open_text
from tdfscal.logs.text.header import find_header
from tdfscal.logs.text.rows import RowParser, Rows

_THREADS: Final = 2
_MAX_SAMPLES: Final = 1 << 16


def read_text(path: Path, request: Request, *, salvage: bool, reached: Reached) -> Items:
    """Read a text log in pieces; see `request.Reader`."""
    with damage(path, pa.ArrowException), open_text(path, salvage=salvage) as file:
        header = find_header(file.lines, request)
        parser = RowParser(header, file.newline, request.mapping.decimal)
        look = TextLook(file) if request.describe else None
        line = header.lines + 1
        rows_before, faults = 0, 0
        warnings: list[str] = []

        def parsed(given: tuple[bytes, bool]) -> tuple[bytes, bool, Rows | None]:
            return (*given, parser.fast(given[0]))

        with closing(mapped(parsed, file.blocks(header.lines), _THREADS)) as results:
            for block, whole, fast in results:
                if look is not None:
                    look.note(block, whole=whole)
                if not whole and request.mapping.rows == "timeseries":
                    warnings.append("the last line has no end and may be cut short; it is left out")
                    continue
                rows = fast or parser.slow(block, line, salvage=salvage)
                n = len(header.factors)
                vectors = rows.value[: 3 * n].reshape(n, 3, rows.count)
                time = None if header.time is None else rows.value[-1] * header.time_factor
                piece = table_piece(
                    request, vectors, header.factors, time, rows_before, sparse=header.sparse
                )
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
    yield Outcome(integrity, tuple(warnings), seen)
