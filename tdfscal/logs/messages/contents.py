"""Contents of a recording: topics, their message types, and what in them has x, y, z."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Final

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Schema
from rosbags.interfaces import Nodetype

from tdfscal.errors import TdfscalError
from tdfscal.logs.common.contents import (
    SAMPLES,
    Contents,
    Field,
    Format,
    Stream,
    Vector,
    axes_of,
    extremes,
)
from tdfscal.logs.common.damage import damage, one_line
from tdfscal.logs.common.message_path import Named, shown
from tdfscal.logs.common.message_path import Path as MessagePath
from tdfscal.logs.messages.buffer import Messages, Recording
from tdfscal.logs.messages.cdr import Gatherer, element_names, layout_of
from tdfscal.logs.messages.decoded import ReadNumbers, content_of, json_of, read_json
from tdfscal.logs.messages.header_times import Stamps
from tdfscal.logs.messages.ros_types import ROS, Definitions, definitions, full_name
from tdfscal.records import FloatArray, IntArray

_MAX_DEPTH: Final = 8
_MAX_LEAVES: Final = 64
_MOST_SAMPLES: Final = 1 << 14  # of a topic
_STAMP: Final = ("header", "stamp", "sec")

_LISTS: Final = frozenset({"float64[]", "float32[]", "list"})
_BY_NAME = re.compile(r"[^\[\]\"']*[^\[\]\"'\d][^\[\]\"']*")
"""Names that a message path can hold, and that are no number."""

Read = Callable[[Messages], FloatArray]


@dataclass(frozen=True, slots=True)
class _Leaf:
    """A number or a list in a message, or what has three axes: paths to them, in the order x, y, z.

    label : name that says what it is, where that is not the path.
    """

    path: MessagePath
    kind: str
    axes: tuple[MessagePath, ...] = ()
    label: str = ""

    @classmethod
    def struct(cls, path: MessagePath, kind: str) -> _Leaf:
        """A field that has x, y, z."""
        return cls(path, kind, tuple((*path, axis) for axis in "xyz"))


@dataclass(slots=True)
class _Topic:
    """One channel as it is looked through; every: so many messages, one is sampled at most."""

    channel: Channel
    kind: str
    leaves: list[_Leaf] = field(default_factory=list)
    read: Read | None = None
    time: list[IntArray] = field(default_factory=list)
    value: list[FloatArray] = field(default_factory=list)
    first: int | None = None
    last: int | None = None
    problem: str | None = None
    joints: tuple[str, ...] = ()
    every: int = 1
    stamps: Stamps | None = None

    @property
    def stamped(self) -> bool:
        """Whether its messages have a header with a time."""
        return any(leaf.path == _STAMP for leaf in self.leaves)


def recording_contents(recording: Recording, form: Format) -> Contents:
    """Look through a recording: every topic, with samples of what has x, y, z.

    Raises
    ------
    UsageError, DataError : it cannot be read, or is damaged.
    """
    path = recording.path
    topics: dict[int, _Topic] = {}
    with damage(path, McapError):
        for messages in recording.messages():
            for number in messages.counts():
                of = messages.of(number)
                if number not in topics:
                    topics[number] = _topic(recording, number, of)
                _look(topics[number], of)
    streams: list[Stream] = []
    vectors: list[Vector] = []
    problems: list[str] = []
    unusable: dict[str, str] = {}
    stamped: set[str] = set()
    for number, topic in topics.items():
        name = topic.channel.topic
        streams.append(_stream(topic, recording.counts[number]))
        vectors += _vectors(topic)
        if topic.problem:
            problems.append(f"{name}: {topic.problem}")
        if topic.stamped:
            stamped.add(name)
        if topic.stamps is not None and (why := topic.stamps.unusable()):
            unusable[name] = why
    empty = {c.topic for c in recording.channels.values()} - {s.name for s in streams}
    streams += [Stream(name, "", 0, ()) for name in sorted(empty)]
    return Contents(
        path, form, path.stat().st_size, tuple(sorted(streams, key=lambda s: s.name)),
        tuple(sorted(vectors, key=lambda v: v.fields)), stamped=frozenset(stamped),
        unusable=unusable,
        problems=tuple(problems), joints={t.channel.topic: t.joints for t in topics.values()
                                          if t.joints},
    )  # fmt: skip


def _topic(recording: Recording, number: int, messages: Messages) -> _Topic:
    """Find out what the messages of a channel hold, and how to read it."""
    channel = recording.channels[number]
    schema = recording.schemas.get(channel.schema_id)
    kind = schema.name if schema is not None else channel.message_encoding
    topic = _Topic(channel, kind)
    try:
        if channel.message_encoding in ROS and schema is not None:
            _open_ros(topic, schema, messages)
        elif channel.message_encoding == "json":
            _open_json(topic, messages)
        elif channel.message_encoding == "protobuf" and schema is not None:
            _open_protobuf(topic, schema)
        else:
            topic.problem = f"messages encoded as {channel.message_encoding!r} are not read"
    except (ValueError, TdfscalError) as error:
        topic.problem = one_line(error)
    return topic


def _open_ros(topic: _Topic, schema: Schema, messages: Messages) -> None:
    encoding = topic.channel.message_encoding
    types = definitions(schema.name, schema.encoding, schema.data.decode("utf-8"))
    leaves = islice(_leaves_of_type(types, full_name(schema.name), (), 0), _MAX_LEAVES)
    topic.leaves = list(leaves)
    if _Leaf(("name",), "string[]") in topic.leaves:
        first = messages.bytes_of(0)
        topic.joints = tuple(element_names(types, schema.name, first, encoding))

        def there(path: MessagePath) -> bool:
            try:
                layout_of(types, schema.name, [path], first, encoding)
            except (ValueError, struct.error):
                return False
            return True

        topic.leaves += _joints(topic, there)
    if paths := _paths(topic.leaves):
        topic.read = Gatherer(types, schema.name, paths, encoding)
    if topic.stamped:
        gatherer = Gatherer(types, schema.name, [_STAMP, (*_STAMP[:-1], "nanosec")], encoding)
        topic.stamps = Stamps(topic.channel.topic, lambda m: gatherer(m) @ [1.0, 1e-9])


def _open_json(topic: _Topic, messages: Messages) -> None:
    first = messages.at(0)
    value = json_of(content_of(messages, 0))
    topic.leaves = list(islice(_leaves_of_value(value, (), 0), _MAX_LEAVES))
    names = value.get("name") if isinstance(value, dict) else None
    if isinstance(names, list) and all(isinstance(name, str) for name in names):
        topic.joints = tuple(names)

        def there(path: MessagePath) -> bool:
            try:
                read_json(first, [path], stamped=False)
            except ValueError:
                return False
            return True

        topic.leaves += _joints(topic, there)
    _read_by(topic, read_json)


def _joints(topic: _Topic, there: Callable[[MessagePath], bool]) -> list[_Leaf]:
    """Elements of lists whose names differ in x, y, z only, as in JointState."""
    names = [name for name in topic.joints if _BY_NAME.fullmatch(name)]
    found: list[_Leaf] = []
    for leaf in [leaf for leaf in topic.leaves if leaf.kind in _LISTS and len(leaf.path) == 1]:
        for label, three in axes_of(names):
            axes = tuple((*leaf.path, Named(name)) for name in three)
            if all(map(there, axes)):
                found.append(_Leaf((*leaf.path, Named(label)), leaf.kind, axes, f".{label}"))
    return found[:_MAX_LEAVES]


def _open_protobuf(topic: _Topic, schema: Schema) -> None:
    from tdfscal.logs.messages import protobuf_messages as protobuf

    kind = protobuf.message_class(schema.name, schema.data)
    topic.leaves = [
        _Leaf.struct(path, name) if vector else _Leaf(path, name)
        for path, name, vector in islice(protobuf.leaves(kind), _MAX_LEAVES)
    ]
    _read_by(topic, protobuf.reader_of(kind))


def _read_by(topic: _Topic, read: ReadNumbers) -> None:
    if paths := _paths(topic.leaves):
        topic.read = lambda m: read(m, paths, stamped=False)
    if topic.stamped:
        topic.stamps = Stamps(topic.channel.topic, lambda m: read(m, [], stamped=True)[:, 0])


def _paths(leaves: Sequence[_Leaf]) -> list[MessagePath]:
    return [path for leaf in leaves for path in leaf.axes]


def _leaves_of_type(
    types: Definitions, name: str, path: MessagePath, depth: int
) -> Iterator[_Leaf]:
    members: Mapping[str, Any] = dict(types.get(name, ()))
    if {"x", "y", "z"} <= members.keys() and "w" not in members:
        yield _Leaf.struct(path, name)
        return
    if not members or depth == _MAX_DEPTH:
        yield _Leaf(path, name)
        return
    for member, (kind, detail) in members.items():
        here = (*path, member)
        if kind == Nodetype.NAME:
            yield from _leaves_of_type(types, detail, here, depth + 1)
        elif kind == Nodetype.BASE:
            yield _Leaf(here, detail[0])
        else:
            (inner, what), _ = detail
            yield _Leaf(here, f"{what[0] if inner == Nodetype.BASE else what}[]")


def _leaves_of_value(value: Any, path: MessagePath, depth: int) -> Iterator[_Leaf]:
    if isinstance(value, dict) and depth < _MAX_DEPTH:
        if {"x", "y", "z"} <= value.keys() and "w" not in value:
            yield _Leaf.struct(path, "object")
            return
        for key, inner in value.items():
            yield from _leaves_of_value(inner, (*path, str(key)), depth + 1)
    else:
        yield _Leaf(path, type(value).__name__)


def _look(topic: _Topic, messages: Messages) -> None:
    """Note the times of messages, and sample their vectors."""
    ticks = messages.log_time()
    low, high = int(ticks.min()), int(ticks.max())
    topic.first = low if topic.first is None else min(topic.first, low)
    topic.last = high if topic.last is None else max(topic.last, high)
    if topic.stamps is not None:
        topic.stamps.note(messages)
    if topic.read is None:
        return
    step = max(-(-ticks.size // SAMPLES), topic.every)
    some = Messages(
        messages.data, messages.offset[::step], messages.length[::step], messages.channel[::step]
    )
    try:
        topic.value.append(topic.read(some))
        topic.time.append(ticks[::step])
    except (ValueError, OverflowError, struct.error) as error:
        topic.problem = f"a message cannot be read: {one_line(error)}"
        topic.read = None
    if sum(map(len, topic.time)) > _MOST_SAMPLES:
        topic.value = [np.concatenate(topic.value)[::2]]
        topic.time = [np.concatenate(topic.time)[::2]]
        topic.every *= 2


def _stream(topic: _Topic, count: int) -> Stream:
    fields: list[Field] = []
    column = 0
    value = np.concatenate(topic.value) if topic.value else None
    for leaf in topic.leaves:
        name = shown(leaf.path).removeprefix(".")
        if not leaf.axes:
            fields.append(Field(name, leaf.kind))
            continue
        low, high = (None, None)
        if value is not None:
            low, high = extremes(value[:, column : column + 3])
        fields.append(Field(name, leaf.kind, None, low, high))
        column += 3
    start = None if topic.first is None else topic.first / 1e9
    end = None if topic.last is None else topic.last / 1e9
    return Stream(topic.channel.topic, topic.kind, count, tuple(fields), start, end)


def _vectors(topic: _Topic) -> Iterator[Vector]:
    if not topic.value:
        return
    value = np.concatenate(topic.value)
    time = np.concatenate(topic.time) / 1e9
    order = np.argsort(time, kind="stable")
    name = topic.channel.topic
    for k, leaf in enumerate(leaf for leaf in topic.leaves if leaf.axes):
        three = value[order, 3 * k : 3 * k + 3]
        if leaf.label:
            fields = tuple(name + shown(path) for path in leaf.axes)
            kind = f"{topic.kind} {leaf.path[0]}"
        else:
            fields = (name + shown(leaf.path),)
            kind = f"{topic.kind} {leaf.kind}"
        yield Vector(
            fields, name + (leaf.label or shown(leaf.path)), kind, None, time[order], three
        )
