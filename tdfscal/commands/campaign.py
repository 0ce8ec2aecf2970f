"""From a command's PATH… to the rig, the logs, the tracker's survey; and when it was recorded."""

from __future__ import annotations

import os
import re
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from tdfscal.errors import DataError, RigError, UsageError, expect
from tdfscal.files import RIG_NAME
from tdfscal.files.outputs import CALIBRATION, RIG, own_kind, protect
from tdfscal.files.rig.reading import LoadedRig, load_rig
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.files.yaml import as_path, nearest
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.logs import is_log, looks_recorded
from tdfscal.logs.formats import NOWHERE, entries_of, owns, refuse_unfinished
from tdfscal.records import Measured, by_wall_clock

if TYPE_CHECKING:
    from tdfscal.commands.log_pass import LogPass

PathLike = str | os.PathLike[str]
PathLikes = PathLike | Sequence[PathLike]

FOLDER, LOG = "a folder", "a log"
_DOCUMENTS = (".yaml", ".yml", ".json")
_DAY = 86400.0
#: A date in a file's name.
_DATE = re.compile(r"(?<!\d)((?:19|20)\d\d)-?([01]\d)-?([0-3]\d)(?!\d)")
_WANTED = {RIG: "name the folder of the logs, or give it by --rig",
           CALIBRATION: "name a campaign folder, or its logs"}  # fmt: skip
_KINDS = (
    "logs are .csv, .tsv, .txt, .dat, .log (also .gz, .zst), .parquet, .mcap, .db3, .bag or "
    "rosbag2 folders"
)


def kind_of(path: Path) -> str:
    """Tell what a path leads to: FOLDER, what tdfscal wrote, LOG by its name, or nothing."""
    if path.is_dir():
        return LOG if is_log(path) else FOLDER
    return own_kind(path) or (LOG if is_log(path) else "")


def listed(paths: PathLikes) -> list[Path]:
    """Return one path, or several, as a list.

    Raises UsageError where there is none, one is named twice, or leads nowhere.
    """
    each = [paths] if isinstance(paths, str | bytes | os.PathLike) else paths
    expect("paths", each, Sequence, "a path, or a list of them")
    found = list(map(as_path, each))
    if not found:
        raise UsageError("no path is given", hint="name a campaign folder or its logs")
    counts = Counter(map(_real, found))
    for path in found:
        if not path.exists():
            home, near = path.absolute().parent, None
            if home.is_dir():
                near = nearest(path.name, [entry.name for entry in entries_of(home)])
            advice = f"the nearest name there is {near}" if near else "check the path"
            what = "there is no such file or folder"
            raise UsageError(what, where=str(path), hint=NOWHERE if path.is_symlink() else advice)
        if counts[_real(path)] > 1:
            raise UsageError("is named twice", where=str(path), hint="name each path once")
    return found


def one(path: PathLike | None) -> Path | None:
    """Return a path that may be missing."""
    return None if path is None else as_path(path)


@record
class Campaign:
    """What a command works on.

    logs : in natural order of their names, each once; empty where there is only a survey.
    """

    rig: LoadedRig
    logs: tuple[Path, ...]

    @property
    def lost_log(self) -> tuple[Finding, ...]:
        """Say so where the rig file describes a log and there is none."""
        if self.logs or not self.rig.log:
            return ()
        files = ", ".join(recorder.files for recorder in self.rig.log if recorder.files)
        return (Finding("log-missing", (str(self.rig.path),), values={"files": files}),)


def resolve(
    where: PathLikes, rig: PathLike | None = None, fallback: LoadedRig | None = None
) -> Campaign:
    """Find rig and logs for a command's paths: campaign folders, log files, recordings.

    where : the paths. rig : the file given with --rig, which goes before any rig.yaml. Else the
    rig.yaml of the folder, or beside the files; else the fallback, such as that of a calibration.

    Raises UsageError where a path is missing, no rig is found or two contradict, or there is
    neither a log nor a survey; RigError for a faulty rig file.
    """
    paths = listed(where)
    loaded = _rig_of(paths, fallback) if rig is None else rig_file(as_path(rig))
    surveys = loaded.surveys
    logs = find_logs(paths, apart=surveys, recorders=loaded.log)
    if not logs:
        # A folder that holds nothing of the rig has no part in its survey.
        homes = {home for file in (*surveys, loaded.path) for home in _real(file).parents}
        surveyed = bool(surveys) and all(path.is_file() for path in surveys)
        if not (surveyed and homes.intersection(map(_real, paths))):
            raise no_log(paths, "there is no log here, nor a tracker's survey")
    return Campaign(loaded, logs)


