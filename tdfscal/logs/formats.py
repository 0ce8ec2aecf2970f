"""Which files are logs, and which reader takes which."""

from __future__ import annotations

import stat
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Literal

from tdfscal.errors import DataError, UsageError
from tdfscal.logs.bag.rosbag2 import Bag, has_metadata, read_bag
from tdfscal.logs.common.request import Reader
from tdfscal.records import LogMapping

_TEXT = (".csv", ".tsv", ".txt", ".dat", ".log")
_COMPRESSED = (".gz", ".zst")
NOWHERE = "it is a link that leads to no file; correct or remove it"
"""What to do about such a link."""


def is_log(path: Path) -> bool:
    """Tell whether a path looks like a log: by its suffix, or as a rosbag2 folder.

    Raises UsageError for a folder that may not be looked into.
    """
    if path.is_dir():
        return has_metadata(path)
    return _suffix(path) in (*_TEXT, ".parquet", ".mcap")


def kind_of(path: Path) -> Literal["text", "parquet", "mcap"]:
    """Return the kind of a log file, by its suffix.

    Raises
    ------
    UsageError : the file is of no kind that is read here.
    """
    suffix = _suffix(path)
    if suffix == ".parquet":
        return "parquet"
    if suffix == ".mcap":
        return "mcap"
    if suffix in _TEXT:
        return "text"
    raise UsageError(
        f"no kind of log ends in {suffix or 'nothing'!r}",
        where=str(path),
        hint="logs are .csv, .tsv (also .gz, .zst), .parquet, .mcap or a rosbag2 folder",
    )


def reader_of(path: Path, mapping: LogMapping | None, bag: Bag | None = None) -> Reader:
    """Return the reader for a file, by its suffix; bag: the recording that it is part of.

    Raises
    ------
    UsageError : the file is of no kind that is read here.
    DataError : an MCAP file without a mapping: its topics cannot be guessed.
    """
    kind = kind_of(path)
    if kind == "parquet":
        from tdfscal.logs.parquet.reader import read_parquet

        return read_parquet
    if kind == "text":
        from tdfscal.logs.text.reader import read_text

        return read_text
    if mapping is None:
        raise DataError(
            "a recording in MCAP needs to be told which topics to read",
            where=str(path),
            hint="add a `log:` block to rig.yaml; `tdfscal info` proposes one",
        )
    from tdfscal.logs.mcap.reader import read_mcap

    return partial(read_mcap, check=bag.check if bag else None)


def expand(paths: Sequence[Path]) -> list[Path]:
    """Replace rosbag2 folders by their files, in the order of their metadata.

    Raises
    ------
    UsageError : a path is not there, is no regular file, or is a folder that is no recording.
    DataError : a rosbag2 folder whose files are not MCAP, or are not there.
    """
    return [path for path, _ in files_of(paths)]


def files_of(paths: Sequence[Path]) -> list[tuple[Path, Bag | None]]:
    """As `expand`, each file with the rosbag2 recording that it is part of."""
    files: list[tuple[Path, Bag | None]] = []
    for path in paths:
        if path.is_dir():
            bag = read_bag(path)
            files += [(file, bag) for file in bag.files]
        else:
            check_regular(path)
            files.append((path, None))
    return files


def check_regular(path: Path) -> None:
    """Refuse what is no regular file before it is opened: a pipe without a writer never answers.

    Raises
    ------
    UsageError : there is no such file, it cannot be reached, or it is a pipe or a device.
    """
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError) as error:
        raise UsageError(
            "there is no such file", where=str(path), hint=NOWHERE if path.is_symlink() else None
        ) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UsageError(
            f"the file cannot be opened ({reason})",
            where=str(path),
            hint=NOWHERE if path.is_symlink() else "check the path and its permissions",
        ) from error
    if not stat.S_ISREG(mode):
        raise UsageError(
            "is no regular file but a pipe or a device",
            where=str(path),
            hint="write what it gives into a file, and name that",
        )


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    return Path(path.stem).suffix.lower() if suffix in _COMPRESSED else suffix
