"""Thresholds of the contact wrench, as they stand beside rotations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.records import FloatArray

AXES = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True, slots=True)
class ContactThresholds:
    """What a contact-free wrench stays below but for so many stops an hour, on each axis.

    value : (6,), N and N·m, LCS. about : (3,), m, LCS. false_stops : per hour. path : what they
    hold for.
    """

    value: FloatArray
    about: tuple[float, float, float]
    false_stops: float
    path: str

    @property
    def bounded(self) -> bool:
        """Every one of them is known."""
        return bool(np.isfinite(self.value).all())

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know of them."""
        place = ", ".join(f"{x:g}" for x in self.about)
        return (
            f"Thresholds of the contact wrench, {', '.join(AXES)}, N and N·m, LCS, moments about "
            f"({place}) m: at most {self.false_stops:g} false stops an hour and axis,",
            f"{self.path}.",
        )