def no_log(where: PathLikes, what: str = "there is no log here") -> UsageError:
    """Return the error of paths that hold no log."""
    return UsageError(
        what,
        where=", ".join(map(str, listed(where))),
        hint="name a folder with .csv, .parquet or .mcap logs, or the logs themselves",
    )


def find_logs(
    where: PathLikes, apart: Iterable[Path] = (), recorders: Sequence[LogBlock] = ()
) -> tuple[Path, ...]:
    """Return the logs that the paths name or hold, each once; `apart` are files that are no logs.

    recorders : whose files are logs, where their blocks say; others in a folder are left alone.

    Raises UsageError where a path is missing, a file is no log, or a subfolder holds recordings
    without the metadata that lists them, or may not be looked into.
    """
    paths, known = listed(where), {_real(path) for path in apart}
    patterns = [one for one in recorders if one.files is not None]
    found, others = dict[Path, Path](), list[Path]()
    for path in paths:
        if not _is_folder(path):
            _require_log(path)
            found.setdefault(_real(path), path)
            continue
        for entry in entries_of(path):
            own = not patterns or any(owns(one, entry) for one in patterns)
            if entry.name.startswith(".") or not own:
                continue
            if _is_recorded(entry) and _real(entry) not in known:
                found.setdefault(_real(entry), entry)
            elif entry.is_dir() and not (entry / RIG_NAME).is_file():
                others.append(entry)  # no campaign of its own: an unfinished recording?
    for folder in others:
        refuse_unfinished(folder, found.keys())
    logs = tuple(found.values())
    protect(paths)
    protect((path if _is_folder(path) else path.parent) / RIG_NAME for path in (*paths, *logs))
    protect(file for path in logs for file in (path, *path.rglob("*")))
    return logs


def _require_log(path: Path) -> None:
    """Raise UsageError for what is no log by its name."""
    if (kind := kind_of(path)) != LOG:
        what = f"is {kind}, not a log" if kind else "is not a log"
        raise UsageError(what, where=str(path), hint=_WANTED.get(kind, _KINDS))


def _real(path: Path) -> Path:
    """Where a path leads; unlike `Path.resolve` it takes a link that leads to itself."""
    return Path(os.path.realpath(path))


def _is_folder(path: Path) -> bool:
    """It is a folder, and no recording that is one."""
    return path.is_dir() and not is_log(path)


def _is_recorded(entry: Path) -> bool:
    """Whether what a folder holds is a log by its name and content."""
    return entry.stem != "calibration" and looks_recorded(entry) and kind_of(entry) == LOG


def _rig_of(paths: Sequence[Path], fallback: LoadedRig | None) -> LoadedRig:
    """The rig of the folders, or beside the files."""
    homes = [path if _is_folder(path) else path.absolute().parent for path in paths]
    beside = {_real(home / RIG_NAME): home / RIG_NAME for home in homes}
    rigs = [rig_file(path) for path in beside.values() if path.is_file()]
    first = rigs[0] if rigs else fallback
    if first is None:
        for path in filter(Path.is_file, paths):
            _require_log(path)
            if not looks_recorded(path):
                raise DataError("it holds no table of numbers", where=str(path), hint=_KINDS)
        near = nearest(RIG_NAME, [p.name for p in entries_of(homes[0]) if kind_of(p) == RIG])
        hint = "name it with --rig, or draft it: `tdfscal init LOG`"
        if near:
            hint = f"rename {near} to {RIG_NAME} or name it with --rig"
        raise UsageError(f"there is no {RIG_NAME}", where=str(homes[0]), hint=hint)
    for other in rigs[1:]:
        if other.sha256 != first.sha256:
            raise UsageError(
                f"the paths belong to different rigs, {first.path} and {other.path}",
                hint="take one campaign at a time, or say which rig holds with --rig",
            )
    return first


def campaign_folders(where: PathLikes, rig: PathLike | None = None) -> list[list[Path]]:
    """Group a command's paths by campaign: folders with a rig.yaml are a campaign each.

    So is a folder beside them that lacks its own, which is then found unusable. A folder without a
    rig.yaml stands for its subfolders where one of them holds one. Everything where --rig names
    the rig, and logs beside one campaign at most, are one campaign.
    """
    paths = listed(where)
    inside = {path: [] if rig is not None else _campaigns_in(path) for path in paths}
    loose = any(not held and not _is_folder(path) for path, held in inside.items())
    if sum(map(len, inside.values())) < (2 if loose else 1):
        return [paths]
    return [[folder] for path, held in inside.items() for folder in held or [path]]


