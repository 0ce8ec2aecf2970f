"""One pass over the files of a campaign, whatever their format, or over a window of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np

from tdfscal.catalogue.numbers import when
from tdfscal.errors import DataError, RigError, UsageError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.files.saving import fingerprint
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.logs.formats import expand, open_log, unlisted
from tdfscal.logs.log_file import Request, ahead, make_request, placed
from tdfscal.logs.streams import Streams, as_log, files_by_recorder, on_one_clock
from tdfscal.records import BoolArray, Log, Series, by_wall_clock


@record
class Moment:
    """A time in s: on the log's clock or, `after_begin`, from the first sample on.

    dated : given as a date, which the clock must have.
    """

    seconds: float
    after_begin: bool = False
    dated: bool = False

    def __str__(self) -> str:
        """As it is written on the command line."""
        return f"+{self.seconds:.9g} s" if self.after_begin else when(self.seconds)


@record
class TimeWindow:
    """What of a log is used: from `begin` to `end`, both included; None is open."""

    begin: Moment | None = None
    end: Moment | None = None

    def __str__(self) -> str:
        """In words."""
        ends = (("from", self.begin), ("to", self.end))
        return " ".join(f"{word} {moment}" for word, moment in ends if moment is not None)

    def cut(self, pieces: Iterator[Log], where: str) -> Iterator[Log]:
        """Pass the pieces of a log on, with the samples of this part only.

        Raises DataError where no sample lies in it, UsageError for a date that its clock lacks.
        """
        first, last, kept = np.inf, -np.inf, 0
        said: tuple[Finding, ...] = (Finding("log-window", values={"window": str(self)}),)
        for piece in pieces:
            times = [s.time for s in (*piece.position, *piece.force) if s.time.size]
            if times and first == np.inf:
                first = min(float(time[0]) for time in times)
                self._refuse_date(first, where)
            last = max([last, *(float(time[-1]) for time in times)])
            low, high = _at(self.begin, first, -np.inf), _at(self.end, first, np.inf)
            part = piece.with_streams(_between(s, low, high) for s in piece.streams)
            part, said = replace(part, findings=(*said, *part.findings)), ()
            kept += sum(series.time.size for series in part.force)
            yield part
        if not kept:
            raise DataError(
                f"no sample lies {self}; the log runs from {when(first)} to {when(last)}",
                where=where,
                hint="correct --from and --to; a time after the begin of the log is written +90, "
                "+1.5min or +2h",
            )

    def _refuse_date(self, first: float, where: str) -> None:
        """Raise UsageError where an end is a date and the log's clock counts from some start."""
        ends = [end for end in (self.begin, self.end) if end is not None and end.dated]
        if any(by_wall_clock(end.seconds) for end in ends) and not by_wall_clock(first):
            raise UsageError(
                f"the log's clock has no dates: it begins at {when(first)}",
                where=where,
                hint="give s of that clock, or +90 for 90 s after the log's begin",
            )


def _at(moment: Moment | None, first: float, otherwise: float) -> float:
    if moment is None:
        return otherwise
    return moment.seconds + (first if moment.after_begin else 0.0)


def _between(series: Series, low: float, high: float) -> Series:
    begin = np.searchsorted(series.time, low)
    end = np.searchsorted(series.time, high, side="right")
    return Series(series.time[begin:end], series.value[begin:end])


#: Blocks of one recorder, of several, or of the default names.
Recorders = LogBlock | Sequence[LogBlock] | None


def read_log(
    paths: Sequence[Path],
    recorders: Recorders,
    supports: Sequence[str],
    *,
    axes: BoolArray | None = None,
) -> Log:
    """Read recorded logs into memory: `iter_log` put together.

    Parameters
    ----------
    paths : CSV, Parquet or MCAP files, or rosbag2 folders; those of one recorder are in sequence.
    recorders : how each recorder names things; none for the default names, m and N.
    supports : the supports wanted, in the order of the result.
    axes : (n, 3), what their sensors measure; the log need not hold the others, which read 0.

    Returns
    -------
    Log : positions (N, 3) in m, BCS; forces (N, 3) in N on the terminal, sensor frames; all on the
        clock of the first recorder.

    Raises
    ------
    UsageError : a file is not there. RigError : a mapping is wrong.
    DataError : a file is damaged, or is not what the mapping says; recorders do not go together.
    NotIdentifiableError : recorders go together in two ways.
    """
    return concatenate(iter_log(paths, recorders, supports, axes=axes))


