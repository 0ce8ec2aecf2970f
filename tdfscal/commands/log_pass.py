"""A campaign's log as it passes: its samples at rest and in motion, and what it says of itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import chain, combinations
from typing import TypeVar

import numpy as np

from tdfscal.catalogue import cure, sentence, told
from tdfscal.catalogue.inputs import STOPS
from tdfscal.checks.shared_data import readings, repeated
from tdfscal.commands.campaign import Campaign
from tdfscal.commands.options import Progress, silent
from tdfscal.dwells import find_dwells
from tdfscal.dwells.clock_offset import forces_behind
from tdfscal.dwells.dwell_means import Thermometer
from tdfscal.errors import (
    DataError,
    NotConvergedError,
    NotIdentifiableError,
    TdfscalError,
    UsageError,
)
from tdfscal.files.calibration.evidence import has_delay
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.logs import TimeWindow, iter_log
from tdfscal.model.dynamics import DELAY, RATE, Moving
from tdfscal.motioncal.streams import Decimator, Slow
from tdfscal.records import Dwells, FloatArray, InputFile, Log, RecorderClock, Rig, UncertainValue

Found = TypeVar("Found")

#: Warnings of a log that an error repeats at most.
_REPEATED = 3
#: Stops left out per dwell found, from which an error says so.
_LOST = 2
#: A reading this close to its capacity, relative, stands at it.
_AT_CAPACITY = 1e-6


@record
class Settings:
    """What holds for every campaign of a command.

    window : the part of the logs that is used. trials : Monte Carlo trials at most; None for the
    default, 0 for none. command : kept in the file, as what was asked for.
    """

    progress: Progress = silent
    window: TimeWindow | None = None
    trials: int | None = None
    command: str = ""

    def __post_init__(self) -> None:
        if self.trials == 1:
            raise UsageError(
                "one trial has no spread", where="--trials", hint="give 0, or 2 or more"
            )


@dataclass(slots=True)
class LogPass:
    """What one reading of a campaign's logs leaves behind.

    inputs : files that were read; ends : s, the log's last time up to each. messages : what the
    logs say of themselves, each once. stops : what became of most of them, where few are dwells.
    begin, end : s, from when to when all signals were recorded, by the first recorder's clock.
    clocks : of the other recorders.
    """

    campaign: Campaign
    settings: Settings
    inputs: list[InputFile] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    messages: list[Finding] = field(default_factory=list)
    begin: float = float("inf")
    end: float = float("-inf")
    stops: Finding | None = None
    clocks: tuple[RecorderClock, ...] = ()

    @property
    def rig(self) -> Rig:
        """What the rig file states."""
        return self.campaign.rig.rig

    @property
    def progress(self) -> Progress:
        """Whom to tell of the work."""
        return self.settings.progress

    def pieces(self) -> Iterator[Log]:
        """Read the logs once, piece by piece. Raises UsageError, DataError."""
        logs, rig = self.campaign.logs, self.rig
        first, last = dict[int, float](), dict[int, float]()
        mapping, window = self.campaign.rig.log, self.settings.window
        for piece in iter_log(logs, mapping, rig.supports, axes=rig.axes, window=window):
            self.inputs += piece.inputs
            self.clocks += piece.clocks
            self._note(piece.findings)
            for number, series in enumerate((*piece.position, *piece.force)):
                if len(series.time):
                    first.setdefault(number, float(series.time[0]))
                    last[number] = float(series.time[-1])
            self.begin = max(first.values(), default=self.begin)
            self.end = min(last.values(), default=self.end)
            self.ends += [max(last.values(), default=self.end)] * len(piece.inputs)
            yield piece

    def samples(self, asked: str | None = None) -> tuple[Dwells, Slow | None]:
        """Read the logs once, for dwells and slow streams; for these alone if `static` is asked.

        The streams are None where there are none.

        Raises DataError where one file holds the recording of another, by another clock.
        """
        if asked == "static":
            self.progress("reading the log and finding the dwells")
            return self._noted(find_dwells(self.pieces())), None
        pieces, slow = self._streams()
        dwells = self._noted(find_dwells(pieces))
        with suppress(DataError):
            return dwells, slow()
        return dwells, None

    def moving(self) -> Slow:
        """Read the logs once, for the slow streams alone.

        Raises DataError where there are none, or their forces are seconds behind the positions.
        """
        pieces, streams = self._streams()
        for _ in pieces:
            pass
        slow = streams()
        if late := forces_behind(slow.time, slow.position, slow.force):
            raise DataError(late)
        return slow

    def _streams(self) -> tuple[Iterator[Log], Callable[[], Slow]]:
        """The pieces of the logs, and once these have passed, their slow streams."""
        self.progress("reading the log")
        # An axis that is not measured has no full scale.
        decimator = Decimator(np.where(self.rig.axes, self.rig.capacity, np.inf))
        thermometer, averaged = Thermometer(), self.campaign.rig.averaged

        def pieces() -> Iterator[Log]:
            for piece in thermometer.passing(self.pieces()):
                if not averaged:
                    decimator.add(piece)
                yield piece

        def slow() -> Slow:
            if averaged:
                raise DataError(
                    "the log holds averaged postures and no motion",
                    where="log",
                    hint="use --samples static, or give the recording itself",
                )
            found = decimator.finish()
            warm = thermometer.at(found.time, found.time, len(found.supports))
            return replace(found, temperature=warm)

        return pieces(), slow

    def _noted(self, dwells: Dwells) -> Dwells:
        """Keep what the dwells say of the log; refuse the same recording in two files."""
        self._note(dwells.findings)
        self.stops = _lost_stops(dwells, self.rig)
        if len(self.inputs) < 2 or not dwells.force_cov.any():
            return dwells
        whole, file = readings(self.rig, dwells), np.searchsorted(self.ends[:-1], dwells.start)
        parts = [
            (entry.path, replace(whole, force=whole.force[file == k]))
            for k, entry in enumerate(self.inputs)
        ]
        for (name, first), (other, second) in combinations(parts, 2):
            if 0 < len(second.force) <= 2 * repeated(first, second).sum():
                raise DataError(
                    f"holds the recording of {name} again, by another clock: the mean forces "
                    "agree far below their uncertainty",
                    where=str(other),
                    hint="keep one of the two in the folder; twice the same data are no more data",
                )
        return dwells

    def files_at(self, times: FloatArray) -> list[InputFile]:
        """Return the files (T,) that hold these times, s of the log's clock."""
        return [self.inputs[k] for k in np.searchsorted(self.ends[:-1], times)]

    def _note(self, findings: Iterable[Finding]) -> None:
        self.messages += [finding for finding in findings if finding not in self.messages]

    @contextmanager
    def explaining(self) -> Iterator[None]:
        """Let an error say what the log's messages told before it."""
        try:
            yield
        except (DataError, NotIdentifiableError, NotConvergedError) as error:
            found = [*([self.stops] if self.stops else []), *self.messages]
            what = "; ".join([error.what, *map(sentence, error.findings)])
            written = self.campaign.rig.written(error.finding)
            advice = cure(written) if "lines" in written.values else error.hint
            if found:
                look = f"look first at the log: {'; '.join(map(told, found[:_REPEATED]))}"
                advice = f"{look}. {advice[0].upper()}{advice[1:]}" if advice else look
            raise error.restated(what=what, hint=advice) from error


