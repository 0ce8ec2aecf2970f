"""From a command's PATH… to the rig, the logs and the tracker's survey, and to all it reads."""

from __future__ import annotations

import contextlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from tdfscal.errors import TdfscalError, UsageError, expect
from tdfscal.files import RIG_NAME, WRENCH_WRITER
from tdfscal.files.model_errors import nearest
from tdfscal.files.outputs import protect
from tdfscal.files.rig.reading import LoadedRig, load_rig
from tdfscal.files.yaml import as_path
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.logs import is_log, looks_recorded
from tdfscal.logs.formats import (
    NOWHERE,
    check_regular,
    entries_of,
    owns,
    read_bag,
    refuse_unfinished,
)
from tdfscal.records import LogMapping

PathLike = str | os.PathLike[str]
PathLikes = PathLike | Sequence[PathLike]

#: How results of tdfscal begin, but for quotes: tables by their first line, documents by their
#: format, pages, exports and drafts by what wrote them.
_OWN = re.compile(
    rb"""\A(?:\#[ ]tdfscal[ ]|time,fx,fy,fz,mx,my,mz,u_fx,|sensor,r_xx,r_xy,)
    | \btdfscal[ ]\d[^\s,]*,[ ]\w+[ ]calibration[ ]of[ ]
    | <meta[ ]name=generator[ ]content=tdfscal[ ]
    | ^[ ]*format:[ ]*tdfscal-
    | ^\#[ ]Drafted[ ]by[ ]`tdfscal[ ]""",
    re.VERBOSE | re.MULTILINE,
)
#: The first format that a document names is its own.
_FORMAT = re.compile(rb"format:\s*tdfscal-(rig|calibration)/")
_HEAD = 1 << 14
#: What the metadata of a Parquet file of contact wrenches say, at the end of the file.
_QUANTITY = b"contact wrench on the terminal: force, and moment"
_TAIL = 1 << 16
_KINDS = (
    "logs are .csv, .tsv, .txt, .dat, .log (also .gz, .zst), .parquet, .mcap, .db3, .bag or "
    "rosbag2 folders"
)


def listed(paths: PathLikes) -> list[Path]:
    """Return one path, or several, as a list. Raises UsageError where one is named twice."""
    each = [paths] if isinstance(paths, str | os.PathLike) else paths
    expect("paths", each, Sequence, "a path, or a list of them")
    found = list(map(as_path, each))
    counts = Counter(map(os.path.realpath, found))
    for path in found:
        if counts[os.path.realpath(path)] > 1:
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
    def averaged(self) -> bool:
        """Each row of a log is a posture."""
        return self.rig.averaged

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
    _require(paths)
    loaded = _rig_of(paths, one(rig), fallback)
    surveys = loaded.tracker.paths if loaded.tracker else ()
    surveyed = bool(surveys) and all(path.is_file() for path in surveys)
    logs = find_logs(paths, apart=surveys, recorders=loaded.log)
    # A folder that holds nothing of the rig has no part in its survey.
    homes = {home for file in (*surveys, loaded.path) for home in _real(file).parents}
    if not logs and not (surveyed and homes.intersection(map(_real, paths))):
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
    patterns = [one for one in recorders if one.files is not None]
    found: dict[Path, Path] = {}
    others: list[Path] = []
    for path in paths:
        if not _is_folder(path):
            _refuse_other(path)
            found.setdefault(_real(path), path)
            continue
        for entry in sorted(entries_of(path), key=_natural):
            own = not patterns or any(owns(one, entry) for one in patterns)
            if entry.name.startswith(".") or not own:
                continue
            if _is_recorded(entry) and _real(entry) not in known:
                found.setdefault(_real(entry), entry)
            elif entry.is_dir() and not (entry / RIG_NAME).is_file():
                others.append(entry)  # no campaign of its own: an unfinished recording?
    for folder in others:
        refuse_unfinished(folder, found.keys())
    for path in found.values():
        if not path.is_dir():
            check_regular(path)
    for path in (*paths, *found.values()):
        protect((path, *_parts(path), (path if _is_folder(path) else path.parent) / RIG_NAME))
    return tuple(found.values())


def _parts(path: Path) -> Iterator[Path]:
    """Files of a recording that is a folder, those elsewhere too."""
    if is_log(path) and path.is_dir():
        yield from path.rglob("*")
        with contextlib.suppress(TdfscalError):
            yield from read_bag(path).files


def _refuse_other(path: Path) -> None:
    """Raise UsageError for what is no log by its name."""
    if is_log(path):
        return
    hint = {
        "rig": "name the folder of the logs, or give it by --rig",
        "calibration": "name a campaign folder, or its logs",
    }.get(own_format(path), _KINDS)
    kind = other_kind(path, "log")
    what = f"is {kind}, not a log" if kind else "is not a log"
    raise UsageError(what, where=str(path), hint=hint)


