"""From a log to static dwells: stretches where all NCPs are at rest and all forces settled."""

from tdfscal.dwells.bins import MOST_BINS, Bins, reduce_to_bins
from tdfscal.dwells.clock_offset import (
    is_large,
    misaligned,
    motion_offset,
    offset_finding,
    with_offset,
)
from tdfscal.dwells.find import dwells_of_bins, find_dwells

__all__ = [
    "MOST_BINS",
    "Bins",
    "dwells_of_bins",
    "find_dwells",
    "is_large",
    "misaligned",
    "motion_offset",
    "offset_finding",
    "reduce_to_bins",
    "with_offset",
]
