"""Logs as text: CSV, TSV and what recorders make of them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Final

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
from tdfscal.logs.text.file import EXPANDING, open_text
from tdfscal.logs.text.header import find_header
from tdfscal.logs.text.rows import RowParser, Rows

_THREADS: Final = 2
_MAX_SAMPLES: Final = 1 << 16


def read_text(path: Path, request: Request, *, reached: Reached) -> Items:
    """Read a text log in pieces; see `request.Reader`."""
    with damage(path, *EXPANDING), open_text(path) as file:
        header = find_header(file.lines, request)
        parser = RowParser(header, file.newline, request.mapping.decimal)
        look = TextLook(file) if request.describe else None
        line = header.lines + 1
        rows_before = 0

        def parsed(given: tuple[bytes, bool]) -> tuple[bytes, bool, Rows | None]:
            return (*given, parser.fast(given[0]))

        with closing(mapped(parsed, file.blocks(header.lines), _THREADS)) as results:
            for block, whole, fast in results:
                if look is not None:
                    look.note(block, whole=whole)
                if not whole and request.mapping.rows == "timeseries":
                    continue
                rows = fast or parser.slow(block, line)
                n = len(header.factors)
                vectors = rows.value[: 3 * n].reshape(n, 3, rows.count)
                time = None if header.time is None else rows.value[-1] * header.time_factor
                piece = table_piece(
                    request, vectors, header.factors, time, rows_before, sparse=header.sparse
                )
                rows_before += rows.count
                line += rows.lines
                reached(file.position)
                yield from split(piece, _MAX_SAMPLES)
    if rows_before == 0 and file.cut_at is not None:
        raise DataError(
            "the only row below the header has no end and may be cut short",
            hint="record the log again, or end the line if the row is whole",
        )
    if rows_before == 0:
        raise DataError("the file has a header and no rows", hint="record the log again")
    cut_at = file.cut_at if request.mapping.rows == "timeseries" else None
    # Where the rig file's columns begin elsewhere, the rows were not all seen.
    seen = look.contents(path) if look is not None and look.skipped == header.lines else None
    yield Outcome(file.integrity, (), seen, cut_at)