def _real(path: Path) -> Path:
    """Where a path leads; unlike `Path.resolve` it takes a link that leads to itself."""
    return Path(os.path.realpath(path))


def _is_folder(path: Path) -> bool:
    """It is a folder, and no recording that is one."""
    return path.is_dir() and not is_log(path)


def _is_recorded(entry: Path) -> bool:
    return entry.stem != "calibration" and looks_recorded(entry) and _may_be_read(entry)


def _may_be_read(entry: Path) -> bool:
    """Whether what a folder holds is a log by its name, and no result of tdfscal."""
    # A pipe is not opened here: that might never end.
    return is_log(entry) and not (entry.is_file() and is_own_result(entry))


def _rig_of(paths: Sequence[Path], given: Path | None, fallback: LoadedRig | None) -> LoadedRig:
    if given is not None:
        return _load(given)
    homes = [path if _is_folder(path) else path.absolute().parent for path in paths]
    beside = {_real(home / RIG_NAME): home / RIG_NAME for home in homes}
    rigs = [_load(path) for path in beside.values() if path.is_file()]
    if not rigs and fallback is not None:
        return fallback
    if not rigs:
        for path in filter(Path.is_file, paths):
            _refuse_other(path)
        rig_files = [name for name in _names(homes[0]) if own_format(homes[0] / name) == "rig"]
        near = nearest(RIG_NAME, rig_files)
        rename = f"rename {near} to {RIG_NAME} or name it with --rig"
        raise UsageError(
            f"there is no {RIG_NAME}",
            where=str(homes[0]),
            hint=rename if near else "name the rig file with --rig",
        )
    other = next((rig for rig in rigs if rig.sha256 != rigs[0].sha256), None)
    if other is not None:
        raise UsageError(
            f"the paths belong to different rigs, {rigs[0].path} and {other.path}",
            hint="take one campaign at a time, or say which rig holds with --rig",
        )
    return rigs[0]


def _require(paths: Sequence[Path]) -> None:
    if not paths:
        raise UsageError("no path is given", hint="name a campaign folder or its logs")
    for path in paths:
        if not path.exists():
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
    loose = any(not _is_folder(path) for path in paths if not inside[path])
    if len(found) < (2 if loose else 1):
        return [paths]
    return [[folder] for path in paths for folder in inside[path] or [path]]


def _campaigns_in(path: Path) -> list[Path]:
    """A campaign folder itself, or those inside of one that holds such, also without their rig."""
    if not _is_folder(path):
        return []
    if (path / RIG_NAME).is_file():
        return [path]
    folders = [entry for entry in sorted(entries_of(path)) if _is_folder(entry)]
    if not any((folder / RIG_NAME).is_file() for folder in folders):
        return []
    return [f for f in folders if (f / RIG_NAME).is_file() or any(map(_is_recorded, entries_of(f)))]


def rig_named(path: PathLike) -> LoadedRig:
    """Load a rig file, or the rig.yaml of a campaign folder. Raises UsageError, RigError."""
    file = as_path(path)
    if file.is_dir():
        file = file / RIG_NAME
    if not file.is_file():
        raise UsageError(
            "there is no such rig file", where=str(file), hint="name a rig.yaml or its folder"
        )
    return _load(file)


def _load(path: Path) -> LoadedRig:
    """Load a rig file; no output replaces it, its point files, or the logs that lie beside it."""
    loaded = load_rig(path)
    points = loaded.tracker.paths if loaded.tracker else ()
    protect((path, *points, *filter(_may_be_read, entries_of(path.absolute().parent))))
    return loaded


def _head(path: Path) -> bytes:
    """The beginning of a file without quotes; nothing of a pipe, and of what cannot be read."""
    with contextlib.suppress(OSError):
        if path.is_file():
            with path.open("rb") as file:
                return file.read(_HEAD).replace(b'"', b"")
    return b""


def own_format(path: Path) -> str:
    """Tell whether a file is a `rig` file or a `calibration`; empty for another one."""
    found = _FORMAT.search(_head(path))
    return found[1].decode() if found else ""


def other_kind(path: Path, wanted: str) -> str:
    """Tell what stands where a `log` or a `calibration` is wanted; empty where it may be one."""
    kind = own_format(path) or ("log" if is_log(path) else "")
    said = {"rig": "a rig file", "calibration": "a calibration", "log": "a log"}
    return "a folder" if path.is_dir() else said.get(kind, "") if kind != wanted else ""


def is_own_result(path: Path) -> bool:
    """Tell whether a file is a result of tdfscal and no recording."""
    head = _head(path)
    if _OWN.search(head):
        return True
    if path.suffix.lower() == ".mcap":
        return WRENCH_WRITER.encode() in head[:256]  # who wrote it
    if path.suffix.lower() != ".parquet":
        return False
    with contextlib.suppress(OSError), path.open("rb") as file:
        file.seek(max(0, file.seek(0, 2) - _TAIL))
        return _QUANTITY in file.read()
    return False
