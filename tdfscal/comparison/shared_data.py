"""What data two estimates share."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

#: first, second: the recordings of this one all went into the other too, which has more.
Relation = Literal["apart", "first", "second", "same", "overlapping"]


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recording that went into an estimate.

    sha256 : of its bytes. span : begin and end of the part that was used, s in the recording's
    time; None for all of it, or where that is not known.
    """

    sha256: str
    span: tuple[float, float] | None = None

    def meets(self, other: Recorded) -> bool:
        """Whether some of the same samples are in both."""
        if self.sha256 != other.sha256:
            return False
        if self.span is None or other.span is None:
            return True
        return min(self.span[1], other.span[1]) > max(self.span[0], other.span[0])

    def lies_in(self, other: Recorded) -> bool:
        """Whether all of its samples are in the other too."""
        if not self.meets(other):
            return False
        if self.span is None or other.span is None:
            return other.span is None or self.span == other.span
        return other.span[0] <= self.span[0] and self.span[1] <= other.span[1]


def relation(first: Collection[Recorded], second: Collection[Recorded]) -> Relation:
    """What two estimates have in common.

    Two parts of one recording, one within the other, count as the same: which of their samples
    were averaged alike is not known.
    """
    if not any(a.meets(b) for a in first for b in second):
        return "apart"
    if {a.sha256 for a in first} == {b.sha256 for b in second}:
        return "same"
    if all(any(a.lies_in(b) for b in second) for a in first):
        return "first"
    if all(any(b.lies_in(a) for a in first) for b in second):
        return "second"
    return "overlapping"
