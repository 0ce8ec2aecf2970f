"""Which files are logs, the class that reads each, and what rosbag2 folders should hold."""

from __future__ import annotations

import re
import stat
from collections.abc import Iterator, Sequence, Set
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath
from typing import Final

from tdfscal.errors import DataError, UsageError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.files.yaml import read_document
from tdfscal.findings import Finding, Value
from tdfscal.logs.log_file import LogFile, placed

_TEXT: Final = (".csv", ".tsv", ".txt", ".dat", ".log")
_KINDS: Final = (*_TEXT, ".parquet", ".mcap", ".db3", ".bag")
_COMPRESSED: Final = (".gz", ".zst")
_ARCHIVES: Final = (".zstd", ".bz2", ".xz", ".zip", ".7z")
_SHARED: Final = (".txt", ".dat", ".log")
_OPENING: Final = 1 << 16
_FEWEST: Final = 9  # three supports have 18 columns
NOWHERE = "it is a link that leads to no file; correct or remove it"
"""What to do about such a link."""


def is_log(path: Path) -> bool:
    """Tell whether a path looks like a log: by its suffix, or as a rosbag2 folder.

    Raises UsageError for a folder that may not be looked into.
    """
    return has_metadata(path) if path.is_dir() else _suffix(path) in _KINDS


def looks_recorded(path: Path) -> bool:
    """Tell whether a file of a folder that nobody names is a log.

    By its suffix; where that is shared with notes and messages, by a row of numbers near its start.
    """
    if not path.is_file() or path.suffix.lower() not in _SHARED:
        return is_log(path)
    from tdfscal.logs.text_file import lines_of
    from tdfscal.logs.text_table import table_of_numbers

    try:
        with path.open("rb") as file:
            lines = lines_of(file.read(_OPENING).decode("latin-1"))
    except OSError:
        return True  # the reader says why
    table = table_of_numbers(lines)
    return table is not None and table.width > _FEWEST


def open_log(path: Path) -> LogFile:
    """A file for one reading, by its suffix.

    What reads a format is imported for it alone. Raises UsageError where it is of no kind that is
    read here.
    """
    match _suffix(path):
        case ".parquet":
            from tdfscal.logs.parquet import ParquetLog

            return ParquetLog(path)
        case ".mcap":
            from tdfscal.logs.messages.mcap import McapFile

            return McapFile(path)
        case ".db3":
            from tdfscal.logs.messages.bags import SqliteBag

            return SqliteBag(path)
        case ".bag":
            from tdfscal.logs.messages.bags import Ros1Bag

            return Ros1Bag(path)
        case suffix if suffix in _TEXT:
            from tdfscal.logs.text import TextLog

            return TextLog(path)
        case suffix if suffix in _ARCHIVES:
            what = f"a file that ends in {suffix} is not read"
            hint = "decompress it first; text logs are read in gzip (.gz) and zstd (.zst), too"
        case suffix:
            what = f"no kind of log ends in {suffix or 'nothing'!r}"
            hint = f"logs are {', '.join(_KINDS)} (text also .gz, .zst) or a rosbag2 folder"
    raise UsageError(what, where=str(path), hint=hint)


def expand(paths: Sequence[Path]) -> list[Path]:
    """Replace rosbag2 folders by their files, in the order of their metadata.

    Raises UsageError where a path is not there, is no regular file, or is a folder that is no
    recording, DataError for a rosbag2 folder whose files are not there.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            files += files_of_bag(path)
        else:
            check_regular(path)
            files.append(path)
    return files


def unlisted(paths: Sequence[Path]) -> list[Finding]:
    """Name recordings that lie in rosbag2 folders without standing in their metadata."""
    found = []
    for folder in filter(Path.is_dir, paths):
        listed = files_of_bag(folder)
        if more := [path.name for path in _stored(folder) if path not in listed]:
            values: dict[str, Value] = {"files": _some(more), "metadata": _METADATA}
            found.append(Finding("recordings-unlisted", values={**values, "file": str(folder)}))
    return found


def check_regular(path: Path) -> None:
    """Refuse what is no regular file before it is opened: a pipe without a writer never answers.

    Raises UsageError where there is no such file, it cannot be reached, or is a pipe or a device.
    """
    hint: str | None = NOWHERE if path.is_symlink() else None
    try:
        if stat.S_ISREG(path.stat().st_mode):
            return
        what = "is no regular file but a pipe or a device"
        hint = "write what it gives into a file, and name that"
    except (FileNotFoundError, NotADirectoryError):
        what = "there is no such file"
    except (OSError, ValueError) as error:
        what = f"the file cannot be opened ({getattr(error, 'strerror', None) or error})"
        hint = hint or "check the path and its permissions"
    raise UsageError(what, where=str(path), hint=hint)


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    return Path(path.stem).suffix.lower() if suffix in _COMPRESSED else suffix


def owns(recorder: LogBlock, path: Path) -> bool:
    """Tell whether a path is of a recorder's files."""
    return (
        recorder.files is None or fnmatch(path.name, recorder.files) or path.match(recorder.files)
    )