def _lost_stops(dwells: Dwells, rig: Rig) -> Finding | None:
    """Say so where far more stops are left out than found, and why."""
    lost = len(dwells.left_out)
    if lost <= _LOST * len(dwells):
        return None
    reasons = Counter(piece.reason.code for piece in dwells.left_out)
    values: dict[str, Value] = {
        "stops": lost + len(dwells),
        "reason": STOPS[reasons.most_common(1)[0][0]],
    }
    if dwells.force_range is not None:
        full = np.abs(dwells.force_range).max(axis=0) >= rig.capacity * (1 - _AT_CAPACITY)
        for i, j in np.argwhere(full & np.isfinite(rig.capacity) & rig.axes):
            values |= {"axis": "xyz"[j], "capacity": float(rig.capacity[i, j])}
            return Finding("stops-over-capacity", (rig.supports[i],), lost, values=values)
    return Finding("stops-left-out", size=lost, values=values)


def where_few(
    dwells: Dwells,
    enough: int,
    moving: Callable[[], Found],
    final: type[TdfscalError] | tuple[()] = (),
) -> Found | None:
    """What the motion gives where the dwells are too few; None where these must do.

    final : faults of a motion that few dwells cannot mend. Raises TdfscalError by cause.
    """
    if len(dwells) >= enough:
        return None
    try:
        return moving()
    except TdfscalError as error:
        few = "there is no dwell"
        if len(dwells):
            if not isinstance(error, final):
                return None
            few = f"{len(dwells)} static dwells are too few: {enough} are the least"
        raise error.restated(what=f"{error.what} ({few}, so the motion was used)") from error


def drafted(rigs: Iterable[LoadedRig]) -> list[Finding]:
    """Find what rig files still mark to be confirmed, each line once, and whose names cross."""
    each = [(rig.unconfirmed, rig.crossed) for rig in rigs]
    lines, across = (tuple(dict.fromkeys(chain(*found))) for found in zip(*each, strict=True))
    found = [Finding("draft-unconfirmed", lines, len(lines))] if lines else []
    return [*found, Finding("fields-crossed", across)] if across else found


def delay_of(rig: LoadedRig) -> UncertainValue:
    """Delay of the force stamps, s, as a rig file states it; unknown where it does not."""
    if len(rig.log) > 1:  # their clocks are apart by as much as the moves leave open
        rate_std = max(recorder.clock.rate_std for recorder in rig.log[1:])
        return UncertainValue(np.zeros(2), np.array([np.inf, rate_std]))
    if rig.log and rig.log[0].delay is not None:
        return rig.log[0].delay.record()
    return UncertainValue(np.array(0.0), np.array(np.inf))


def with_delay(
    log: LogPass, moving: Moving, std: FloatArray, middle: float
) -> tuple[RecorderClock, ...]:
    """The second recorder's clock with the delay and rate that a motion shows, at its middle, s.

    std : standard uncertainties of what it shows. Of more than two recorders nothing says whose
    delay it is.
    """
    if not has_delay(log.clocks):
        return log.clocks
    clock = log.clocks[0]
    late = any(
        what == "force" for _, what in log.campaign.rig.log[1].fields
    )  # the forces are the second recorder's
    delay, rate = (moving.delay, moving.rate) if late else (-moving.delay, -moving.rate)
    since = middle - clock.reference
    offset_std = float(np.hypot(std[DELAY], since * std[RATE]))
    offset = clock.offset + delay - since * rate
    return (replace(clock, offset=offset, offset_std=offset_std, rate=clock.rate + rate,
                    rate_std=float(std[RATE])),)  # fmt: skip
