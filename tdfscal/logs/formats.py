"""Which files are logs, also those of a rosbag2 folder, and the class that reads each."""

from __future__ import annotations

import re
import stat
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath
from typing import Any, Final

from tdfscal.errors import DataError, UsageError
from tdfscal.files.yaml import read_document
from tdfscal.findings import Finding, Value
from tdfscal.logs.log_file import LogFile, placed
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
METADATA: Final = "metadata.yaml"
_STORED: Final = re.compile(r"(?i).+\.(mcap|db3)(\.(zstd|zst|gz))?")


@dataclass(slots=True)
class Bag:
    """A recording of one or several files.

    topics : messages of each topic in all files, as the recorder has written them; None where that
    is not stated. stated : messages of each file as the recorder has received them, which are more
    where it could not keep pace. unlisted : files in the folder that its metadata does not list.
    """

    folder: Path
    files: tuple[Path, ...]
    topics: Mapping[str, int] | None
    stated: Mapping[Path, int]
    unlisted: tuple[str, ...] = ()
    _found: dict[Path, Counter[str]] = field(default_factory=dict)
    _cut: bool = False

    def check(self, path: Path, found: Counter[str], *, cut: bool) -> list[Finding]:
        """Note the messages of a file that is read, by topic; cut : it was cut short.

        Returns doubts; those of the folder come with its last file. Raises DataError where what is
        stated contradicts what is there in files that are whole.
        """
        self._found[path] = found
        self._cut = self._cut or cut
        doubts: list[Finding] = []
        there = found.total()
        if self.stated.get(path, there) != there:
            if self.topics is None and not cut:
                raise _contradiction(there, "", self.stated[path])
            values: dict[str, Value] = {"recorded": self.stated[path], "metadata": METADATA}
            doubts.append(Finding("messages-lost", size=there, values=values))
        if len(self._found) < len(self.files):
            return doubts
        if self.unlisted:
            values = {"files": _some(self.unlisted), "metadata": METADATA}
            doubts.append(Finding("recordings-unlisted", values=values))
        counts = sum(self._found.values(), Counter[str]())
        for topic, count in (self.topics or {}).items():
            if counts[topic] != count and not self._cut:
                raise _contradiction(counts[topic], f" of {topic}", count)
        return doubts


def _contradiction(there: int, of: str, stated: object) -> DataError:
    what = f"{there} messages{of} are there where {METADATA} states {stated}"
    return DataError(what, hint="copy the recording again")


def refuse_unfinished(folder: Path, named: Set[Path] = frozenset()) -> None:
    """Refuse a folder that holds recordings without the metadata that would list them.

    A recorder that is killed leaves such a folder. What the folder should hold is then not known.
    named : files, links resolved, that are taken by their own names.
    """
    if has_metadata(folder):
        return
    stored = [path.name for path in _stored(folder) if path.resolve() not in named]
    if not stored:
        return
    raise UsageError(
        f"the folder holds {_some(stored)} and no {METADATA}: its recording was not finished",
        where=str(folder),
        hint=f"write its {METADATA} with `ros2 bag reindex`, or name its .mcap or .db3 files",
    )


def _stored(folder: Path) -> list[Path]:
    entries = sorted(entries_of(folder))
    return [entry for entry in entries if _STORED.fullmatch(entry.name) and entry.is_file()]


def has_metadata(folder: Path) -> bool:
    """Tell whether a folder is a rosbag2 recording.

    Raises UsageError where it may not be looked into.
    """
    try:
        return stat.S_ISREG((folder / METADATA).stat().st_mode)
    except PermissionError as error:
        raise _closed(folder, error) from error
    except (OSError, ValueError):
        return False


def entries_of(folder: Path) -> list[Path]:
    """List a folder. Raises UsageError where that is not allowed."""
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise _closed(folder, error) from error


def _closed(folder: Path, error: OSError) -> UsageError:
    return UsageError(
        f"the folder cannot be looked into ({error.strerror})",
        where=str(folder),
        hint="make it readable, or name the logs themselves",
    )


def read_bag(folder: Path) -> Bag:
    """Read the metadata of a rosbag2 folder.

    Raises UsageError where the folder is no recording, DataError where its metadata is damaged, or
    its files are compressed or not there.
    """
    refuse_unfinished(folder)
    if not has_metadata(folder):
        raise UsageError(
            f"the folder is no recording: it has no {METADATA}",
            where=str(folder),
            hint="name the log files",
        )
    content = read_document(folder / METADATA, DataError).content
    with placed(folder / METADATA):
        try:
            bag, storage, information = _described(folder, content)
        except (KeyError, TypeError, AttributeError) as error:
            raise DataError("this is no description of a rosbag2 recording") from error
        if storage not in ("mcap", "sqlite3"):
            hint = "convert it to MCAP with `ros2 bag convert`"
            what = f"the recording is stored as {storage}" if storage else "it names no storage"
            raise DataError(what, hint=hint)
        mode = information.get("compression_mode") or "none"
        if str(mode).lower() in ("file", "message"):
            raise DataError(
                f"the recording is compressed ({mode}, {information.get('compression_format')})",
                hint="decompress it with `ros2 bag convert`; chunks of MCAP are read compressed",
            )
        absent = [path.name for path in bag.files if not path.is_file()]
        if absent or not bag.files:
            raise DataError(
                f"the recording lacks {', '.join(absent) or 'any file'}",
                hint="copy the folder again, or name the files that are there",
            )
        if len(set(bag.files)) < len(bag.files):
            raise DataError("the recording names a file twice")
    return bag


def _described(folder: Path, content: Any) -> tuple[Bag, Any, Any]:
    """The recording, its storage, its metadata; raises what a document of another shape causes."""
    information = content["rosbag2_bagfile_information"]
    names = [_typed(name, str) for name in _typed(information["relative_file_paths"], list)]
    # The first recorders put the folder's name before the file's.
    files = tuple(folder / PurePosixPath(name).name for name in names)
    listed, topics = information.get("topics_with_message_count"), Counter[str]()
    for one in _typed([] if listed is None else listed, list):
        topics[_typed(one["topic_metadata"]["name"], str)] += _typed(one["message_count"], int)
    stated = {
        folder / PurePosixPath(_typed(one["path"], str)).name: _typed(one["message_count"], int)
        for one in _typed(information.get("files") or [], list)
    }
    bag = Bag(
        folder,
        files,
        None if listed is None else topics,
        stated,
        tuple(path.name for path in _stored(folder) if path not in files),
    )
    return bag, information["storage_identifier"], information


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _typed(value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        raise TypeError
    return value


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
    from tdfscal.logs.text.header import table_of_numbers
    from tdfscal.logs.text.reader import lines_of

    try:
        with path.open("rb") as file:
            text = file.read(_OPENING).decode("latin-1")
    except OSError:
        return True  # the reader says why
    table = table_of_numbers(lines_of(text))
    return table is not None and table.width > _FEWEST


def check_text(path: Path) -> None:
    """Raise DataError where a file is text by its suffix, and none by its first lines."""
    if path.suffix.lower() in _TEXT:
        from tdfscal.logs.log_file import placed
        from tdfscal.logs.text.reader import decoded

        with placed(path), path.open("rb") as file:
            decoded(file.read(_OPENING))


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
            from tdfscal.logs.messages.recording import SqliteBag

            return SqliteBag(path, bag)
        case ".bag":
            from tdfscal.logs.messages.recording import Ros1Bag

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
