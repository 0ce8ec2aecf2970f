"""What is wanted of a log, the file that gives it (each format has its class), and its faults."""

from __future__ import annotations

import difflib
import struct
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Final, Literal, TypeVar, cast

import numpy as np

from tdfscal.errors import DataError, UsageError, is_short, shortage
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.files.yaml import shorten
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.records import BoolArray, FloatArray, Integrity

if TYPE_CHECKING:
    from tdfscal.logs.contents import Contents


AGAIN: Final = "record or copy it again"
EMPTY: Final = "leave the file out, or record the log again"
"""What to do about a file of which nothing is whole."""
_SHORTEST: Final = 8  # bytes; no log has fewer
_DOCUMENTS = (b"<html", b"<!doc", b"<?xml", b'{"', b"{\n")
LIBRARY_FAULTS: Final = (OSError, EOFError, ValueError, OverflowError, struct.error)
"""What libraries raise on bytes that are not what they should be."""

Given = TypeVar("Given")
Item = TypeVar("Item")
_END: Final = object()


@record
class Signal:
    """One vector signal of one support, as the file has it.

    fields : three names, or one that has the members x, y, z; of a temperature, one name thrice.
    factors : of x, y, z, from the file's unit and sign to SI and tdfscal's sign.
    unit : of the file; None where the mapping states factors in its place.
    measured : which of x, y, z there are; where one is not, the field named is another that is read
        anyway, and its values mean nothing.
    """

    support: str
    quantity: Literal["position", "force", "temperature"]
    fields: tuple[str, ...]
    factors: tuple[float, float, float]
    unit: str | None = None
    measured: tuple[bool, bool, bool] = (True, True, True)

    @property
    def components(self) -> tuple[str, ...]:
        """The three fields by name."""
        if len(self.fields) == 1:
            return tuple(f"{self.fields[0]}.{axis}" for axis in "xyz")
        return self.fields

    @property
    def own(self) -> tuple[str, ...]:
        """Fields that are measured, each once."""
        pairs = zip(self.components, self.measured, strict=True)
        return tuple(dict.fromkeys(name for name, there in pairs if there))

    def lacking(self, axes: BoolArray, instead: Signal) -> Signal:
        """The signal without axes: what is not measured is read from what is there instead."""
        x, y, z = (bool(axis) for axis in axes)
        there = self.components
        if len(there) == len(axes):  # else those that are measured alone are named
            there = tuple(name for name, axis in zip(there, axes, strict=True) if axis)
        names, other = iter(there), (there or instead.components)[0]
        fields = tuple(next(names) if axis else other for axis in axes)
        return replace(self, fields=fields, measured=(x, y, z))


@record
class Request:
    """What is wanted of the files of one recorder.

    numbers : of each signal: 2i the position of support i, 2i + 1 its force; those of the
    temperatures, one or one per support, come last, from 2n on.
    declared : the rig has a `log` block; without one, a unit that the file names is honoured.
    """

    supports: tuple[str, ...]
    signals: tuple[Signal, ...]
    numbers: tuple[int, ...]
    mapping: LogBlock
    declared: bool


@record
class Block:
    """New samples of the signals that share one clock.

    clock : what the clock is called in messages: a column or a topic.
    time : (N,), s, as recorded: not yet checked to ascend.
    value : signal's number → (N, 3), SI, tdfscal's sign, finite.
    """

    clock: str
    time: FloatArray
    value: Mapping[int, FloatArray]

    def at(self, rows: slice | BoolArray) -> Block:
        """Some of the samples."""
        return Block(self.clock, self.time[rows], {s: v[rows] for s, v in self.value.items()})


Piece = tuple[Block, ...]


def make_request(
    mapping: LogBlock | None, supports: Sequence[str], axes: BoolArray | None = None
) -> Request:
    """Resolve the mapping, or the default field names, for the supports wanted.

    axes : (n, 3), what their sensors measure; no field of another axis is looked at.
    """
    declared, mapping = mapping is not None, mapping or LogBlock()
    signals: dict[int, Signal] = {}
    for number, name in enumerate(supports):
        fields = mapping.support_fields(name)
        position, force = fields.position or (), fields.force or ()
        measured = np.ones(3, dtype=np.bool_) if axes is None else axes[number]
        moves = signal_of(mapping, "position", name, position)
        # Without a sensor it reads 0, at the times of the positions.
        loads = signal_of(mapping, "force", name, force if measured.any() else position)
        if moves.fields:
            signals[2 * number] = moves
        if loads.fields:
            whole = bool(measured.all())
            signals[2 * number + 1] = loads if whole else loads.lacking(measured, moves)
    warm = mapping.temperature or ()
    for k, (field, owner) in enumerate(zip(warm, supports, strict=False)):
        name = owner if len(warm) > 1 else "the rig"
        signals[2 * len(supports) + k] = Signal(name, "temperature", (field,) * 3, (1.0,) * 3)
    return Request(tuple(supports), tuple(signals.values()), tuple(signals), mapping, declared)


def signal_of(
    mapping: LogBlock,
    quantity: Literal["position", "force"],
    support: str,
    fields: tuple[str, ...],
) -> Signal:
    """The signal of a support, with factors where the mapping states them in place of its unit."""
    (x, y, z), unit = mapping.scale(quantity, support)
    sign = -1.0 if quantity == "force" and mapping.force_on == "sensor" else 1.0
    return Signal(support, quantity, fields, (sign * x, sign * y, sign * z), unit)


def missing_fields(missing: Sequence[str], present: Iterable[str], *, kind: str) -> DataError:
    """Build the error for fields that a file does not have, with the nearest names it has."""
    names = list(dict.fromkeys(map(shorten, filter(None, present))))
    shown = ", ".join(missing[:4]) + (f" and {len(missing) - 4} more" if len(missing) > 4 else "")
    near = list(dict.fromkeys(n for m in missing[:4] for n in _nearest(m, names)))
    if near:
        nearest = f"the nearest that it has: {', '.join(near[:6])}"
    elif names:
        nearest = f"it has {', '.join(names[:8])}{', …' if len(names) > 8 else ''}"
    else:
        nearest = "it has none"
    return DataError(
        f"no {kind} {shown}; {nearest}",
        hint="name the fields in the log block of rig.yaml as the recorder names them; where two "
        "recorders wrote them apart, `log` is a list, a block for each recorder, as `tdfscal init` "
        "writes it of both recorders' files together",
    )


def _nearest(name: str, names: list[str]) -> list[str]:
    """Names like it; of a list of that very name, its elements."""
    elements = [n for n in names if n.startswith(f"{name}[")]
    cases = {n.lower(): n for n in names}
    return elements or [cases[n] for n in difflib.get_close_matches(name.lower(), list(cases))]


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
            if not opening.strip():
                raise DataError("the file is empty", hint=AGAIN)
            if opening.lstrip().lower().startswith(_DOCUMENTS):
                what = "the file is a page (HTML, XML) or a JSON document, not a recording"
                raise DataError(what, hint="see what was downloaded or exported there")
            if len(opening) < max(len(self.mark), _SHORTEST):
                raise DataError("the file was cut short in its first bytes", hint=AGAIN)
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
    results = mapped(lambda _: next(stream, _END), repeat(None), 1)
    with closing(stream), closing(results):  # the thread ends before the stream is closed
        while (item := next(results)) is not _END:
            yield cast(Item, item)
