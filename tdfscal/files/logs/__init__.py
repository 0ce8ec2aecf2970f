"""Reading recorded logs: CSV, Parquet and MCAP through one door."""

from tdfscal.files.logs.formats import is_log
from tdfscal.files.logs.reader import concatenate, iter_log, read_log

__all__ = ["concatenate", "is_log", "iter_log", "read_log"]
