"""Protobuf messages: the wanted numbers, message by message (extra `[protobuf]`)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from importlib import import_module
from typing import Any, Final

from tdfscal.errors import DataError
from tdfscal.logs.common.message_path import Named, Path
from tdfscal.logs.messages.decoded import ReadNumbers, read_rows

_MAX_DEPTH: Final = 8


def message_class(name: str, schema: bytes, where: str | None = None) -> Any:
    """Build the class of a message from the schema recorded with it, a FileDescriptorSet.

    Raises
    ------
    DataError : the extra is not installed.
    ValueError : the schema does not describe the message.
    """
    try:
        descriptor_pb2, descriptor_pool, message, message_factory = (
            import_module(f"google.protobuf.{name}")
            for name in ("descriptor_pb2", "descriptor_pool", "message", "message_factory")
        )
    except ImportError as error:
        raise DataError(
            "messages are encoded as 'protobuf', which needs a library that is not installed",
            where=where,
            hint='install it with `pip install "tdfscal[protobuf]"`',
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
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    except (message.DecodeError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"the definition of {name} cannot be read") from error


def leaves(kind: Any) -> Iterator[tuple[Path, str, bool]]:
    """Walk a message class: (path, type, whether it has x, y, z) of each field."""
    yield from _leaves(kind.DESCRIPTOR, (), 0)


def _leaves(descriptor: Any, path: Path, depth: int) -> Iterator[tuple[Path, str, bool]]:
    names = set(descriptor.fields_by_name)
    if {"x", "y", "z"} <= names and "w" not in names:
        yield path, str(descriptor.full_name), True
        return
    for field in descriptor.fields:
        here = (*path, str(field.name))
        if field.is_repeated:
            yield here, "list", False
        elif field.message_type is None:
            yield here, "value", False
        elif depth < _MAX_DEPTH:
            yield from _leaves(field.message_type, here, depth + 1)


def reader_of(kind: Any) -> ReadNumbers:
    """Return what reads the messages of a class."""
    broken = import_module("google.protobuf.message").DecodeError

    def decode(content: bytes) -> Any:
        try:
            return kind.FromString(content)
        except broken as error:
            raise ValueError("it is no message of its type") from error

    return partial(read_rows, decode=decode, inner=_inner)


def _inner(node: Any, step: str | int | Named, above: Any) -> Any:
    if isinstance(step, str):
        field = getattr(node, "DESCRIPTOR", None) and node.DESCRIPTOR.fields_by_name.get(step)
        # A number that is zero is not written; a message that is not there is missing.
        there = field is not None and (
            field.message_type is None or field.is_repeated or node.HasField(step)
        )
        return getattr(node, step) if there else None
    if isinstance(step, Named) or not hasattr(node, "__len__") or step >= len(node):
        return None
    return node[step]