def _campaigns_in(path: Path) -> list[Path]:
    """A campaign folder itself, or those inside of one that holds such, also without their rig."""
    if not _is_folder(path):
        return []
    if (path / RIG_NAME).is_file():
        return [path]
    folders = [entry for entry in entries_of(path) if _is_folder(entry)]
    if not any((folder / RIG_NAME).is_file() for folder in folders):
        return []
    return [f for f in folders if (f / RIG_NAME).is_file() or any(map(_is_recorded, entries_of(f)))]


def rig_file(path: PathLike) -> LoadedRig:
    """Load a rig file, or the rig.yaml of a campaign folder. Raises UsageError, RigError."""
    file = as_path(path)
    kind = kind_of(file) if file.is_file() else ""
    if kind not in ("", RIG) and file.suffix.lower() not in _DOCUMENTS:
        raise UsageError(f"is {kind}, not a rig file", where=str(file), hint="name a rig.yaml")
    loaded = load_rig(file / RIG_NAME if file.is_dir() else file)
    protect((loaded.path, *loaded.surveys))
    return loaded


def measured(log: LogPass) -> Measured:
    """Tell when a campaign was recorded: by the log's clock, the rig file, or the file's date.

    Raises DataError, RigError where the log's clock, or the rig file's date, lies in the future.
    """
    if by_wall_clock(log.begin, log.end):
        found = Measured(log.begin, log.end, "log")
        if found.end > time.time() + _DAY:
            raise DataError(
                f"the log's clock says {day(found.end)}, which is in the future",
                where=", ".join(map(str, log.campaign.logs)),
                hint="set the recorder's clock; or let its time count from 0, and state "
                "campaign.date in rig.yaml",
            )
        return found
    for clock in log.clocks:  # where the first recorder's is none
        begin, end = log.begin + clock.offset, log.end + clock.offset
        if by_wall_clock(begin, end) and end < time.time() + _DAY:
            return Measured(begin, end, "log")
    rig, date = log.campaign.rig, log.rig.campaign.date
    if date is not None:
        found = stated_date(date)
        if found.begin > time.time() + _DAY:
            raise RigError(
                f"the campaign's date, {date}, is in the future",
                where=f"{rig.path}: campaign.date",
                hint="write the day on which the log was recorded",
            )
        return found
    surveyed = () if log.ends else rig.surveys[1::2]
    times = [path.stat().st_mtime for path in surveyed or log.campaign.logs]
    seconds = log.end - log.begin if log.begin < log.end else 0.0  # a file's date is of its end
    return Measured(min(*times, max(times) - seconds), max(times), "file")


def misdated(log: LogPass) -> list[Finding]:
    """Say so where rig file and log's clock, or a file's name and its date, are of other days."""
    date, found = log.rig.campaign.date, measured(log)
    if found.source == "file":
        names = [path.name for path in log.campaign.logs]
        named = set(_DATE.findall(" ".join(names)))
        dated = "-".join(named.pop()) if len(named) == 1 else ""
        with suppress(ValueError):  # no day of any calendar
            if abs(stated_date(dated).begin + _DAY / 2 - found.end) > 1.5 * _DAY:
                values: dict[str, Value] = {"date": dated, "clock": day(found.end)}
                return [Finding("file-misdated", tuple(names), values=values)]
    if date is None or found.source != "log":
        return []
    stated = stated_date(date)
    if max(stated.begin - found.end, found.begin - stated.end) <= _DAY:
        return []
    values = {"date": date, "clock": day(found.begin)}
    return [Finding("campaign-misdated", (str(log.campaign.rig.path),), values=values)]


def stated_date(date: str) -> Measured:
    """Tell when a campaign was recorded by the date in its rig file."""
    begin = datetime.fromisoformat(date)
    begin = begin if begin.tzinfo else begin.replace(tzinfo=UTC)
    end = begin + timedelta(days=1, seconds=-1) if len(date) == len("2026-01-01") else begin
    return Measured(begin.timestamp(), end.timestamp(), "rig")


def day(moment: float) -> str:
    """Return the date of a moment in s since 1970."""
    return f"{datetime.fromtimestamp(moment, UTC):%Y-%m-%d}"
