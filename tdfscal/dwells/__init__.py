"""From a log to static dwells: stretches where all NCPs are at rest and all forces settled."""

from tdfscal.dwells.bins import Bins, reduce_to_bins
from tdfscal.dwells.find import find_dwells
from tdfscal.dwells.options import DwellOptions

__all__ = ["Bins", "DwellOptions", "find_dwells", "reduce_to_bins"]
