"""One log file while it is read: the class of which each format has its own, and its faults."""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Final, TypeVar, cast

from tdfscal.errors import DataError, UsageError, is_short, shortage
from tdfscal.files.yaml import shorten
from tdfscal.findings import Finding
from tdfscal.logs.request import Piece, Request
from tdfscal.records import Integrity

if TYPE_CHECKING:
    from tdfscal.logs.contents import Contents

AGAIN: Final = "record or copy it again"
EMPTY: Final = "leave the file out, or record the log again"
"""What to do about a file of which nothing is whole."""
_SHORTEST: Final = 8  # bytes; no log has fewer
LIBRARY_FAULTS: Final = (OSError, EOFError, ValueError, OverflowError, struct.error)
"""What libraries raise on bytes that are not what they should be."""

Given = TypeVar("Given")
Item = TypeVar("Item")
_END: Final = object()


class LogFile(ABC):
    """A file of one format while it is read; what is whole of one that was cut short is read.

    faults : what its library raises on damage. mark, kind : with which its file begins, and what
    it then is. Known at its end: integrity, how far checksums cover what was read; findings, what
    else is to be said; cut_at, the byte at which a file that was cut short stops being whole, None
    of a whole one.
    """

    faults: ClassVar[tuple[type[Exception], ...]] = ()
    mark: ClassVar[bytes] = b""
    kind: ClassVar[str]

    def __init__(self, path: Path) -> None:
        self.path = path
        self.integrity: Integrity = "unverified"
        self.findings: list[Finding] = []
        self.cut_at: int | None = None

    def pieces(self, request: Request) -> Generator[Piece, None, None]:
        """Yield what is wanted, in pieces of bounded size.

        Raises DataError on whatever is wrong within, with its place; UsageError where the file
        cannot be opened.
        """
        with self._opened():
            yield from self.read(request)

    def contents(self) -> Contents:
        """Look through the file, whatever is wanted of it; raises as `pieces`."""
        with self._opened():
            return self.look()

    @contextmanager
    def _opened(self) -> Iterator[None]:
        """Refuse what holds nothing or is no file of the format; damage within has its place."""
        with placed(self.path), damage(self.path, *self.faults):
            with self.path.open("rb") as file:
                opening = file.read(max(len(self.mark), _SHORTEST))
            if len(opening) < max(len(self.mark), _SHORTEST):
                if not opening.strip():
                    raise DataError("the file is empty", hint=AGAIN)
                count = "1 byte" if len(opening) == 1 else f"{len(opening)} bytes"
                raise DataError(f"the file ends after {count}: it was cut short", hint=AGAIN)
            if not opening.startswith(self.mark):
                raise DataError(
                    f"the file is no {self.kind}: it does not begin as one",
                    hint="copy it again; where it is compressed as a whole, decompress it first",
                )
            yield

    @abstractmethod
    def read(self, request: Request) -> Iterator[Piece]:
        """Yield what is wanted, as it comes."""

    @abstractmethod
    def look(self) -> Contents:
        """Its fields, with samples of their values."""


@contextmanager
def placed(whole: Path | str) -> Iterator[None]:
    """Put a file, or a part of it, before the place that a DataError states within it."""
    try:
        yield
    except DataError as error:
        if (error.where or "").startswith(str(whole)):
            raise
        where = f"{whole}, {error.where}" if error.where else str(whole)
        raise error.restated(where=where) from error


@contextmanager
def damage(path: Path, *kinds: type[Exception]) -> Iterator[None]:
    """Turn what libraries and the operating system raise on a damaged file into a DataError.

    kinds : the library's own exceptions. Raises MemoryShortError where the memory does not suffice,
    UsageError where the file is not there, or not to be read by this user.
    """
    doubtful: tuple[type[Exception], ...] = (*kinds, *LIBRARY_FAULTS, MemoryError)
    try:
        yield
    except (FileNotFoundError, IsADirectoryError, PermissionError) as error:
        why = error.strerror or str(error)
        raise UsageError(f"the file cannot be opened ({why})", where=str(path)) from error
    except doubtful as error:
        if is_short(error):
            raise shortage() from error
        what = f"the file is damaged ({reason(error)})"
        raise DataError(what, hint="copy it from the recorder again") from error


def reason(error: BaseException) -> str:
    """Say in plain words what is wrong: libraries speak of their codecs, protocols and types."""
    if isinstance(error, UnicodeDecodeError):
        return "a text in it is not UTF-8"
    if isinstance(error, struct.error | EOFError):
        return "it ends too early"
    if isinstance(error, OverflowError):
        return "a number in it is too large"
    if isinstance(error, OSError) and error.errno is not None:
        return error.strerror or "it cannot be read"
    if type(error) is ValueError:  # ours, but for a few
        return shorten(" ".join(str(error).split()).rstrip("."), 160)
    return "its content cannot be decoded"


def mapped(
    function: Callable[[Given], Item], given: Iterable[Given], workers: int
) -> Generator[Item, None, None]:
    """The results in order, each computed in one of the threads; few wait to be taken.

    What `function` or `given` raises is raised here in its turn. Closing it ends the threads.
    """
    waiting: deque[Future[Item]] = deque()
    pool = ThreadPoolExecutor(workers, thread_name_prefix="ahead")
    try:
        for one in given:
            waiting.append(pool.submit(function, one))
            if len(waiting) > workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def ahead(stream: Generator[Item, None, None]) -> Generator[Item, None, None]:
    """The same stream, computed in a thread of its own."""
    with ThreadPoolExecutor(1, thread_name_prefix="ahead") as pool, closing(stream):
        waiting = pool.submit(next, stream, _END)
        try:
            while (item := waiting.result()) is not _END:
                waiting = pool.submit(next, stream, _END)
                yield cast(Item, item)
        finally:
            pool.shutdown(wait=True)  # before the stream is closed
