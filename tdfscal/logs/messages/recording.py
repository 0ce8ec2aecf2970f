"""A file of messages by topic, in whichever container."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import ClassVar, Final

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Schema

from tdfscal.errors import DataError
from tdfscal.logs.contents import Contents, Format, Stream
from tdfscal.logs.log_file import LogFile
from tdfscal.logs.messages.buffer import Messages
from tdfscal.logs.messages.contents import TopicLook
from tdfscal.logs.messages.topics import Topics
from tdfscal.logs.request import Block, Piece, Request
from tdfscal.logs.rosbag2 import Bag

_ENOUGH: Final = 1 << 14  # samples of a piece


class Recording(LogFile):
    """A file of messages; what it says of itself fills in on the way.

    channels, schemas : by id, as met so far. counts : messages by channel, as met.
    checked : a checksum covers every message. bag : the rosbag2 recording that it is part of.
    """

    form: ClassVar[Format]
    faults = (McapError,)

    def __init__(self, path: Path, bag: Bag | None = None) -> None:
        super().__init__(path)
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.counts: Counter[int] = Counter()
        self.checked = False
        self._bag = bag

    @abstractmethod
    def stored(self) -> Iterator[Messages]:
        """Yield the messages in file order, some at a time.

        Raises DataError or ValueError on whatever is damaged.
        """

    def messages(self) -> Generator[Messages, None, None]:
        """Yield the messages in file order, some at a time, and count them."""
        for messages in self.stored():
            present = messages.counts()
            if not present.keys() <= self.channels.keys():
                what = "messages belong to a channel that is not defined"
                raise DataError(what, hint="copy the recording again")
            self.counts.update(present)
            yield messages

    def read(self, request: Request) -> Iterator[Piece]:
        """Yield the samples of the wanted topics.

        Raises DataError without a mapping: topics cannot be guessed.
        """
        if not request.declared:
            raise DataError(
                "a recording by topics needs a mapping that names them",
                hint="add a `log:` block to rig.yaml; `tdfscal info` proposes one",
            )
        topics = Topics(self.channels, self.schemas, request)
        waiting: list[Piece] = []
        size = 0
        for messages in self.messages():
            piece = topics.piece(messages)
            if not piece:
                continue
            waiting.append(piece)
            size += max(block.time.size for block in piece)
            if size >= _ENOUGH:
                yield _join(waiting)
                waiting, size = [], 0
        if waiting:
            yield _join(waiting)
        topics.check_complete()
        if self._bag is not None:
            found: Counter[str] = Counter()
            for number, count in self.counts.items():
                found[self.channels[number].topic] += count
            self.findings += self._bag.check(found, cut=self.cut_at is not None)
        self.findings += [f for topic, skew in topics.skews.items() for f in skew.findings(topic)]
        if self.checked and self.cut_at is None:
            self.integrity = "verified"

    def look(self) -> Contents:
        """Every topic, with samples of what has x, y, z."""
        topics: dict[tuple[object, ...], TopicLook] = {}
        for messages in self.messages():
            # A publisher that was started again has another channel of the same topic and type.
            alike: dict[tuple[object, ...], list[int]] = {}
            for number in messages.counts():
                channel = self.channels[number]
                schema = self.schemas.get(channel.schema_id)
                kind = (schema.name, schema.data) if schema is not None else ()
                alike.setdefault((channel.topic, channel.message_encoding, kind), []).append(number)
            for key, numbers in alike.items():
                of = messages.at(np.isin(messages.channel, numbers))
                if key not in topics:
                    channel = self.channels[numbers[0]]
                    topics[key] = TopicLook(channel, self.schemas.get(channel.schema_id), of)
                topics[key].note(of)
        found = [topic.found() for topic in topics.values()]
        streams = [stream for stream, _ in found]
        empty = {c.topic for c in self.channels.values()} - {stream.name for stream in streams}
        streams += [Stream(name, "", 0, ()) for name in empty]
        vectors = [vector for _, own in found for vector in own]
        return Contents(
            self.path,
            self.form,
            self.path.stat().st_size,
            tuple(sorted(streams, key=lambda s: s.name)),
            tuple(sorted(vectors, key=lambda v: v.fields)),
            problems=tuple(f"{t.name}: {t.problem}" for t in topics.values() if t.problem),
        )


def _join(pieces: Sequence[Piece]) -> Piece:
    """Put consecutive pieces together, clock by clock."""
    if len(pieces) == 1:
        return pieces[0]
    by_clock: dict[str, list[Block]] = {}
    for piece in pieces:
        for block in piece:
            by_clock.setdefault(block.clock, []).append(block)
    return tuple(
        Block(
            clock,
            np.concatenate([b.time for b in blocks]),
            {s: np.concatenate([b.value[s] for b in blocks]) for s in blocks[0].value},
        )
        for clock, blocks in by_clock.items()
    )
