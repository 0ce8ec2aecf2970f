"""A file of messages by topic, in whichever container: its samples, and what it holds."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import ClassVar, Final

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Schema

from tdfscal.errors import DataError
from tdfscal.logs.contents import SAMPLES, Contents, Field, Format, Stream, Vector, extremes
from tdfscal.logs.log_file import Block, LogFile, Piece, Request, reason
from tdfscal.logs.messages.buffer import Leaf, Messages, Named, Read, path_text
from tdfscal.logs.messages.topics import UNREADABLE, Ros, Topics, encoding_of
from tdfscal.logs.table import axes_of
from tdfscal.records import FloatArray, IntArray

_ENOUGH: Final = 1 << 14  # samples of a piece


class Recording(LogFile):
    """A file of messages; what it says of itself fills in on the way.

    channels, schemas : by id, as met so far. counts : messages by channel, as met.
    checked : a checksum covers every message.
    """

    form: ClassVar[Format]
    faults = (McapError,)

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.counts: Counter[int] = Counter()
        self.checked = False

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


_MAX_LEAVES: Final = 64
_MOST_SAMPLES: Final = 1 << 14  # of a topic
_LISTS: Final = ("float64[]", "float32[]")
_NAMES: Final = Leaf(("name",), "string[]")
_BY_NAME = re.compile(r"[^\[\]\"']*[^\[\]\"'\d][^\[\]\"']*")
"""Names that a message path can hold, and that are no number."""


class TopicLook:
    """One topic as it is looked through; the first messages show what they hold.

    problem : why its messages cannot be read, if so.
    """

    def __init__(self, channel: Channel, schema: Schema | None, first: Messages) -> None:
        self.name = channel.topic
        self.problem: str | None = None
        self._kind = schema.name if schema is not None else channel.message_encoding
        self._leaves: list[Leaf] = []
        self._read: Read | None = None
        self._time: list[IntArray] = []
        self._value: list[FloatArray] = []
        self._ends: list[int] = []
        self._every = 1  # of so many messages, one is sampled at most
        self._count = 0
        try:
            encoding = encoding_of(channel, schema)
            self._leaves = list(islice(encoding.leaves(first.bytes_of(0)), _MAX_LEAVES))
            if isinstance(encoding, Ros) and _NAMES in self._leaves:
                self._leaves += _by_name(encoding, first.at(0), self._leaves)
            if paths := [path for leaf in self._leaves for path in leaf.axes]:
                self._read = encoding.reader(paths, stamped=False)
        except UNREADABLE as error:
            self.problem = reason(error)

    def note(self, messages: Messages) -> None:
        """Note the times of messages, and sample their vectors."""
        ticks = messages.log_time()
        self._count += ticks.size
        self._ends = [min([*self._ends, int(ticks.min())]), max([*self._ends, int(ticks.max())])]
        if self._read is None:
            return
        step = max(-(-ticks.size // SAMPLES), self._every)
        try:
            self._value.append(self._read(messages.at(slice(None, None, step))))
            self._time.append(ticks[::step])
        except UNREADABLE as error:
            self.problem = f"a message cannot be read: {reason(error)}"
            self._read = None
        if sum(map(len, self._time)) > _MOST_SAMPLES:
            self._value = [np.concatenate(self._value)[::2]]
            self._time = [np.concatenate(self._time)[::2]]
            self._every *= 2

    def found(self) -> tuple[Stream, list[Vector]]:
        """Its fields, and what has x, y, z, as sampled."""
        fields: list[Field] = []
        vectors: list[Vector] = []
        time = np.concatenate([np.empty(0), *self._time]) / 1e9
        order = np.argsort(time, kind="stable")
        for leaf in self._leaves:
            low = high = None
            if leaf.axes and self._value:
                column = 3 * len(vectors)
                three = np.concatenate(self._value)[:, column : column + 3]
                low, high = extremes(three)
                named = leaf.axes if leaf.label else (leaf.path,)
                vector = Vector(
                    fields=tuple(self.name + path_text(path) for path in named),
                    label=self.name + (leaf.label or path_text(leaf.path)),
                    kind=f"{self._kind} {leaf.path[0] if leaf.label else leaf.kind}",
                    unit=None,
                    time=time[order],
                    value=three[order],
                )
                vectors.append(vector)
            fields.append(Field(path_text(leaf.path)[1:], leaf.kind, None, low, high))
        start, end = (tick / 1e9 for tick in self._ends)
        return Stream(self.name, self._kind, self._count, tuple(fields), start, end), vectors


def _by_name(encoding: Ros, first: Messages, leaves: list[Leaf]) -> list[Leaf]:
    """Elements of lists whose names differ in x, y, z only, as in JointState."""
    names = [name for name in encoding.names(first.bytes_of(0)) if _BY_NAME.fullmatch(name)]
    found: list[Leaf] = []
    for leaf in [leaf for leaf in leaves if leaf.kind in _LISTS and len(leaf.path) == 1]:
        for label, three in axes_of(names):
            axes = tuple((*leaf.path, Named(name)) for name in three)
            try:
                encoding.reader(axes, stamped=False)(first)
            except UNREADABLE:
                continue
            found.append(Leaf((*leaf.path, Named(label)), leaf.kind, axes, f".{label}"))
    return found[:_MAX_LEAVES]
