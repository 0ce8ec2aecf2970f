"""What a filter's departures say of turns that began with any of the last checks.

A turn of which the filter is not told shows in the departure of each check after it, and less with
each, since the filter takes it in. Its score and its information are sums over the checks since
(generalised likelihood ratio; Willsky and Jones, IEEE Trans. Autom. Control 21, 1976), whatever the
walk, and whatever else the filter was told.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tdfscal.numerics.information import Contrast, Information, contrast
from tdfscal.records import FloatArray

Kind = Literal["step", "creep"]
_KINDS: tuple[Kind, Kind] = ("step", "creep")
#: So many checks back a turn may have begun.
BACK = 48
#: Two checks of a creep are a step and noise: it must have begun before them.
_CREEP_CHECKS = 2
#: Steps are commoner: a creep must explain so much more χ² to be called one.
_CREEP_BETTER = 4.0


@dataclass(frozen=True, slots=True)
class Turn:
    """A sensor's turn by what was seen of it.

    onset : index of the first check that shows it. chi2 : that it takes away. size, std : (3,),
    rad, BCS; of a creep, per month.
    """

    kind: Kind
    onset: int
    chi2: float
    size: FloatArray
    std: FloatArray


@dataclass(frozen=True, slots=True)
class TurnsSince:
    """The filter after a check, and turns of n sensors that began with any of the last H checks.

    check : index of the last. known : after it. departure : of it from what was predicted.
    response : (2, H, C, 3n), of steps and creeps: what the filter has not taken in of a turn by
    1 rad, or by 1 rad a month. matrix (2, H, n, 3, 3), score (2, H, n, 3): of one sensor's turn, no
    other turned, by all departures.
    """

    check: int
    known: Information
    departure: Contrast
    response: FloatArray
    matrix: FloatArray
    score: FloatArray

    def then(self, own: Information, variance: FloatArray, gap: float) -> TurnsSince:
        """Return it after the next check, `gap` months later; the constants walked by variance."""
        before = self.known.walked(variance)
        departure, known = contrast(before, own), before + own
        _, held, C, wide = self.response.shape
        kept = min(held, BACK - 1)
        response = np.zeros((2, kept + 1, C, wide))
        response[:, :kept] = self.response[:, held - kept :]
        response[0, kept] = np.eye(C, wide)
        response[1] += gap * np.eye(C, wide)
        parts = response.reshape(2, kept + 1, C, wide // 3, 3)
        shown = (departure.matrix @ response).reshape(parts.shape)
        matrix = np.einsum("ehcia,ehcib->ehiab", parts, shown)
        score = np.einsum("ehcia,c->ehia", parts, departure.score)
        matrix[:, :kept] += self.matrix[:, held - kept :]
        score[:, :kept] += self.score[:, held - kept :]
        left = known.covariance @ (before.matrix @ response)
        return TurnsSince(self.check + 1, known, departure, left, matrix, score)

    def of(self, kind: Kind, sensor: int, onset: int) -> Contrast:
        """Return what is seen of the turn of one sensor that began with a check."""
        at = _KINDS.index(kind), onset - self.check - 1, sensor
        return Contrast(self.matrix[at], self.score[at])

    def likeliest(
        self, sensor: int, after: int, until: int, kinds: Iterable[Kind] = _KINDS
    ) -> Turn | None:
        """Turn of a sensor that explains most; it began after one check and until another.

        None where there is none.
        """
        begun = range(max(after, self.check - self.response.shape[1]) + 1, until + 1)
        turns = [
            self._turn(kind, sensor, onset)
            for kind in kinds
            for onset in begun
            if kind == "step" or onset <= self.check - _CREEP_CHECKS
        ]
        return max(
            turns, key=lambda turn: turn.chi2 - _CREEP_BETTER * (turn.kind == "creep"), default=None
        )

    def _turn(self, kind: Kind, sensor: int, onset: int) -> Turn:
        seen = self.of(kind, sensor, onset)
        size, covariance = seen.change(slice(0, 3))
        return Turn(kind, onset, seen.chi2()[0], size, np.sqrt(np.diagonal(covariance)))


def begin(prior: Information, own: Information, sensors: int) -> TurnsSince:
    """Return the filter after the first check, from which all turns count."""
    size = len(prior.score)
    return TurnsSince(
        0,
        prior + own,
        Contrast(np.zeros((size, size)), np.zeros(size)),
        np.zeros((2, 0, size, 3 * sensors)),
        np.zeros((2, 0, sensors, 3, 3)),
        np.zeros((2, 0, sensors, 3)),
    )
