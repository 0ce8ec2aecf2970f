"""Which topic carries which signals, and how its messages are decoded: ROS by definitions, JSON."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from mcap.records import Channel, Schema
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.base import TypesysError

from tdfscal.catalogue.numbers import when
from tdfscal.errors import DataError
from tdfscal.logs.clock import Skew
from tdfscal.logs.log_file import Block, Piece, Request, missing_fields, reason
from tdfscal.logs.messages.buffer import (
    MAX_DEPTH,
    Json,
    Leaf,
    Messages,
    Named,
    Path,
    Read,
    has_axes,
    parse_steps,
    path_text,
    struct_leaf,
    topic_of,
)
from tdfscal.logs.messages.cdr import Definitions, Gatherer, element_names
from tdfscal.records import FloatArray, IntArray

_STAMP: Final[tuple[Path, Path]] = (("header", "stamp", "sec"), ("header", "stamp", "nanosec"))
_SHOWN: Final = 12

Decoder = Callable[[Messages], tuple[FloatArray, FloatArray]]
"""Messages of one channel → time (N,) in s, values (N, 3 · signals) as recorded."""
UNREADABLE = (ValueError, OverflowError, struct.error)
"""What decoding raises on a message that is not what its type says."""


class Ros:
    """Messages of a type by its definition; encoding : cdr or ros1."""

    def __init__(self, schema: Schema, encoding: str) -> None:
        self._name, self._encoding = full_name(schema.name), encoding
        self._types = definitions(schema.name, schema.encoding, schema.data.decode("utf-8"))
        try:
            self.stamped = all(map(self.checked, _STAMP))
        except ValueError:
            self.stamped = False

    def leaves(self, first: bytes) -> Iterator[Leaf]:
        """What there is in messages of the type."""
        yield from self._leaves(self._name, (), 0)

    def _leaves(self, name: str, path: Path, depth: int) -> Iterator[Leaf]:
        members = dict(self._types.get(name, ()))
        if has_axes(members.keys()):
            yield struct_leaf(path, name)
            return
        if not members or depth == MAX_DEPTH:
            yield Leaf(path, name)
            return
        for member, (kind, detail) in members.items():
            here = (*path, member)
            if kind == Nodetype.NAME:
                yield from self._leaves(detail, here, depth + 1)
            elif kind == Nodetype.BASE:
                yield Leaf(here, detail[0])
            else:
                (inner, what), _ = detail
                yield Leaf(here, f"{what[0] if inner == Nodetype.BASE else what}[]")

    def names(self, first: bytes) -> Sequence[str]:
        """Texts of the list `name`."""
        return element_names(self._types, self._name, first, self._encoding)

    def checked(self, path: Path) -> Path:
        """The path as the messages have it: a name that follows a list is that of an element.

        Raises ValueError where it leads nowhere.
        """
        node: Any = (Nodetype.NAME, self._name)
        steps: list[str | int | Named] = []
        for k, step in enumerate(path):
            kind, detail = node
            place = path_text(path[:k]) or self._name
            if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
                steps.append(Named(step) if isinstance(step, str) else step)
                node = detail[0]
                continue
            if not isinstance(step, str):
                raise ValueError(f"{place} of {self._name} is no list")
            fields = dict(self._types.get(detail, ())) if kind == Nodetype.NAME else {}
            if step not in fields:
                has = ", ".join(list(fields)[:_SHOWN]) + (", …" if len(fields) > _SHOWN else "")
                raise ValueError(
                    f"no field {step} in {place}; it has {has or 'no fields'}: name a field with "
                    "x, y, z, or three fields"
                )
            steps.append(step)
            node = fields[step]
        return tuple(steps)

    def reader(self, paths: Sequence[Path], *, stamped: bool) -> Read:
        """Return what reads (N, number of paths); with `stamped` the header's time, s, comes first.

        That is NaN with more than 1e9 ns to the second. It raises ValueError or struct.error where
        a message is not of its type or lacks a number.
        """
        whole = [*_STAMP, *paths] if stamped else paths
        gatherer = Gatherer(self._types, self._name, whole, self._encoding)
        if not stamped:
            return gatherer

        def read(messages: Messages) -> FloatArray:
            numbers = gatherer(messages)
            seconds, nanoseconds = numbers[:, 0], numbers[:, 1]
            numbers[:, 1] = np.where(nanoseconds < 1e9, seconds + nanoseconds / 1e9, np.nan)
            return numbers[:, 1:]

        return read


@functools.lru_cache(maxsize=64)
def definitions(name: str, encoding: str, text: str) -> Definitions:
    """Parse a schema's text; the parser is slow, and channels share their schemas.

    Raises ValueError where the text is no message definition, or of an unknown encoding.
    """
    try:
        if encoding == "ros2" and not text:
            types = _standard()
            if full_name(name) not in types:
                raise ValueError(f"the recording has no definition of {name}")
        elif encoding in ("ros2msg", "ros1msg"):
            types = get_types_from_msg(text, name)
        elif encoding == "ros2idl":
            types = get_types_from_idl(text)
        else:
            raise ValueError(f"schema encoding {encoding!r} is not known")
    except (TypesysError, KeyError, IndexError, AttributeError, RecursionError) as error:
        raise ValueError(f"the definition of {name} cannot be read") from error
    result: dict[str, Any] = {key: list(fields) for key, (_, fields) in types.items()}
    # What ROS 2 knows without a definition.
    pair = [("sec", (Nodetype.BASE, ("int32", 0))), ("nanosec", (Nodetype.BASE, ("uint32", 0)))]
    for known in ("Time", "Duration"):
        result.setdefault(f"builtin_interfaces/msg/{known}", pair)
    if full_name(name) not in result:
        raise ValueError(f"the definition of {name} is of another message")
    return result


@functools.cache
def _standard() -> Mapping[str, Any]:
    """Definitions of the messages that ROS 2 brings along, for recorders that store none."""
    return get_typestore(Stores.LATEST).fielddefs


def full_name(name: str) -> str:
    """geometry_msgs/Point → geometry_msgs/msg/Point."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def encoding_of(channel: Channel, schema: Schema | None) -> Json | Ros:
    """Return how a channel's messages are read; raises ValueError where they are not."""
    encoding = channel.message_encoding
    if encoding == "json":
        return Json()
    if encoding not in ("cdr", "ros1"):
        what = f"messages are encoded as {encoding!r}"
        raise ValueError(f"{what}; record ROS messages (cdr, ros1) or json")
    if schema is None:
        raise ValueError("the channel has no schema")
    return Ros(schema, encoding)


