"""rosbag2 folders: their files, and the counts of messages that metadata.yaml states."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from tdfscal.errors import DataError, UsageError
from tdfscal.files.yamlio import read_document

METADATA: Final = "metadata.yaml"


@dataclass(slots=True)
class Bag:
    """A recording of one or several files.

    topics : messages of each topic in all files, as the recorder has written them; None where that
    is not stated. stated : messages of each file as the recorder has received them, which are more
    where it could not keep pace.
    """

    folder: Path
    files: tuple[Path, ...]
    topics: Mapping[str, int] | None
    stated: Mapping[Path, int]
    _found: dict[Path, Mapping[str, int]] = field(default_factory=dict)

    def check(self, path: Path, found: Mapping[str, int]) -> tuple[list[str], list[str]]:
        """Note the messages of a file that is read, by topic.

        Returns
        -------
        contradictions, warnings : between what is stated and what is there. Those of the topics
        come with the last file.
        """
        self._found[path] = found
        contradictions: list[str] = []
        warnings: list[str] = []
        there = sum(found.values())
        if (stated := self.stated.get(path, there)) != there:
            text = f"{there} messages are there where {METADATA} states {stated}"
            if self.topics is None:
                contradictions.append(text)
            else:
                warnings.append(f"{text}: the recorder has lost some")
        if self.topics is not None and len(self._found) == len(set(self.files)):
            total: Counter[str] = Counter()
            for counts in self._found.values():
                total.update(counts)
            contradictions += [
                f"{total[topic]} messages of {topic} are there where {METADATA} states {count}"
                for topic, count in self.topics.items()
                if total[topic] != count
            ]
        return contradictions, warnings


def read_bag(folder: Path) -> Bag:
    """Read the metadata of a rosbag2 folder.

    Raises
    ------
    UsageError : the folder is no recording.
    DataError : its metadata is damaged, its files are not MCAP, or are not there.
    """
    where = str(folder / METADATA)
    if not (folder / METADATA).is_file():
        raise UsageError(
            f"the folder is no recording: it has no {METADATA}",
            where=str(folder),
            hint="name the log files",
        )
    content = read_document(folder / METADATA, DataError).content
    try:
        information = content["rosbag2_bagfile_information"]
        storage = information["storage_identifier"]
        names = [_typed(name, str) for name in _typed(information["relative_file_paths"], list)]
        topics = _topics(information.get("topics_with_message_count"))
        stated = {
            folder / _typed(one["path"], str): _typed(one["message_count"], int)
            for one in _typed(information.get("files") or [], list)
        }
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError("this is no description of a rosbag2 recording", where=where) from error
    if storage != "mcap":
        raise DataError(
            f"the recording is stored as {storage}",
            where=where,
            hint="convert it to MCAP with `ros2 bag convert`",
        )
    files = tuple(folder / name for name in names)
    absent = [path.name for path in files if not path.is_file()]
    if absent or not files:
        raise DataError(f"the recording lacks {', '.join(absent) or 'any file'}", where=where)
    if len(set(files)) < len(files):
        raise DataError("the recording names a file twice", where=where)
    return Bag(folder, files, topics, stated)


def _topics(listed: Any) -> dict[str, int] | None:
    if listed is None:
        return None
    counts: Counter[str] = Counter()
    for one in _typed(listed, list):
        name = _typed(one["topic_metadata"]["name"], str)
        counts[name] += _typed(one["message_count"], int)
    return dict(counts)


def _typed(value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        raise TypeError
    return value
