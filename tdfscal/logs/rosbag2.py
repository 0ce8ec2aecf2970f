"""rosbag2 folders: their files, and the counts of messages that metadata.yaml states."""

from __future__ import annotations

import re
import stat
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Final

from tdfscal.errors import DataError, UsageError
from tdfscal.files.yaml import read_document
from tdfscal.findings import Finding, Value
from tdfscal.logs.log_file import placed

METADATA: Final = "metadata.yaml"
_STORED: Final = re.compile(r"(?i).+\.(mcap|db3)(\.(zstd|zst|gz))?")


@dataclass(slots=True)
class Bag:
    """A recording of one or several files.

    topics : messages of each topic in all files, as the recorder has written them; None where that
    is not stated. total : of all topics in all files, likewise. stated : messages of each file as
    the recorder has received them, which are more where it could not keep pace. unlisted : files
    in the folder that its metadata does not list.
    """

    folder: Path
    files: tuple[Path, ...]
    topics: Mapping[str, int] | None
    total: int | None
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
        if self.total is not None and counts.total() != self.total and not self._cut:
            raise _contradiction(counts.total(), "", f"{self.total} in all")
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
    total = information.get("message_count")
    stated = {
        folder / PurePosixPath(_typed(one["path"], str)).name: _typed(one["message_count"], int)
        for one in _typed(information.get("files") or [], list)
    }
    bag = Bag(
        folder,
        files,
        None if listed is None else topics,
        None if total is None else _typed(total, int),
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