def iter_log(
    paths: Sequence[Path],
    recorders: Recorders,
    supports: Sequence[str],
    *,
    axes: BoolArray | None = None,
    window: TimeWindow | None = None,
) -> Iterator[Log]:
    """Read recorded logs as a stream of pieces, in bounded memory.

    Each piece holds the new samples of every stream. A file's entry in `inputs` and its warnings
    come with its last piece. Parameters and errors as `read_log`.

    window : the part of the log that is wanted; files are read, and checked, to their end.
    """
    if not paths:
        raise UsageError("no log is given", hint="name a CSV, Parquet or MCAP file")
    mappings = (recorders,) if isinstance(recorders, LogBlock) else tuple(recorders or ())
    for name in supports:
        held = [one.support_fields(name) for one in mappings]
        if held and not any(own.position or own.force for own in held):
            raise RigError(
                f"the log block names no fields for support {name}",
                where="log.supports",
                hint=f"add {name} with its position and force",
            )
    groups = files_by_recorder(paths, mappings)
    streams = []
    for mapping, own in groups:
        request = make_request(mapping, supports, axes)
        stated = request.mapping
        reading = partial(_campaign, own, request)
        streams.append((str(stated.files), stated.clock.record(), reading))
    pieces = streams[0][-1]() if len(streams) == 1 else on_one_clock(streams)
    yield from pieces if window is None else window.cut(pieces, ", ".join(map(str, paths)))


def concatenate(pieces: Iterable[Log]) -> Log:
    """Put the pieces of one campaign together."""
    parts = list(pieces)

    def joined(*streams: Series) -> Series:
        times, values = [s.time for s in streams], [s.value for s in streams]
        return Series(np.concatenate(times), np.concatenate(values))

    return replace(
        parts[0].with_streams(map(joined, *(p.streams for p in parts))),
        inputs=tuple(i for p in parts for i in p.inputs),
        findings=tuple(f for p in parts for f in p.findings),
        clocks=tuple(c for p in parts for c in p.clocks),
    )


def _campaign(given: Sequence[Path], request: Request) -> Iterator[Log]:
    """Read the files of one recorder, one after the other."""
    paths = expand(given)
    try:
        yield from _in_turn(paths, request, unlisted(given))
    except DataError as error:
        raise _with_cure(error, request, alone=len(paths) == 1) from None


def _in_turn(paths: Sequence[Path], request: Request, doubts: list[Finding]) -> Iterator[Log]:
    """The logs of files in their order; doubts : said with the first."""
    reached = np.full(len(request.signals), -np.inf)
    row = 0
    for path in _in_sequence(paths, request) if len(paths) > 1 else paths:
        streams = Streams(request, reached, row)
        file = open_log(path)
        pending = as_log((), request)
        with (
            placed(path),
            fingerprint(path) as described,
            closing(ahead(file.pieces(request))) as pieces,
        ):
            for number, piece in enumerate(pieces):
                ascending = streams.passed(piece)
                if number:
                    yield pending
                pending = as_log(ascending, request)
            said = streams.findings(file)
            entry = described(file.integrity)
        reached = streams.last
        row += int(streams.count[0])
        found = [*doubts, *(replace(f, values={**f.values, "file": str(path)}) for f in said)]
        yield replace(pending, inputs=(entry,), findings=tuple(found))
        doubts = []


def _in_sequence(paths: Sequence[Path], request: Request) -> list[Path]:
    """Order the files by their first time."""
    starts: dict[Path, float] = {}
    untimed = 0
    for path in paths:
        with closing(open_log(path).pieces(request)) as stream:
            piece = next((piece for piece in stream if any(b.time.size for b in piece)), ())
        untimed += any(block.clock == "row" for block in piece)
        starts[path] = min((float(b.time[0]) for b in piece if b.time.size), default=np.inf)
    if untimed == len(paths):
        return list(paths)
    if untimed:
        raise DataError(
            "some of the logs have a time column and some have none",
            where=", ".join(map(str, paths)),
            hint="calibrate from logs of one kind",
        )
    return sorted(paths, key=lambda path: starts[path])


def _with_cure(error: DataError, request: Request, *, alone: bool) -> DataError:
    """The error with what to do where fields hold no number; alone : the log's only file."""
    for signal in request.signals:
        whole = len(signal.fields) == 1 and signal.fields[0] in error.fields
        gone = {name for name in signal.own if whole or name in error.fields}
        if gone and signal.quantity == "force" and alone:
            each = zip("xyz", signal.components, signal.measured, strict=True)
            left = [axis for axis, name, there in each if there and name not in gone]
            line = f"`axes: [{', '.join(left)}]` for {signal.support} in rig.yaml"
            cure = f"where the sensor does not measure it, write {line}"
            return error.restated(hint="; ".join(filter(None, [error.hint, cure])))
    return error
