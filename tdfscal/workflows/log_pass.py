"""A log as it passes: its pieces go on to the work, what they say of their files stays here."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from tdfscal.checks.repeated_samples import Repeat, RepeatedSamples, counted_once
from tdfscal.dwells import find_dwells
from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError
from tdfscal.logs import TimeWindow, iter_log
from tdfscal.records import Dwells, InputFile, Log, Rig
from tdfscal.workflows.campaign import Campaign
from tdfscal.workflows.progress import SILENT, Progress

#: Warnings of a log that an error repeats at most; those of its clocks come first.
_REPEATED = 3
#: Stops left out per dwell found, from which an error says so.
_LOST = 2
#: A reading this close to its capacity, relative, stands at it.
_AT_CAPACITY = 1e-6
_CLOCK = re.compile(r"clock|header time|step back|repeat the time")


@dataclass(frozen=True, slots=True)
class Settings:
    """What holds for every campaign of a command.

    window : the part of the logs that is used. trials : Monte Carlo trials at most; None for the
    default, 0 for none. command : kept in the file, as what was asked for.
    """

    progress: Progress = SILENT
    window: TimeWindow | None = None
    trials: int | None = None
    seed: int = 0
    command: str = ""


@dataclass(slots=True)
class LogPass:
    """What one reading of a campaign's logs leaves behind.

    inputs : files that were read. messages : warnings of the logs, in order, each once. stops :
    what became of most of them, where few are dwells. begin, end : s, the first and the last time
    in the logs, by their clock. repeats : samples that the logs hold twice.
    """

    campaign: Campaign
    settings: Settings
    inputs: list[InputFile] = field(default_factory=list)
    messages: dict[str, None] = field(default_factory=dict)
    begin: float = float("inf")
    end: float = float("-inf")
    stops: str = ""
    repeats: tuple[Repeat, ...] = ()

    @property
    def rig(self) -> Rig:
        """The rig of the campaign."""
        return self.campaign.rig.rig

    @property
    def progress(self) -> Progress:
        """Called as the work goes on."""
        return self.settings.progress

    def pieces(self) -> Iterator[Log]:
        """Read the logs once, piece by piece. Raises UsageError, DataError."""
        logs, rig = self.campaign.logs, self.rig
        with self.progress.reading(logs) as share:
            for piece in iter_log(
                logs,
                self.campaign.rig.log,
                rig.supports,
                axes=rig.axes,
                window=self.settings.window,
                progress=share,
            ):
                self.inputs += piece.inputs
                self.messages |= dict.fromkeys(piece.warnings)
                times = [series.time for series in piece.force if len(series.time)]
                self.begin = min([self.begin, *(float(time[0]) for time in times)])
                self.end = max([self.end, *(float(time[-1]) for time in times)])
                yield piece

    def dwells(self) -> Dwells:
        """Read the logs and find the static dwells."""
        self.progress.stage("reading the log and finding the dwells")
        return self.noted(find_dwells(self.watched()))

    def watched(self) -> Iterator[Log]:
        """Read the logs once, with an eye on samples that are there twice."""
        looking = RepeatedSamples(self.rig)
        for piece in self.pieces():
            looking.add(piece)
            yield piece
        self.repeats = looking.found()

    def noted(self, dwells: Dwells) -> Dwells:
        """Keep what the dwells say of the log; samples that are there twice count once."""
        dwells = counted_once(dwells, self.repeats)
        self.messages |= dict.fromkeys(dwells.warnings)
        self.stops = _lost_stops(dwells, self.rig)
        return dwells

    @contextmanager
    def explaining(self) -> Iterator[None]:
        """Let an error say what the log's messages told before it."""
        try:
            yield
        except (DataError, NotIdentifiableError, NotConvergedError) as error:
            messages = [self.stops] if self.stops else []
            messages += sorted(self.messages, key=lambda text: _CLOCK.search(text) is None)
            if not messages:
                raise
            rest = len(messages) - _REPEATED
            more = f"; and {rest} more" if rest > 0 else ""
            look = f"look first at the log: {'; '.join(messages[:_REPEATED])}{more}"
            advice = f"{look}. {error.hint[0].upper()}{error.hint[1:]}" if error.hint else look
            raise error.restated(hint=advice) from error


def _lost_stops(dwells: Dwells, rig: Rig) -> str:
    """Say so where far more stops are left out than found, and why."""
    lost = len(dwells.left_out)
    if lost <= _LOST * len(dwells):
        return ""
    reasons = Counter(re.split(r":| in ", piece.reason)[0] for piece in dwells.left_out)
    reason, _ = reasons.most_common(1)[0]
    said = f"{lost} of {lost + len(dwells)} stops were left out (mostly: {reason})"
    if dwells.force_range is not None:
        full = np.abs(dwells.force_range).max(axis=0) >= rig.capacity * (1 - _AT_CAPACITY)
        for i, j in np.argwhere(full & np.isfinite(rig.capacity) & rig.axes):
            return (
                f"{said}, and F{'xyz'[j]} of {rig.supports[i]} reaches its capacity of "
                f"{rig.capacity[i, j]:.6g} N; squeeze less, or widen the range of sensor and "
                "amplifier"
            )
    return f"{said}; hold postures for longer, and see that forces and positions share one clock"
