"""Which files are logs, and the class that reads each."""

from __future__ import annotations

import stat
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Final

from tdfscal.errors import UsageError
from tdfscal.logs.log_file import LogFile
from tdfscal.logs.rosbag2 import Bag, has_metadata, read_bag
from tdfscal.records import LogMapping

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
    if path.is_dir() or path.suffix.lower() not in _SHARED:
        return is_log(path)
    from tdfscal.logs.text.header import table_of_numbers
    from tdfscal.logs.text.reader import lines_of

    try:
        with path.open("rb") as file:
            lines = lines_of(file.read(_OPENING).decode("latin-1"))
    except OSError:
        return True  # the reader says why
    table = table_of_numbers(lines)
    return table is not None and table.width > _FEWEST


def open_log(path: Path, bag: Bag | None = None) -> LogFile:
    """A file for one reading, by its suffix; bag : the recording that it is part of.

    What reads a format is imported for it alone. Raises UsageError where it is of no kind that is
    read here.
    """
    match _suffix(path):
        case ".parquet":
            from tdfscal.logs.parquet import ParquetLog

            return ParquetLog(path)
        case ".mcap":
            from tdfscal.logs.messages.mcap import McapFile

            return McapFile(path, bag)
        case ".db3":
            from tdfscal.logs.messages.bags import SqliteBag

            return SqliteBag(path, bag)
        case ".bag":
            from tdfscal.logs.messages.bags import Ros1Bag

            return Ros1Bag(path, bag)
        case suffix if suffix in _TEXT:
            from tdfscal.logs.text.reader import TextLog

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
    return list(files_of(paths))


def files_of(paths: Sequence[Path]) -> dict[Path, Bag | None]:
    """As `expand`, each file with the rosbag2 recording that it is part of."""
    files: dict[Path, Bag | None] = {}
    for path in paths:
        if path.is_dir():
            bag = read_bag(path)
            files |= dict.fromkeys(bag.files, bag)
        else:
            check_regular(path)
            files[path] = None
    return files


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


def owns(recorder: LogMapping, path: Path) -> bool:
    """Tell whether a path is of a recorder's files."""
    return (
        recorder.files is None or fnmatch(path.name, recorder.files) or path.match(recorder.files)
    )
