"""Plain rows as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path

from tdfscal.files.escaping import csv_cell
from tdfscal.files.saving import write_text


def save_rows(path: Path, rows: Iterable[tuple[str | float | int, ...]]) -> None:
    """Write header and rows, doubles to the last bit, whole or not at all. Raises UsageError."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(
        [csv_cell(cell) if isinstance(cell, str) else cell for cell in row] for row in rows
    )
    write_text(path, stream.getvalue())
