"""Campaigns as they are read: what was surveyed, several of one rig.

And the same recording in two of them: told by its files, its hours or its mean readings.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.catalogue import rigs_apart, sentence
from tdfscal.checks.shared_data import Readings, Recorded, readings, repeated
from tdfscal.commands.campaign import PathLike, measured, misdated, resolve
from tdfscal.commands.log_pass import LogPass, Settings
from tdfscal.errors import DataError, OutputError, TdfscalError, UsageError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.motioncal.streams import Slow
from tdfscal.records import Dwells, Measured, Rig

if TYPE_CHECKING:
    from tdfscal.trackercal.pipeline import TrackerCalibration


def surveyed(
    log: LogPass, trials: int | None, rng: np.random.Generator
) -> tuple[TrackerCalibration, tuple[Finding, ...]]:
    """Calibrate from a campaign's survey; also return what is found of its files.

    Raises UsageError where the rig file declares none, DataError where its files are unusable.
    """
    from tdfscal.files.points.reading import read_tracker_session
    from tdfscal.files.saving import fingerprint
    from tdfscal.trackercal.pipeline import calibrate_tracker

    rig = log.campaign.rig
    if rig.tracker is None:
        raise UsageError(
            "the rig file declares no tracker survey",
            where=str(rig.path),
            hint="add its tracker block, or use --method self",
        )
    missing = next((path for path in rig.surveys if not path.is_file()), None)
    if missing is not None:
        raise DataError(
            "the point file is not there",
            where=str(missing),
            hint="correct the paths of the tracker block in rig.yaml",
        )
    session, found = read_tracker_session(rig.tracker, rig.surveys)
    options = {} if trials is None else {"trials": trials}
    result = calibrate_tracker(
        log.rig, session, misalignment=rig.tracker.misalignment, rng=rng, **options
    )
    for path in rig.surveys:
        with fingerprint(path) as described:
            log.inputs.append(described("unverified"))
    return result, found


@record
class Recording:
    """What tells one recording from another.

    files : but for what was wanted: nominal points and servo positions. means : of its readings;
    None where not at hand.
    """

    name: str
    files: Sequence[Recorded]
    measured: Measured
    means: Readings | None


@record
class Read(Recording):
    """A campaign that was read: its dwells and slow streams, or its tracker's survey."""

    log: LogPass
    dwells: Dwells | None = None
    slow: Slow | None = None
    survey: TrackerCalibration | None = None

    @property
    def rig(self) -> Rig:
        """What its rig file states."""
        return self.log.rig

    @property
    def span(self) -> tuple[float, float] | None:
        """Part of its log that was read, s; None without one."""
        return None if self.dwells is None else (self.log.begin, self.log.end)


class Unusable(dict[str, TdfscalError]):
    """Campaigns that cannot be used, by name, each with what is wrong with it."""

    @contextmanager
    def noting(self, name: str) -> Iterator[None]:
        """Take down what the data or the files of a campaign do not give, with its name."""
        try:
            yield
        except OutputError:
            raise
        except TdfscalError as error:
            where = error.where or ""
            where = where if where.startswith(name) else f"{name}: {where}".rstrip(": ")
            self[name] = error.restated(where=where)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Name them, each with why; the result wants them."""
        return tuple(
            Finding(
                "campaign-unusable",
                (name,),
                values={"why": error.what, "hint": error.hint or "compare it with the others"},
                rejects=True,
            )
            for name, error in self.items()
        )


def read_campaigns(
    groups: Sequence[Sequence[Path]],
    settings: Settings,
    rig: PathLike | None = None,
    like: tuple[str, Rig] | None = None,
) -> tuple[list[Read], Unusable]:
    """Read campaigns of one rig, each by its log, or its survey where it has none.

    like : name and rig whose constants they must state; of the first, if none is given. Returned
    in the order of time, and those that cannot be read by name.

    Raises UsageError where they are of different rigs.
    """
    logs, unusable, reads = dict[str, LogPass](), Unusable(), list[Read]()
    for group in groups:
        with unusable.noting(name := str(group[0])):
            logs[name] = LogPass(resolve(group, rig), settings)
    for name, log in logs.items():
        like = like or (name, log.rig)
        log.messages += require_one_rig(like, (name, log.rig))
    for name, log in logs.items():
        with unusable.noting(name):
            reads.append(_read(name, log))
    return sorted(reads, key=lambda read: read.measured.month), unusable


def _read(name: str, log: LogPass) -> Read:
    means, found = None, dict[str, Any]()
    if log.campaign.logs:
        with log.explaining():
            found["dwells"], found["slow"] = log.samples()
        log.messages += misdated(log)
        means = readings(log.rig, found["dwells"])
    else:
        log.messages += log.campaign.lost_log
        found["survey"], _ = surveyed(log, 0, np.random.default_rng(0))
    wanted = set(map(str, log.campaign.rig.surveys[::2]))
    span = (log.begin, log.end) if log.campaign.logs else None
    files = [Recorded(f.path, f.sha256, span) for f in log.inputs if f.path not in wanted]
    return Read(name, files, measured(log), means, log, **found)


def require_one_rig(first: tuple[str, Rig], other: tuple[str, Rig]) -> tuple[Finding, ...]:
    """Return what leaves open whether two rigs, each with what it goes by, are one.

    Raises UsageError where they state other constants.
    """
    from tdfscal.checks.calibrated_rig import different_constants, other_papers

    if found := different_constants(first[1], other[1]):
        raise UsageError(rigs_apart(found, "rigs-differ", first=first[0]), where=other[0])
    return other_papers(first, other)


def left_out(reasons: Collection[Finding], postures: int) -> list[Finding]:
    """Say how many of the postures had to be left out, if any, and why most of them."""
    if not reasons:
        return []
    (reason, _), *_ = Counter(map(sentence, reasons)).most_common(1)
    values: dict[str, Value] = {"postures": postures, "reason": reason}
    return [Finding("postures-left-out", size=len(reasons), values=values)]


def refuse_repeated(recordings: Sequence[Recording]) -> None:
    """Raise UsageError where two campaigns hold the same recording, or the same part of one."""
    for first, second in combinations(recordings, 2):
        what = next((file.path for file in second.files if file.meets_any(first.files)), None)
        a, b = first.measured, second.measured
        together = min(a.end, b.end) - max(a.begin, b.begin)
        shorter = min(a.end - a.begin, b.end - b.begin)
        # Clocks may be set apart by less.
        by_clock = a.source == b.source == "log" and together > max(0.5 * shorter, 0.0)
        if what is None and by_clock:
            what = "their clocks say so, for no rig is recorded twice at a time"
        if what is None and first.means is not None and second.means is not None:
            few, many = sorted((first.means, second.means), key=lambda means: len(means.force))
            of_one_rig = len(few.force) > 0 and few.force.shape[1:] == many.force.shape[1:]
            if of_one_rig and 2 * repeated(many, few).sum() >= len(few.force):
                what = "their mean forces agree far below their uncertainty"
        if what is not None:
            raise UsageError(
                f"holds the same recording as {first.name}: {what}",
                where=second.name,
                hint="name each recording once; twice the same data are no more data",
            )
