"""Why a log holds no static dwell: what was seen, and what would do."""

from __future__ import annotations

import numpy as np

from tdfscal.dwells.bins import Bins, zeros
from tdfscal.dwells.field import SHORTEST
from tdfscal.dwells.noise_level import runs
from tdfscal.errors import DataError
from tdfscal.records import Absence, BoolArray, Dwells

_SAMPLES = 20  # per stop: ten for the shortest dwell, as many for what is kept clear of moves
_STOP = 2.0  # s, that a stop should last at least


def no_dwell(dwells: Dwells) -> DataError:
    """The error for a log without any dwell."""
    absence = dwells.absence or Absence(
        "the NCPs never rest with settled forces", "hold each posture for at least two seconds"
    )
    return DataError(f"no static dwell was found: {absence.seen}", where="log", hint=absence.advice)


def explain(bins: Bins, moving: BoolArray, shortest: float) -> Absence:
    """Say why no stretch of the log passes.

    moving : (B,), where the search sees the NCPs move. shortest : s, of a dwell.
    """
    if found := zeros(bins):
        return Absence(
            f"the {found.values['signal']} of {found.subject[0]} drops to 0, 0, 0 and returns, at "
            f"{100 * (found.size or 0.0):.2g} % of the samples, as if the recorder wrote zeros "
            "where it had no reading",
            "let the recorder leave such cells empty, or repeat the last reading",
        )
    begin, end = runs(~moving)
    rest, period = float((end - begin).max(initial=0) * bins.width), float(bins.period.max())
    if _SAMPLES / 2 * period >= max(rest, SHORTEST):
        stop, rate = _rounded_up(_SAMPLES * period), _rounded_up(_SAMPLES / max(rest, _STOP))
        return Absence(
            f"sampled too slowly: there is a sample every {period:.3g} s, a dwell takes "
            f"{_SAMPLES / 2:.0f} of them, and the NCPs rest for {rest:.2g} s at most",
            f"record at {rate:g} Hz or more, or hold each posture for at least {stop:g} s",
            stop,
        )
    if not len(begin):
        return Absence(
            "the NCPs never rest: their positions change from the first sample to the last",
            f"hold each posture for at least {_STOP:g} s, and check that the position fields are "
            "those of the NCPs, unfiltered",
        )
    if rest < shortest:
        return Absence(
            f"the stops are too short: the NCPs rest {len(begin)} times, for {rest:.2g} s at most, "
            f"and a dwell takes {shortest:.2g} s of settled forces",
            f"hold each posture for at least {_STOP:g} s",
            _STOP,
        )
    stop = _rounded_up(2.0 * rest + _STOP)
    return Absence(
        f"the NCPs rest for up to {rest:.2g} s, and the forces never settle meanwhile: a smoothing "
        "filter, slow settling, or a touch",
        "switch the smoothing of sensor, amplifier or recorder off, look whether something touches "
        f"the terminal, or hold each posture for at least {stop:g} s",
        stop,
    )


def _rounded_up(value: float) -> float:
    """To two digits, never less."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(np.ceil(value / digit - 1e-9) * digit)
