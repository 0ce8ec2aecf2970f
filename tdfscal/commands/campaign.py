"""From a command's PATH… to the rig, the logs and the tracker's survey, and to all it reads."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from tdfscal.commands.arguments import PathLike, PathLikes, listed, one
from tdfscal.errors import TdfscalError, UsageError
from tdfscal.files import RIG_NAME, WRENCH_WRITER
from tdfscal.files.model_errors import nearest
from tdfscal.files.outputs import protect
from tdfscal.files.rig.reading import LoadedRig, load_rig
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.logs import is_log, looks_recorded
from tdfscal.logs.formats import NOWHERE, check_regular, check_text, owns
from tdfscal.logs.rosbag2 import entries_of, read_bag, refuse_unfinished
from tdfscal.records import LogMapping

#: How the first line of each table begins: plan and studies, contact wrenches, exported rotations.
_FIRST_LINES = (
    b"# tdfscal ",
    b"time,fx,fy,fz,mx,my,mz,u_fx,",
    b"sensor,r_xx,r_xy,r_xz,",
)
#: What else they say near their begin: exports, pages, documents, drafts.
_SAID = re.compile(
    rb"""\btdfscal[ ]\d[^\s,]*,[ ]method[ ]
    | <meta[ ]name="generator"[ ]content="tdfscal[ ]
    | ^[ ]*"?format"?:[ ]*"?tdfscal-
    | ^\#[ ]Drafted[ ]by[ ]`tdfscal[ ]""",
    re.VERBOSE | re.MULTILINE,
)
_HEAD = 1 << 14
#: What the metadata of a Parquet file of contact wrenches say, at the end of the file.
_QUANTITY = b"contact wrench on the terminal: force, and moment"
_TAIL = 1 << 16


@record
class Campaign:
    """What a command works on.

    logs : in natural order of their names, each once; empty where there is only a survey.
    surveyed : the rig declares a tracker's survey and its four point files are there.
    """

    rig: LoadedRig
    logs: tuple[Path, ...]
    surveyed: bool

    @property
    def averaged(self) -> bool:
        """Each row of a log is a posture."""
        return self.rig.averaged

    @property
    def lost_log(self) -> tuple[Finding, ...]:
        """Say so where the rig file describes a log and there is none."""
        if self.logs or not self.rig.log:
            return ()
        files = [recorder.files for recorder in self.rig.log if recorder.files]
        values: dict[str, Value] = {"files": ", ".join(files)}
        return (Finding("log-missing", (str(self.rig.path),), values=values),)


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
    _require(paths)
    loaded = _rig_of(paths, one(rig), fallback)
    surveyed = loaded.tracker is not None and all(p.is_file() for p in loaded.tracker.paths)
    surveys = loaded.tracker.paths if loaded.tracker else ()
    logs = find_logs(paths, apart=surveys, recorders=loaded.log)
    # A folder that holds nothing of the rig has no part in its survey.
    homes = {home for file in (*surveys, loaded.path) for home in _real(file).parents}
    if not logs and not (surveyed and homes.intersection(map(_real, paths))):
        raise UsageError(
            "there is no log here, nor a tracker's survey",
            where=", ".join(map(str, paths)),
            hint="name a folder with .csv, .parquet or .mcap logs, or the logs themselves",
        )
    return Campaign(loaded, logs, surveyed)


def find_logs(
    where: PathLikes, apart: Iterable[Path] = (), recorders: Sequence[LogMapping] = ()
) -> tuple[Path, ...]:
    """Return the logs that the paths name or hold, each once; `apart` are files that are no logs.

    recorders : whose files are logs, where their blocks say; others in a folder are left alone.

    Raises UsageError where a path is missing, a file is no log or no regular file, or a subfolder
    holds recordings without the metadata that lists them, or may not be looked into.
    """
    paths = listed(where)
    _require(paths)
    known = {_real(path) for path in apart}
    found: dict[Path, Path] = {}
    others: list[Path] = []
    for path in paths:
        if path.is_dir() and not is_log(path):
            patterns = [one for one in recorders if one.files is not None]
            for entry in sorted(entries_of(path), key=_natural):
                own = not patterns or any(owns(one, entry) for one in patterns)
                if entry.name.startswith(".") or not own:
                    continue
                if _is_recorded(entry) and _real(entry) not in known:
                    found.setdefault(_real(entry), entry)
                elif entry.is_dir() and not (entry / RIG_NAME).is_file():
                    others.append(entry)  # no campaign of its own: an unfinished recording?
        else:
            _refuse_other(path)
            found.setdefault(_real(path), path)
    for folder in others:
        refuse_unfinished(folder, found.keys())
    for path in found.values():
        if not path.is_dir():
            check_regular(path)
    return tuple(found.values())


