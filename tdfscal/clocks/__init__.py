"""Clocks of recorders that ran apart: how far one is from the other, by what both have seen.

Positions show when the terminal moves; the forces change then too, and balance at every instant
(theory, section 15). The moves name the lags that may be; the balance tells them apart.
"""

from tdfscal.clocks.lag import find_clock, find_clocks, forces_behind
from tdfscal.clocks.tracks import Reduction, Tracks

__all__ = ["Reduction", "Tracks", "find_clock", "find_clocks", "forces_behind"]