_METADATA: Final = "metadata.yaml"
_STORED: Final = re.compile(r"(?i).+\.(mcap|db3)(\.(zstd|zst|gz))?")


def has_metadata(folder: Path) -> bool:
    """Tell whether a folder is a rosbag2 recording.

    Raises UsageError where it may not be looked into.
    """
    with _looking_into(folder):
        return (folder / _METADATA).is_file()


def entries_of(folder: Path) -> list[Path]:
    """List a folder, by names. Raises UsageError where that is not allowed."""
    with _looking_into(folder):
        return sorted(folder.iterdir(), key=lambda entry: natural(entry.name))


def natural(name: str) -> list[tuple[int, int, str]]:
    """Sort key that puts rosbag_2 before rosbag_10."""
    parts = re.split(r"(\d+)", name)
    return [(1, int(part), "") if part.isdecimal() else (0, 0, part) for part in parts]


@contextmanager
def _looking_into(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise UsageError(
            f"the folder cannot be looked into ({error.strerror})",
            where=str(folder),
            hint="make it readable, or name the logs themselves",
        ) from error


def refuse_unfinished(folder: Path, named: Set[Path] = frozenset()) -> None:
    """Refuse a folder that holds recordings without the metadata that would list them.

    A recorder that is killed leaves such a folder. What the folder should hold is then not known.
    named : files, links resolved, that are taken by their own names.
    """
    if has_metadata(folder):
        return
    stored = [path.name for path in _stored(folder) if path.resolve() not in named]
    if stored:
        raise UsageError(
            f"the folder holds {_some(stored)} and no {_METADATA}: its recording was not finished",
            where=str(folder),
            hint=f"write its {_METADATA} with `ros2 bag reindex`, or name its .mcap or .db3 files",
        )


def files_of_bag(folder: Path) -> list[Path]:
    """Files of a rosbag2 folder, by its metadata.

    Raises UsageError where the folder is no recording, DataError where its metadata is damaged, or
    its files are compressed or not there.
    """
    refuse_unfinished(folder)
    if not has_metadata(folder):
        raise UsageError(
            f"the folder is no recording: it has no {_METADATA}",
            where=str(folder),
            hint="name the log files",
        )
    content = read_document(folder / _METADATA, DataError).content
    with placed(folder / _METADATA):
        try:
            information = content["rosbag2_bagfile_information"]
            storage, mode = information["storage_identifier"], information.get("compression_mode")
            # The first recorders put the folder's name before the file's.
            names = [PurePosixPath(name).name for name in information["relative_file_paths"]]
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError("this is no description of a rosbag2 recording") from error
        if storage not in ("mcap", "sqlite3"):
            hint = "convert it to MCAP with `ros2 bag convert`"
            raise DataError(f"the recording is stored as {storage}", hint=hint)
        if str(mode or "none").lower() in ("file", "message"):
            raise DataError(
                f"the recording is compressed ({mode}, {information.get('compression_format')})",
                hint="decompress it with `ros2 bag convert`; chunks of MCAP are read compressed",
            )
        files = [folder / name for name in names]
        absent = [path.name for path in files if not path.is_file()]
        if absent or not files:
            raise DataError(
                f"the recording lacks {', '.join(absent) or 'any file'}",
                hint="copy the folder again, or name the files that are there",
            )
        if len(set(files)) < len(files):
            raise DataError("the recording names a file twice")
    return files


def _stored(folder: Path) -> list[Path]:
    entries = entries_of(folder)
    return [entry for entry in entries if _STORED.fullmatch(entry.name) and entry.is_file()]


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
