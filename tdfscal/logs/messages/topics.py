"""Which topic carries which signals, and how its messages are decoded."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from mcap.records import Channel, Schema

from tdfscal.errors import DataError
from tdfscal.logs.common.clock import Skew, shown
from tdfscal.logs.common.message_path import Path as MessagePath
from tdfscal.logs.common.message_path import parse_steps, topic_of
from tdfscal.logs.common.request import Block, Piece, Request, missing_fields
from tdfscal.logs.messages.buffer import Messages, Recording
from tdfscal.logs.messages.cdr import Gatherer
from tdfscal.logs.messages.decoded import ReadNumbers, read_json
from tdfscal.logs.messages.ros_types import ROS, check_path, definitions, expand_vector, settled
from tdfscal.records import FloatArray, IntArray

_STAMP: Final[tuple[MessagePath, MessagePath]] = (
    ("header", "stamp", "sec"),
    ("header", "stamp", "nanosec"),
)
Decoder = Callable[[Messages], tuple[FloatArray, FloatArray]]
"""Messages of one channel → time (N,) in s, values (N, 3 · signals) as recorded."""


@dataclass(slots=True)
class Topics:
    """Which topic carries which signals, and how its channels are decoded."""

    recording: Recording
    request: Request
    lost: list[str] = field(default_factory=list)
    skews: dict[str, Skew] = field(default_factory=dict)
    _signals: dict[str, list[int]] = field(default_factory=dict)
    _decoders: dict[int, Decoder] = field(default_factory=dict)
    _known: int = 0

    def piece(self, messages: Messages) -> Piece:
        """Return the wanted samples among the messages."""
        if len(self.recording.channels) != self._known:
            self._bind()
        present = messages.counts()
        blocks: list[Block] = []
        for topic, signals in self._signals.items():
            channels = [c for c in self._channels(topic) if c in present]
            parts = [self._decoded(c, messages.of(c)) for c in channels]
            parts = [part for part in parts if part[0].size]
            if not parts:
                continue
            order, time, value = (np.concatenate(x) for x in zip(*parts, strict=True))
            # Channels of one topic take turns; logged messages need not be in order of time.
            by_log = self.request.time_source == "log"
            if len(parts) > 1 or (by_log and (np.diff(time) < 0.0).any()):
                ranks = np.argsort(time if by_log else order, kind="stable")
                time, value = time[ranks], value[ranks]
            blocks.append(self._block(topic, signals, time, value))
        return tuple(blocks)

    def counts(self) -> dict[str, int]:
        """Messages by topic, as met."""
        found: dict[str, int] = {}
        for number, count in self.recording.counts.items():
            channel = self.recording.channels.get(number)
            if channel is not None:
                found[channel.topic] = found.get(channel.topic, 0) + count
        return found

    def check_complete(self) -> None:
        """Refuse a file that lacks a topic, now that all of it is read."""
        bound = {number for numbers in self._signals.values() for number in numbers}
        missing = [
            signal.fields[0]
            for number, signal in enumerate(self.request.signals)
            if number not in bound
        ]
        if missing and (lost := [*self.recording.lost, *self.lost]):
            raise DataError(
                f"{lost[0]}; what is sound holds no topic for {', '.join(missing)}",
                where=str(self.recording.path),
                hint="copy the recording again",
            )
        if missing:
            topics = sorted({c.topic for c in self.recording.channels.values()})
            raise missing_fields(missing, topics, where=str(self.recording.path), kind="topic for")

    def check_present(self, announced: frozenset[str]) -> None:
        """Refuse a file whose summary lacks a topic, before it is read."""
        missing = [
            signal.fields[0]
            for signal in self.request.signals
            if all(topic_of(name, announced) is None for name in signal.fields)
        ]
        if missing:
            raise missing_fields(
                missing, sorted(announced), where=str(self.recording.path), kind="topic for"
            )

    def _channels(self, topic: str) -> list[int]:
        return [i for i, c in self.recording.channels.items() if c.topic == topic]

    def _bind(self) -> None:
        """Match the mapping's paths with the topics known so far, the longest that fits."""
        topics = {c.topic for c in self.recording.channels.values()}
        self._known = len(self.recording.channels)
        signals: dict[str, list[int]] = {}
        for number, signal in enumerate(self.request.signals):
            found = {topic_of(name, topics) for name in signal.fields} - {None}
            if len(found) > 1:
                raise DataError(
                    f"the {signal.quantity} of {signal.support} is spread over the topics "
                    f"{', '.join(sorted(map(str, found)))}",
                    where=str(self.recording.path),
                    hint="x, y and z must come in one message",
                )
            for topic in found:
                signals.setdefault(str(topic), []).append(number)
        for topic, numbers in self._signals.items():
            used = any(channel in self._decoders for channel in self._channels(topic))
            if used and signals.get(topic) != numbers:
                raise DataError(
                    f"the mapping's fields fit topic {topic} and a longer one that comes later",
                    where=str(self.recording.path),
                    hint="record topics whose names do not begin alike",
                )
        self._signals = signals

    def _decoded(self, channel: int, messages: Messages) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return order in the file, time and values of one channel's messages."""
        if channel not in self._decoders:
            self._decoders[channel] = self._decoder(channel)
        topic = self.recording.channels[channel].topic
        try:
            time, value = self._decoders[channel](messages)
            self._check_finite(topic, time, value)
        except (ValueError, OverflowError, struct.error) as error:
            what = f"a message of {topic} cannot be read: {error}"
            return self._one_by_one(channel, messages, what)
        return messages.offset, time, value

    def _one_by_one(
        self, channel: int, messages: Messages, what: str
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Keep the messages that can be read (only with `salvage`)."""
        if not self.recording.salvage:
            raise DataError(
                what,
                where=str(self.recording.path),
                hint="`calibrate --salvage` leaves such messages out",
            )
        topic = self.recording.channels[channel].topic
        width = 3 * len(self._signals[topic])
        order = [np.empty(0, dtype=np.int64)]
        times, values = [np.empty(0)], [np.empty((0, width))]
        for k in range(messages.offset.size):
            one = messages.at(k)
            try:
                time, value = self._decoders[channel](one)
                self._check_finite(topic, time, value)
            except (ValueError, OverflowError, struct.error):
                continue
            order.append(one.offset)
            times.append(time)
            values.append(value)
        lost = messages.offset.size - (len(times) - 1)
        self.lost.append(f"{lost} messages of {topic} are left out ({what})")
        return np.concatenate(order), np.concatenate(times), np.concatenate(values)

    def _check_finite(self, topic: str, time: FloatArray, value: FloatArray) -> None:
        if np.isfinite(value.sum()) and np.isfinite(time.sum()):
            return
        bad = ~(np.isfinite(value).all(axis=1) & np.isfinite(time))
        if bad.any():
            k = int(np.argmax(bad))
            what = f"at {shown(time[k])} s it holds a number that is not finite"
            if np.isfinite(time[k]):
                number, axis = divmod(int(np.argmin(np.isfinite(value[k]))), 3)
                signal = self.request.signals[self._signals[topic][number]]
                what += f" ({signal.components[axis]})"
            raise ValueError(what)

    def _decoder(self, channel_id: int) -> Decoder:
        channel = self.recording.channels[channel_id]
        schema = self.recording.schemas.get(channel.schema_id)
        encoding = channel.message_encoding
        where = f"{self.recording.path}, topic {channel.topic}"
        if encoding not in (*ROS, "json", "protobuf"):
            raise DataError(
                f"messages are encoded as {encoding!r}",
                where=where,
                hint="record ROS messages (cdr, ros1), protobuf or json",
            )
        try:
            if encoding == "json":
                return self._one_by_one_decoder(channel, read_json, where)
            if schema is None:
                raise ValueError("the channel has no schema")
            if encoding == "protobuf":
                from tdfscal.logs.messages.protobuf_messages import message_class, reader_of

                read = reader_of(message_class(schema.name, schema.data, where))
                return self._one_by_one_decoder(channel, read, where)
            return self._ros_decoder(channel, schema, where)
        except ValueError as error:
            raise DataError(str(error), where=where) from error

    def _one_by_one_decoder(self, channel: Channel, read: ReadNumbers, where: str) -> Decoder:
        paths = self._paths(channel.topic, None, where)
        stamped = self.request.time_source == "header"

        def decode(messages: Messages) -> tuple[FloatArray, FloatArray]:
            numbers = read(messages, paths, stamped=stamped)
            if stamped:
                return numbers[:, 0], numbers[:, 1:]
            return self._recorded_time(messages), numbers

        return decode

    def _ros_decoder(self, channel: Channel, schema: Schema, where: str) -> Decoder:
        types = definitions(schema.name, schema.encoding, schema.data.decode("utf-8"))
        paths = self._paths(channel.topic, (types, schema.name), where)
        wanted = self.request.time_source == "header"
        stamped = True
        try:
            for stamp in _STAMP:
                check_path(types, schema.name, stamp, where)
        except DataError as error:
            stamped = False
            if wanted:
                raise DataError(
                    f"{schema.name} has no header with a time",
                    where=where,
                    hint="state `time: {source: log}` in the log block of rig.yaml",
                ) from error
        gatherer = Gatherer(
            types, schema.name, [*_STAMP, *paths] if stamped else paths, channel.message_encoding
        )
        skew = self.skews.setdefault(channel.topic, Skew())

        def decode(messages: Messages) -> tuple[FloatArray, FloatArray]:
            numbers = gatherer(messages)
            if not stamped:
                return self._recorded_time(messages), numbers
            if wanted and (numbers[:, 1] >= 1e9).any():
                raise ValueError("its time has more than 1e9 ns to the second")
            header = numbers[:, 0] + numbers[:, 1] / 1e9
            skew.note(header, messages.log_time() / 1e9)
            return header if wanted else self._recorded_time(messages), numbers[:, 2:]

        return decode

    def _recorded_time(self, messages: Messages) -> FloatArray:
        publish = self.request.time_source == "publish"
        ticks = messages.publish_time() if publish else messages.log_time()
        seconds: FloatArray = ticks / 1e9
        return seconds

    def _paths(
        self, topic: str, types: tuple[Mapping[str, Any], str] | None, where: str
    ) -> list[MessagePath]:
        """Return three paths per signal of the topic; checked against the type where known."""
        paths: list[MessagePath] = []
        for number in self._signals[topic]:
            fields = self.request.signals[number].fields
            steps = [parse_steps(name[len(topic) :], name) for name in fields]
            if types is not None:
                steps = [settled(*types, path) for path in steps]
            if types is not None and len(steps) == 1:
                paths += expand_vector(*types, steps[0], where)
            elif len(steps) == 1:
                paths += [(*steps[0], member) for member in "xyz"]
            else:
                for path in steps:
                    if types is not None:
                        check_path(*types, path, where)
                paths += steps
        # A temperature is one field thrice, and what is not measured is another field again.
        own = [self.request.signals[n].distinct for n in self._signals[topic]]
        if len(set(paths)) < sum(own):
            raise DataError("the mapping uses a field of the message twice", where=where)
        return paths

    def _block(self, topic: str, signals: list[int], time: FloatArray, value: FloatArray) -> Block:
        vectors = {
            number: value[:, 3 * k : 3 * k + 3] * self.request.signals[number].factors
            for k, number in enumerate(signals)
        }
        return Block(topic, time, vectors)
