"""What a user may override in the search for dwells."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tdfscal.errors import UsageError


@dataclass(frozen=True, slots=True)
class DwellOptions:
    """Overrides of what is otherwise derived from the log's own rates and noise (None).

    Raises
    ------
    UsageError
        if a value is negative, not finite, or zero where that means nothing.
    """

    min_duration: float | None = None
    """Shortest dwell, s. Derived: 0.2 s, at least 5 bins."""
    settle_time: float | None = None
    """Time cut off after each move, s, in place of the search for the end of settling."""
    position_threshold: float | None = None
    """Change of an NCP's mean position, m, that counts as motion. Derived: from the noise."""
    force_threshold: float | None = None
    """Change of a mean force, N, that counts as a step. Derived: from the noise."""
    bin_width: float | None = None
    """Width of the bins that the samples are reduced to, s. Derived: 20 ms, at least two
    samples of the slowest stream."""
    max_bins: int = 225 * 1024
    """Above this many bins their width doubles, so that memory stays bounded: 70 MB with three
    supports. An hour fits at 20 ms, ten hours at 160 ms; from there on it takes four times as many
    bins until they double again, so that forty hours are seen in steps of 160 ms too."""

    def __post_init__(self) -> None:
        zero_allowed = {"settle_time"}
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None:
                continue
            if (
                not np.isfinite(value)
                or value < 0
                or (value == 0 and field.name not in zero_allowed)
            ):
                raise UsageError(
                    f"dwell option {field.name} is {value!r}",
                    hint="give a positive, finite number, or leave it out",
                )