def _first_unreadable(decode: Decoder, messages: Messages, topic: str) -> str:
    """Which of them is the first that its type does not read, in words."""
    for k in range(messages.offset.size):
        try:
            decode(messages.at(k))
        except UNREADABLE:
            logged = messages.log_time()[k] / 1e9
            return f"the message of {topic} logged at {when(logged)}"
    return f"a message of {topic}"


class Topics:
    """Which topic carries which signals, and how its channels are decoded.

    channels, schemas : by id, as met so far. skews : of the header times, by topic.
    """

    def __init__(
        self, channels: Mapping[int, Channel], schemas: Mapping[int, Schema], request: Request
    ) -> None:
        self._channels, self._schemas, self._request = channels, schemas, request
        self.skews: dict[str, Skew] = {}
        self._signals: dict[str, list[int]] = {}
        self._decoders: dict[int, Decoder] = {}
        self._known = 0

    def piece(self, messages: Messages) -> Piece:
        """Return the wanted samples among the messages."""
        if len(self._channels) != self._known:
            self._bind()
        present = messages.counts()
        blocks: list[Block] = []
        for topic, signals in self._signals.items():
            channels = [c for c in present if self._channels[c].topic == topic]
            parts = [self._decoded(c, messages.of(c)) for c in channels]
            parts = [part for part in parts if part[0].size]
            if not parts:
                continue
            order, time, value = (np.concatenate(x) for x in zip(*parts, strict=True))
            # Channels of one topic take turns; logged messages need not be in order of time.
            by_log = self._request.mapping.time.source == "log"
            if len(parts) > 1 or (by_log and (np.diff(time) < 0.0).any()):
                ranks = np.argsort(time if by_log else order, kind="stable")
                time, value = time[ranks], value[ranks]
            vectors = {
                number: value[:, 3 * k : 3 * k + 3]
                * np.array(self._request.signals[number].factors)
                for k, number in enumerate(signals)
            }
            blocks.append(Block(topic, time, vectors))
        return tuple(blocks)

    def check_complete(self) -> None:
        """Refuse a file that lacks a topic, now that all of it is read."""
        bound = {number for numbers in self._signals.values() for number in numbers}
        unbound = [s for number, s in enumerate(self._request.signals) if number not in bound]
        if unbound:
            topics = sorted({channel.topic for channel in self._channels.values()})
            raise missing_fields([s.fields[0] for s in unbound], topics, kind="topic for")

    def _bind(self) -> None:
        """Match the mapping's paths with the topics known so far, the longest that fits."""
        topics = {channel.topic for channel in self._channels.values()}
        self._known = len(self._channels)
        signals: dict[str, list[int]] = {}
        for number, signal in enumerate(self._request.signals):
            found = {topic_of(name, topics) for name in signal.fields} - {None}
            if len(found) > 1:
                raise DataError(
                    f"the {signal.quantity} of {signal.support} is spread over the topics "
                    f"{', '.join(sorted(map(str, found)))}",
                    hint="x, y and z must come in one message",
                )
            for topic in found:
                signals.setdefault(str(topic), []).append(number)
        for topic in {self._channels[channel].topic for channel in self._decoders}:
            if signals.get(topic) != self._signals[topic]:
                raise DataError(
                    f"the mapping's fields fit topic {topic} and a longer one that comes later",
                    hint="record topics whose names do not begin alike",
                )
        self._signals = signals

    def _decoded(self, channel: int, messages: Messages) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return order in the file, time and values of one channel's messages."""
        if channel not in self._decoders:
            self._decoders[channel] = self._decoder(channel)
        topic = self._channels[channel].topic
        decode = self._decoders[channel]
        try:
            return messages.offset, *self._finite(topic, *decode(messages))
        except UNREADABLE as error:
            what = f"{_first_unreadable(decode, messages, topic)} cannot be read: {reason(error)}"
            raise DataError(what, hint="record that topic again") from error

    def _finite(
        self, topic: str, time: FloatArray, value: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The same; raises DataError where a number is not finite."""
        if np.isfinite(value.sum()) and np.isfinite(time.sum()):
            return time, value
        bad = ~(np.isfinite(value).all(axis=1) & np.isfinite(time))
        if bad.any():
            k = int(np.argmax(bad))
            what = f"a message of {topic} cannot be read: at {when(time[k])} it holds a number "
            what, fields = f"{what}that is not finite", list[str]()
            if np.isfinite(time[k]):
                column = int(np.argmin(np.isfinite(value[k])))
                signal = self._request.signals[self._signals[topic][column // 3]]
                name = signal.components[column % 3]
                what += f" ({name})"
                # An axis that nobody measures has no number anywhere.
                fields = [name] if np.isnan(value[:, column]).all() else []
            raise DataError(what, hint="record that topic again", fields=fields)
        return time, value

    def _decoder(self, channel_id: int) -> Decoder:
        channel = self._channels[channel_id]
        schema = self._schemas.get(channel.schema_id)
        where = f"topic {channel.topic}"
        try:
            encoding = encoding_of(channel, schema)
            paths = self._paths(channel.topic, encoding)
        except ValueError as error:
            raise DataError(str(error), where=where) from error
        wanted = self._request.mapping.time.source == "header"
        if wanted and encoding.stamped is False:
            raise DataError(
                f"{schema.name if schema else 'its type'} has no header with a time",
                where=where,
                hint="state `time: {source: log}` in the log block of rig.yaml",
            )
        stamped = wanted or encoding.stamped is True
        read = encoding.reader(paths, stamped=stamped)
        skew = self.skews.setdefault(channel.topic, Skew())

        def decode(messages: Messages) -> tuple[FloatArray, FloatArray]:
            numbers = read(messages)
            if not stamped:
                return self._recorded_time(messages), numbers
            header = numbers[:, 0]
            if wanted and np.isnan(header).any():
                raise ValueError("its time has more than 1e9 ns to the second, or is no number")
            skew.note(header, messages.log_time() / 1e9)
            return header if wanted else self._recorded_time(messages), numbers[:, 1:]

        return decode

    def _recorded_time(self, messages: Messages) -> FloatArray:
        publish = self._request.mapping.time.source == "publish"
        ticks = messages.publish_time() if publish else messages.log_time()
        seconds: FloatArray = ticks / 1e9
        return seconds

    def _paths(self, topic: str, encoding: Json | Ros) -> list[Path]:
        """Return three paths per signal of the topic; raises ValueError where one leads nowhere."""
        paths: list[Path] = []
        for number in self._signals[topic]:
            fields = self._request.signals[number].fields
            steps = [parse_steps(name[len(topic) :], name) for name in fields]
            if len(steps) == 1:
                steps = [(*steps[0], member) for member in "xyz"]
            paths += [encoding.checked(path) for path in steps]
        # A temperature is one field thrice, and what is not measured is another field again.
        if len(set(paths)) < sum(len(self._request.signals[n].own) for n in self._signals[topic]):
            raise ValueError("the mapping uses a field of the message twice")
        return paths
