"""What identifies an input file in a result: its SHA-256, size and integrity."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tdfscal.errors import DataError, UsageError
from tdfscal.records import InputFile, Integrity

_BLOCK = 1 << 22


def input_file(path: Path, integrity: Integrity) -> InputFile:
    """Describe a file by its content, read in blocks.

    path : the file; its text goes into the record as it was given. integrity : how far the reader
    could check the content.

    Raises UsageError where the file is not there or cannot be opened.
    """
    with fingerprint(path) as described:
        return described(integrity)


def printable(text: str) -> str:
    r"""A file's name need not be UTF-8, what is written of it must: other bytes become \\xNN."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def content_sha256(content: Mapping[str, Any]) -> str:
    """SHA-256 of a document's values, whatever their order and notation.

    It is that of the document as Python's JSON in UTF-8, its keys sorted, those that are null left
    out at any depth. content : plain JSON values.
    """
    text = json.dumps(_without_nulls(content), sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _without_nulls(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nulls(each) for key, each in value.items() if each is not None}
    if not isinstance(value, list) or set(map(type, value)) <= {float, str}:
        return value
    return [_without_nulls(each) for each in value]


@contextmanager
def fingerprint(path: Path) -> Iterator[Callable[[Integrity], InputFile]]:
    """Compute a file's digest in a thread, beside its reading.

    The function given waits for it and returns the record; leaving early abandons it.
    """
    stop = threading.Event()
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="sha256") as pool:
        digest = pool.submit(_sha256, path, stop.is_set)
        try:
            yield lambda integrity: InputFile(printable(str(path)), *digest.result(), integrity)
        finally:
            stop.set()


def _sha256(path: Path, stopped: Callable[[], bool]) -> tuple[str, int]:
    digest = hashlib.sha256()
    block = bytearray(_BLOCK)
    size = 0
    try:
        with path.open("rb", buffering=0) as stream:
            while not stopped() and (count := stream.readinto(block)):
                digest.update(memoryview(block)[:count])
                size += count
    except (FileNotFoundError, IsADirectoryError, PermissionError) as error:
        raise UsageError(
            f"the file cannot be opened ({error.strerror})", where=str(path)
        ) from error
    except OSError as error:
        raise DataError(f"the file cannot be read ({error.strerror})", where=str(path)) from error
    return digest.hexdigest(), size
