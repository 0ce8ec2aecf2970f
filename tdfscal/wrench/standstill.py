"""Where the terminal stands still: what a free wrench has more elsewhere is the motion's."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from tdfscal.records import BoolArray, FloatArray
from tdfscal.wrench.resampling import Samples

#: A hinge that is slower than this, m/s, over this time, s, stands.
_SLOW, _SPAN = 2e-4, 0.2


@dataclass(slots=True)
class Standstill:
    """Watches samples pass, and tells of later times which of them lie at a stop."""

    _time: FloatArray = field(default_factory=lambda: np.empty(0))
    _still: BoolArray = field(default_factory=lambda: np.empty(0, dtype=np.bool_))

    def watch(self, samples: Iterable[Samples]) -> Iterator[Samples]:
        """Hand samples on; remembers those that `at` has not been asked for."""
        for piece in samples:
            self._time = np.concatenate([self._time, piece.time])
            self._still = np.concatenate([self._still, still(piece)])
            yield piece

    def at(self, time: FloatArray) -> BoolArray:
        """Tell which times, ascending from call to call, lie at a stop; forgets earlier ones."""
        if not len(self._time) or not len(time):
            return np.zeros(len(time), dtype=np.bool_)
        place = np.minimum(np.searchsorted(self._time, time), len(self._time) - 1)
        found = self._still[place]
        self._time, self._still = self._time[place[-1] :], self._still[place[-1] :]
        return found


def still(samples: Samples) -> BoolArray:
    """Which (N,) samples lie at a stop: every hinge slower than 0.2 mm/s over 0.2 s about them."""
    time = samples.time
    early = np.searchsorted(time, time - _SPAN / 2)
    late = np.minimum(np.searchsorted(time, time + _SPAN / 2), len(time) - 1)
    way = np.linalg.norm(samples.position[late] - samples.position[early], axis=2).max(axis=1)
    return np.asarray(way <= _SLOW * np.maximum(time[late] - time[early], _SPAN / 2))
