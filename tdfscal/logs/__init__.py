"""Reading recorded logs, of every format through one door."""

from tdfscal.logs.clock import by_wall_clock
from tdfscal.logs.formats import expand, is_log, looks_recorded
from tdfscal.logs.reader import Moment, TimeWindow, concatenate, iter_log, read_log

__all__ = [
    "Moment",
    "TimeWindow",
    "by_wall_clock",
    "concatenate",
    "expand",
    "is_log",
    "iter_log",
    "looks_recorded",
    "read_log",
]