def _refuse_other(path: Path) -> None:
    """Raise UsageError for what is no log by its name."""
    if not is_log(path):
        kinds = (
            "logs are .csv, .tsv, .txt, .dat, .log (also .gz, .zst), .parquet, .mcap, .db3, "
            ".bag or rosbag2 folders"
        )
        hint = "name the folder that holds it" if path.name == RIG_NAME else kinds
        raise UsageError("is not a log", where=str(path), hint=hint)


def _refuse_unrecorded(path: Path) -> None:
    """Raise UsageError, DataError for a file that is no log by its name or its first lines."""
    _refuse_other(path)
    check_text(path)
    if not looks_recorded(path):
        raise UsageError(
            "is not a log: no row of numbers stands near its begin",
            where=str(path),
            hint="look at it with `tdfscal info`",
        )


def _real(path: Path) -> Path:
    """Where a path leads; unlike `Path.resolve` it takes a link that leads to itself."""
    return Path(os.path.realpath(path))


def _is_recorded(entry: Path) -> bool:
    if entry.stem == "calibration" or not looks_recorded(entry):
        return False
    return _may_be_read(entry)


def _may_be_read(entry: Path) -> bool:
    """Whether what a folder holds is a log by its name, and no result of tdfscal."""
    # A pipe is not opened here: that might never end.
    return is_log(entry) and not (entry.is_file() and is_own_result(entry))


def _rig_of(paths: Sequence[Path], given: Path | None, fallback: LoadedRig | None) -> LoadedRig:
    if given is not None:
        return _load(given)
    beside = {_real(home / RIG_NAME): home / RIG_NAME for home in map(_home, paths)}
    rigs = [_load(path) for path in beside.values() if path.is_file()]
    if not rigs and fallback is not None:
        return fallback
    if not rigs:
        for path in paths:
            if path.is_file() and not _says(path, b"tdfscal-rig/"):
                _refuse_unrecorded(path)
        home = _home(paths[0])
        near = nearest(RIG_NAME, [n for n in _names(home) if _says(home / n, b"tdfscal-rig/")])
        rename = f"rename {near} to {RIG_NAME} or name it with --rig"
        raise UsageError(
            f"there is no {RIG_NAME}",
            where=str(home),
            hint=rename if near else "name the rig file with --rig",
        )
    other = next((rig for rig in rigs if rig.sha256 != rigs[0].sha256), None)
    if other is not None:
        raise UsageError(
            f"the paths belong to different rigs, {rigs[0].path} and {other.path}",
            hint="take one campaign at a time, or say which rig holds with --rig",
        )
    return rigs[0]


def _home(path: Path) -> Path:
    """Folder whose rig.yaml goes with a path."""
    return path if path.is_dir() and not is_log(path) else path.absolute().parent


def _says(path: Path, word: bytes) -> bool:
    """Tell whether a file has a word near its begin; a pipe is not opened."""
    try:
        with path.open("rb") if path.is_file() else contextlib.nullcontext() as file:
            return file is not None and word in file.read(1024)
    except OSError:
        return False


def _require(paths: Sequence[Path]) -> None:
    if not paths:
        raise UsageError("no path is given", hint="name a campaign folder or its logs")
    for path in paths:
        if not os.path.lexists(path) or not path.exists():
            near = nearest(path.name, _names(path.absolute().parent))
            advice = f"the nearest name there is {near}" if near else "check the path"
            raise UsageError(
                "there is no such file or folder",
                where=str(path),
                hint=NOWHERE if path.is_symlink() else advice,
            )


