"""Which files are logs, and which reader takes which."""

from __future__ import annotations

import stat
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from tdfscal.errors import DataError, UsageError
from tdfscal.logs.bag.rosbag2 import Bag, has_metadata, read_bag
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.common.damage import placed
from tdfscal.logs.common.request import Reader, Request

if TYPE_CHECKING:
    from tdfscal.logs.messages.buffer import Recording

Kind = Literal["text", "parquet", "mcap", "bag"]
_KINDS: Final[dict[str, Kind]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".log"), "text"),
    ".parquet": "parquet",
    ".mcap": "mcap",
    **dict.fromkeys((".db3", ".bag"), "bag"),
}
_COMPRESSED = (".gz", ".zst")
_SHARED: Final = (".txt", ".dat", ".log")
_OPENING: Final = 1 << 16
_FEWEST: Final = 9  # three supports have 18 columns
_POINTER: Final = b"version https://git-lfs.github.com/spec/"
NOWHERE = "it is a link that leads to no file; correct or remove it"
"""What to do about such a link."""


def is_log(path: Path) -> bool:
    """Tell whether a path looks like a log: by its suffix, or as a rosbag2 folder.

    Raises UsageError for a folder that may not be looked into.
    """
    if path.is_dir():
        return has_metadata(path)
    return _suffix(path) in _KINDS


def looks_recorded(path: Path) -> bool:
    """Tell whether a file of a folder that nobody names is a log.

    By its suffix; where that is shared with notes and messages, by a row of numbers near its start.
    """
    if path.is_dir() or path.suffix.lower() not in _SHARED:
        return is_log(path)
    from tdfscal.logs.text.file import lines_of
    from tdfscal.logs.text.header import numbered_columns

    try:
        with path.open("rb") as file:
            text = file.read(_OPENING).decode("latin-1")
    except OSError:
        return True  # the reader says why
    lines = lines_of(text, "\n" if "\n" in text else "\r")
    tables = (numbered_columns(lines, decimal) for decimal in ".,")
    return any(table is not None and len(table.cells) > _FEWEST for table in tables)


def _kind_of(path: Path) -> Kind:
    """Return the kind of a log file, by its suffix.

    Raises UsageError where it is of no kind that is read here, DataError for git-LFS's pointer,
    which stands in a log's place where git keeps it elsewhere.
    """
    suffix = _suffix(path)
    if suffix in (".zstd", ".bz2", ".xz", ".zip", ".7z"):
        raise UsageError(
            f"a file that ends in {suffix} is not read",
            where=str(path),
            hint="decompress it first" + (", with `zstd -d`" if suffix == ".zstd" else "")
            + "; text logs are read in gzip (.gz) and zstd (.zst), too",
        )  # fmt: skip
    if suffix not in _KINDS:
        raise UsageError(
            f"no kind of log ends in {suffix or 'nothing'!r}",
            where=str(path),
            hint=f"logs are {', '.join(_KINDS)} (text also .gz, .zst) or a rosbag2 folder",
        )
    try:
        with path.open("rb") as file:
            pointer = file.read(len(_POINTER)) == _POINTER
    except OSError:
        pointer = False  # the reader says why
    if pointer:
        raise DataError(
            "this is git-LFS's pointer to the log, not the log",
            where=str(path),
            hint="fetch the log itself with `git lfs pull`",
        )
    return _KINDS[suffix]


def reader_of(path: Path, request: Request, bag: Bag | None = None) -> Reader:
    """Return the reader for a file, by its suffix; bag: the recording that it is part of.

    Raises UsageError where it is of no kind that is read here, DataError for a recording of
    messages without a mapping: its topics cannot be guessed.
    """
    kind = _kind_of(path)
    if kind == "parquet":
        from tdfscal.logs.parquet.reader import read_parquet

        return read_parquet
    if kind == "text":
        from tdfscal.logs.text.reader import read_text

        return read_text
    if not request.declared:
        raise DataError(
            "a recording by topics needs a mapping that names them",
            where=str(path),
            hint="add a `log:` block to rig.yaml; `tdfscal info` proposes one",
        )
    from tdfscal.logs.messages.reader import read_recording

    return partial(read_recording, opened=_recording, check=bag.check if bag else None)


def _recording(path: Path) -> Recording:
    """A file of messages; what reads its container is imported for it alone."""
    if _suffix(path) == ".mcap":
        from tdfscal.logs.mcap.container import Container

        return Container(path)
    if _suffix(path) == ".bag":
        from tdfscal.logs.bag.ros1 import Ros1Recording

        return Ros1Recording(path)
    from tdfscal.logs.bag.sqlite import SqliteRecording

    return SqliteRecording(path)


def contents_of(path: Path, *, opening: bool = False) -> Contents:
    """Look through a file, or its opening, whatever is wanted of it.

    Raises UsageError or DataError where it is of no kind that is read here, or cannot be read.
    """
    kind = _kind_of(path)
    with placed(path):
        if kind == "parquet":
            from tdfscal.logs.parquet.contents import parquet_contents

            return parquet_contents(path)
        if kind == "text":
            from tdfscal.logs.text.contents import text_contents

            return text_contents(path, opening=opening)
        from tdfscal.logs.messages.reader import recording_contents

        return recording_contents(_recording(path), opening=opening)


def expand(paths: Sequence[Path]) -> list[Path]:
    """Replace rosbag2 folders by their files, in the order of their metadata.

    Raises UsageError where a path is not there, is no regular file, or is a folder that is no
    recording, DataError for a rosbag2 folder whose files are not there.
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

    Raises UsageError where there is no such file, it cannot be reached, or is a pipe or a device.
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
