"""rosbag2 folders: their metadata, which files these name, and what should be in them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Final

from tdfscal.errors import DataError, UsageError
from tdfscal.files.yaml import read_document
from tdfscal.findings import Finding, Value
from tdfscal.logs.log_file import placed

_METADATA: Final = "metadata.yaml"
_STORED: Final = re.compile(r"(?i).+\.(mcap|db3)(\.(zstd|zst|gz))?")


@dataclass(slots=True)
class Bag:
    """A recording of one or several files.

    topics : messages of each topic in all files, as the recorder has written them; empty where that
    is not stated. unlisted : files in the folder that its metadata does not list.
    """

    files: tuple[Path, ...]
    topics: Mapping[str, int]
    unlisted: tuple[str, ...] = ()
    _found: Counter[str] = field(default_factory=Counter)
    _read: int = 0
    _cut: bool = False

    def check(self, found: Counter[str], *, cut: bool) -> list[Finding]:
        """Note the messages of a file that is read, by topic; cut : it was cut short.

        Returns doubts with the last file. Raises DataError where what is stated contradicts what is
        there in files that are whole.
        """
        self._found += found
        self._cut |= cut
        self._read += 1
        if self._read < len(self.files):
            return []
        for topic, count in self.topics.items():
            if self._found[topic] != count and not self._cut:
                what = f"{self._found[topic]} messages of {topic} are there where"
                hint = "copy the recording again"
                raise DataError(f"{what} {_METADATA} states {count}", hint=hint)
        if not self.unlisted:
            return []
        values: dict[str, Value] = {"files": _some(self.unlisted), "metadata": _METADATA}
        return [Finding("recordings-unlisted", values=values)]


def has_metadata(folder: Path) -> bool:
    """Tell whether a folder is a rosbag2 recording.

    Raises UsageError where it may not be looked into.
    """
    try:
        return (folder / _METADATA).is_file()
    except PermissionError as error:
        raise _closed(folder, error) from error


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


def read_bag(folder: Path) -> Bag:
    """Read the metadata of a rosbag2 folder.

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
            bag = _described(folder, information)
            storage, mode = information["storage_identifier"], information.get("compression_mode")
        except (KeyError, TypeError, AttributeError) as error:
            raise DataError("this is no description of a rosbag2 recording") from error
        if storage not in ("mcap", "sqlite3"):
            hint = "convert it to MCAP with `ros2 bag convert`"
            raise DataError(f"the recording is stored as {storage}", hint=hint)
        if str(mode or "none").lower() in ("file", "message"):
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


def _described(folder: Path, information: Any) -> Bag:
    """The recording; raises what a document of another shape causes."""
    names = [_typed(name, str) for name in _typed(information["relative_file_paths"], list)]
    # The first recorders put the folder's name before the file's.
    files = tuple(folder / PurePosixPath(name).name for name in names)
    topics = Counter[str]()
    for one in _typed(information.get("topics_with_message_count") or [], list):
        topics[_typed(one["topic_metadata"]["name"], str)] += _typed(one["message_count"], int)
    return Bag(files, topics, tuple(path.name for path in _stored(folder) if path not in files))


def _stored(folder: Path) -> list[Path]:
    entries = sorted(entries_of(folder))
    return [entry for entry in entries if _STORED.fullmatch(entry.name) and entry.is_file()]


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _typed(value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        raise TypeError
    return value
