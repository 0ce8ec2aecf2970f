"""From a log to static dwells: stretches where all NCPs are at rest and all forces settled."""

from tdfscal.dwells.bins import MOST_BINS, Bins, reduce_to_bins
from tdfscal.dwells.clock_offset import Offset, misaligned, motion_offset
from tdfscal.dwells.find import dwells_of_bins, find_dwells

__all__ = [
    "MOST_BINS",
    "Bins",
    "Offset",
    "dwells_of_bins",
    "find_dwells",
    "misaligned",
    "motion_offset",
    "reduce_to_bins",
]
