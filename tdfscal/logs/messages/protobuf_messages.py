"""Protobuf messages, decoded one by one (extra `[protobuf]`)."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from tdfscal.logs.common.message_path import Named, Path
from tdfscal.logs.messages.encodings import MAX_DEPTH, Leaf, OneByOne, has_axes


class Protobuf(OneByOne):
    """Messages of a type whose definition, a FileDescriptorSet, is recorded with them.

    Raises ValueError where the library is not installed, or the schema does not describe the type.
    """

    def __init__(self, name: str, schema: bytes) -> None:
        try:
            descriptor_pb2, descriptor_pool, message, message_factory = (
                import_module(f"google.protobuf.{module}")
                for module in ("descriptor_pb2", "descriptor_pool", "message", "message_factory")
            )
        except ImportError as error:
            raise ValueError(
                "messages are encoded as 'protobuf', which needs a library that is not installed; "
                'install it with `pip install "tdfscal[protobuf]"`'
            ) from error
        try:
            files = descriptor_pb2.FileDescriptorSet.FromString(schema)
            pool = descriptor_pool.DescriptorPool()
            waiting = {file.name: file for file in files.file}
            while waiting:
                ready = [f for f in waiting.values() if not waiting.keys() & set(f.dependency)]
                if not ready:
                    raise ValueError("its files depend on each other in a circle")
                for file in ready:
                    pool.Add(waiting.pop(file.name))
            self._kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
        except (message.DecodeError, KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"the definition of {name} cannot be read") from error
        self._broken = message.DecodeError

    def decode(self, content: bytes) -> Any:
        """Parse a message."""
        try:
            return self._kind.FromString(content)
        except self._broken as error:
            raise ValueError("it is no message of its type") from error

    def leaves(self, first: bytes) -> Iterator[Leaf]:
        """What there is in messages of the type."""
        yield from _leaves(self._kind.DESCRIPTOR, (), 0)

    def inner(self, node: Any, step: str | int | Named, above: Any) -> Any:
        """As `OneByOne.inner`; a number that is zero is not written, yet it is there."""
        if isinstance(step, str):
            field = getattr(node, "DESCRIPTOR", None) and node.DESCRIPTOR.fields_by_name.get(step)
            there = field is not None and (
                field.message_type is None or field.is_repeated or node.HasField(step)
            )
            return getattr(node, step) if there else None
        if isinstance(step, Named) or not hasattr(node, "__len__") or step >= len(node):
            return None
        return node[step]


def _leaves(descriptor: Any, path: Path, depth: int) -> Iterator[Leaf]:
    if has_axes(descriptor.fields_by_name.keys()):
        yield Leaf.struct(path, str(descriptor.full_name))
        return
    for field in descriptor.fields:
        here = (*path, str(field.name))
        if field.is_repeated or field.message_type is None:
            yield Leaf(here, "list" if field.is_repeated else "value")
        elif depth < MAX_DEPTH:
            yield from _leaves(field.message_type, here, depth + 1)