def _names(folder: Path) -> list[str]:
    try:
        return sorted(entry.name for entry in folder.iterdir())
    except OSError:
        return []


def _natural(path: Path) -> list[tuple[int, int, str]]:
    """Sort key that puts rosbag_2 before rosbag_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(1, int(part), "") if part.isdecimal() else (0, 0, part) for part in parts]


def campaign_folders(where: PathLikes, rig: PathLike | None = None) -> list[list[Path]]:
    """Group a command's paths by campaign: folders with a rig.yaml are a campaign each.

    So is a folder beside them that lacks its own, which is then found unusable. A folder without a
    rig.yaml stands for its subfolders where one of them holds one. Everything where --rig names
    the rig, and logs beside one campaign at most, are one campaign.
    """
    paths = listed(where)
    inside = {path: [] if rig is not None else _campaigns_in(path) for path in paths}
    found = sum(inside.values(), list[Path]())
    loose = any(not path.is_dir() or is_log(path) for path in paths if not inside[path])
    if len(found) < (2 if loose else 1):
        return [paths]
    return [[folder] for path in paths for folder in inside[path] or [path]]


def _campaigns_in(path: Path) -> list[Path]:
    """A campaign folder itself, or those inside of one that holds such, also without their rig."""
    if not path.is_dir() or is_log(path):
        return []
    if (path / RIG_NAME).is_file():
        return [path]
    folders = [entry for entry in sorted(entries_of(path)) if entry.is_dir() and not is_log(entry)]
    if not any((folder / RIG_NAME).is_file() for folder in folders):
        return []
    return [f for f in folders if (f / RIG_NAME).is_file() or any(map(_is_recorded, entries_of(f)))]


def rig_named(path: PathLike) -> LoadedRig:
    """Load a rig file, or the rig.yaml of a campaign folder. Raises UsageError, RigError."""
    file = Path(path)
    if file.is_dir():
        file = file / RIG_NAME
    if not file.is_file():
        raise UsageError(
            "there is no such rig file", where=str(file), hint="name a rig.yaml or its folder"
        )
    return _load(file)


def _load(path: Path) -> LoadedRig:
    """Load a rig file; no output replaces a point file that it names."""
    loaded = load_rig(path)
    protect(loaded.tracker.paths if loaded.tracker else ())
    return loaded


def is_own_result(path: Path) -> bool:
    """Tell whether a file is a result of tdfscal and no recording."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
            if head.replace(b'"', b"").startswith(_FIRST_LINES) or _SAID.search(head):
                return True
            if path.suffix.lower() == ".mcap":
                return WRENCH_WRITER.encode() in head[:256]  # who wrote it
            if path.suffix.lower() != ".parquet":
                return False
            size = file.seek(0, 2)
            file.seek(max(0, size - _TAIL))
            return _QUANTITY in file.read(_TAIL)
    except OSError:
        return False


def is_other_result(path: Path) -> bool:
    """Tell whether a file is a result of tdfscal, and no calibration."""
    return path.is_file() and is_own_result(path) and not _says(path, b"tdfscal-calibration")


def inputs_read(paths: Iterable[Path], rig: Path | None = None) -> list[Path]:
    """Return the files behind a command's arguments, in whatever state they are.

    What tdfscal itself wrote into a folder is not read there, and a run made again replaces it.

    paths : campaign folders, logs, recordings, each with its rig; other files. rig : a rig file
    that is named, or its folder. The point files that it names are protected when it is read.
    """
    found = [] if rig is None else [rig]
    for path in (*paths, *found):
        with contextlib.suppress(OSError):
            folder = path.is_dir() and not is_log(path)
            for log in filter(_may_be_read, path.iterdir()) if folder else (path,):
                found += [log, *log.rglob("*")]
                with contextlib.suppress(TdfscalError):
                    found += read_bag(log).files if log.is_dir() else ()  # also named elsewhere
            found.append((path if folder else path.absolute().parent) / RIG_NAME)
    return found
