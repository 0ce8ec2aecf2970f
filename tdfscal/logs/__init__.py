"""Reading recorded logs, of every format through one door."""

from tdfscal.logs.formats import expand, is_log, looks_recorded
from tdfscal.logs.reader import Moment, TimeWindow, concatenate, iter_log, read_log

__all__ = [
    "Moment",
    "TimeWindow",
    "concatenate",
    "expand",
    "is_log",
    "iter_log",
    "looks_recorded",
    "read_log",
]
