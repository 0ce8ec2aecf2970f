"""Contact wrenches as a growing table, CSV or Parquet, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.errors import DataError, UsageError
from tdfscal.files.output_places import check_suffix
from tdfscal.files.saving import replacing
from tdfscal.records import FloatArray
from tdfscal.wrench.contact_wrench import COMPONENTS
from tdfscal.wrench.stream import WrenchPiece

SUFFIXES = (".csv", ".parquet")
COLUMNS = (
    "time",
    *COMPONENTS,
    *(f"u_{name}" for name in COMPONENTS),
    *(f"u_cal_{name}" for name in COMPONENTS),
    *(f"raw_{name}" for name in COMPONENTS),
)
"""time in s; the contact wrench, its standard uncertainties with the sample's noise and by the
calibration alone, the uncalibrated wrench; N, N·m."""


def write_wrenches(
    path: Path,
    pieces: Iterable[WrenchPiece],
    about: Mapping[str, str],
    watch: Callable[[WrenchPiece], None] = lambda piece: None,
) -> int:
    """Write the pieces as they come and return the number of rows.

    about : what the values are, kept in a Parquet file's metadata. watch : sees each piece after
    it was written. A standard uncertainty that is not known is null (CSV: empty).

    Raises UsageError where the file cannot be written and DataError where a wrench is no number;
    what the pieces raise passes through. Then no file appears.
    """
    import pyarrow as pa

    check_suffix(path, SUFFIXES)
    schema = pa.schema([(name, pa.float64()) for name in COLUMNS], metadata=dict(about))
    rows = 0
    with replacing(path) as beside:
        try:
            with _writer(path, beside, schema) as sink:
                for piece in numbers_only(pieces):
                    sink.write_table(_table(piece, schema))
                    rows += piece.time.size
                    watch(piece)
        except OSError as fault:
            raise UsageError(
                f"cannot be written: {fault.strerror or fault}",
                where=str(path),
                hint="check that there is room",
            ) from fault
    return rows


def numbers_only(pieces: Iterable[WrenchPiece]) -> Iterator[WrenchPiece]:
    """Pass pieces on. Raises DataError at the first wrench that is no number."""
    for piece in pieces:
        bad = ~np.isfinite(piece.wrench.value.sum(axis=1) + piece.wrench.raw.sum(axis=1))
        if bad.any():
            raise DataError(
                f"the contact wrench at {piece.time[int(np.argmax(bad))]:.9g} s is no number",
                where="log",
                hint="check the positions and forces there, and the units of the log block in "
                "rig.yaml",
            )
        yield piece


def columns_of(piece: WrenchPiece) -> dict[str, FloatArray]:
    """Return the columns of a piece by their names; an unknown uncertainty is NaN."""
    w = piece.wrench
    own, common = (np.where(np.isfinite(s), s, np.nan) for s in (w.std, w.calibration_std))
    values = [piece.time, *w.value.T, *own.T, *common.T, *w.raw.T]
    return dict(zip(COLUMNS, values, strict=True))


def _writer(path: Path, beside: Path, schema: Any) -> Any:
    if path.suffix.lower() == ".csv":
        from pyarrow import csv

        return csv.CSVWriter(beside, schema, write_options=csv.WriteOptions(quoting_style="none"))
    from pyarrow import parquet

    return parquet.ParquetWriter(
        beside,
        schema,
        compression="zstd",
        use_dictionary=False,
        write_statistics=False,
        write_page_checksum=True,
    )


def _table(piece: WrenchPiece, schema: Any) -> Any:
    import pyarrow as pa

    from tdfscal.files.arrow import as_arrow

    columns = columns_of(piece).values()
    return pa.table([as_arrow(v, _unknown(v)) for v in columns], schema=schema)


def _unknown(values: FloatArray) -> Any:
    finite = np.isfinite(values)
    return None if finite.all() else ~finite
