"""One pass over the files of a campaign, whatever their format."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tdfscal.checks.faulty_sensors import check_unmeasured
from tdfscal.errors import DataError, RigError, UsageError
from tdfscal.files.hashing import Fingerprint, note_outside
from tdfscal.findings import Finding
from tdfscal.logs.bag.rosbag2 import METADATA, Bag
from tdfscal.logs.common.clock import Clock, apart, shown
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.common.damage import placed
from tdfscal.logs.common.lone_readings import LoneReadings
from tdfscal.logs.common.read_ahead import ahead
from tdfscal.logs.common.request import (
    Block,
    Outcome,
    Piece,
    Request,
    make_request,
    without_axis,
)
from tdfscal.logs.common.window import TimeWindow
from tdfscal.logs.formats import files_of, reader_of
from tdfscal.logs.recorders import files_by_recorder, on_one_clock
from tdfscal.records import BoolArray, FloatArray, Log, LogMapping, LogTruncated, Series

Progress = Callable[[float], None]
#: Largest magnitudes that are read, by quantity.
_LARGEST = {"position": (1e9, "m"), "force": (1e9, "N"), "temperature": (1e4, "°C")}
_NO_TIME, _NO_VALUE = np.empty(0), np.empty((0, 3))


#: Mappings of one recorder, of several, or of the default names.
Recorders = LogMapping | Sequence[LogMapping] | None


def read_log(
    paths: Sequence[Path],
    recorders: Recorders,
    supports: Sequence[str],
    *,
    axes: BoolArray | None = None,
    window: TimeWindow | None = None,
) -> Log:
    """Read recorded logs into memory: `iter_log` put together.

    Parameters
    ----------
    paths : CSV, Parquet or MCAP files, or rosbag2 folders; those of one recorder are in sequence.
    recorders : how each recorder names things; none for the default names, m and N.
    supports : the supports wanted, in the order of the result.
    axes : (n, 3), what their sensors measure; the log need not hold the others, which read 0.
    window : the part of the log that is wanted.

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
    return concatenate(iter_log(paths, recorders, supports, axes=axes, window=window))


def iter_log(
    paths: Sequence[Path],
    recorders: Recorders,
    supports: Sequence[str],
    *,
    axes: BoolArray | None = None,
    window: TimeWindow | None = None,
    progress: Progress | None = None,
    seen: dict[Path, Contents] | None = None,
) -> Iterator[Log]:
    """Read recorded logs as a stream of pieces, in bounded memory.

    Each piece holds the new samples of every stream, about 64 k samples or less. A file's entry
    in `inputs` and its warnings come with its last piece. Parameters and errors as `read_log`.

    window : the part of the log that is wanted; files are read, and checked, to their end.
    progress : told the share of all bytes that is read, from 0 to 1, not descending.
    seen : takes what else is in each file, noted while it is read.
    """
    if not paths:
        raise UsageError("no log is given", hint="name a CSV, Parquet or MCAP file")
    mappings = (recorders,) if isinstance(recorders, LogMapping) else tuple(recorders or ())
    groups: Sequence[tuple[LogMapping | None, Sequence[Path]]] = [(None, paths)]
    if mappings:
        groups = files_by_recorder(paths, mappings)
    sources = [(mapping, files_of(own)) for mapping, own in groups]
    meter = _Meter(sum(path.stat().st_size for _, files in sources for path, _ in files), progress)
    streams = []
    for mapping, files in sources:
        request = replace(make_request(mapping, supports, axes), describe=seen is not None)
        if axes is not None and not axes.all():
            _check_silent(files[0][0], make_request(mapping, supports), axes)
        streams.append((request.mapping, _campaign(files, request, meter, seen)))
    pieces = streams[0][1] if len(streams) == 1 else on_one_clock(streams)
    yield from pieces if window is None else window.cut(pieces, ", ".join(map(str, paths)))


def concatenate(pieces: Iterable[Log]) -> Log:
    """Put the pieces of one campaign together."""
    parts = list(pieces)

    def joined(*streams: Series) -> Series:
        times, values = [s.time for s in streams], [s.value for s in streams]
        return Series(np.concatenate(times), np.concatenate(values))

    return replace(
        parts[0],
        position=tuple(map(joined, *(p.position for p in parts))),
        force=tuple(map(joined, *(p.force for p in parts))),
        temperature=tuple(map(joined, *(p.temperature for p in parts))),
        inputs=tuple(i for p in parts for i in p.inputs),
        truncated=tuple(t for p in parts for t in p.truncated),
        findings=tuple(f for p in parts for f in p.findings),
        clocks=tuple(c for p in parts for c in p.clocks),
    )


@dataclass(slots=True)
class _Meter:
    """Bytes read of all files together; before: those of the files that are done."""

    total: int
    progress: Progress | None
    before: int = 0
    position: int = 0

    def reached(self, position: int) -> None:
        """Note how far the file at hand is read; from any thread."""
        self.position = position

    def tell(self) -> None:
        """Tell what is noted."""
        if self.progress is not None:
            self.progress(min((self.before + self.position) / max(self.total, 1), 1.0))


def _campaign(
    files: Sequence[tuple[Path, Bag | None]],
    request: Request,
    meter: _Meter,
    seen: dict[Path, Contents] | None,
) -> Iterator[Log]:
    reached = np.full(len(request.signals), -np.inf)
    row = 0
    bags = dict(files)
    for path in _in_sequence([path for path, _ in files], request):
        bag = bags[path]
        streams = _Streams(request, reached, row)
        reader = reader_of(path, request, bag)
        pieces = reader(path, request, reached=meter.reached)
        pending: Log | None = None
        with (
            placed(path),
            Fingerprint(path) as fingerprint,
            closing(ahead(pieces)) as stream,
        ):
            outcome = Outcome("unverified")
            try:
                for item in stream:
                    if isinstance(item, Outcome):
                        outcome = item
                        continue
                    meter.tell()
                    ascending = streams.passed(item)
                    if pending is not None:
                        yield pending
                    pending = _log(ascending, request)
            except DataError as error:
                raise without_axis(error, request) from error
            said = streams.findings(outcome)
            note = None if bag is None else note_outside(path, bag.folder, METADATA)
            entry = fingerprint.result(outcome.integrity, note)
        if seen is not None and outcome.contents is not None:
            seen[path] = outcome.contents
        reached = streams.last
        row += int(streams.count[0])
        meter.before, meter.position = meter.before + entry.bytes, 0
        meter.tell()
        cut: tuple[LogTruncated, ...] = ()
        if outcome.cut_at is not None:
            cut = (LogTruncated(str(path), outcome.cut_at, float(streams.last.max())),)
            said = [truncation(cut[0]), *said]
        told = tuple(replace(f, values={**f.values, "file": str(path)}) for f in said)
        last = pending or _log((), request)
        yield replace(last, inputs=(entry,), findings=told, truncated=cut)


def truncation(cut: LogTruncated) -> Finding:
    """Say where a log ends that was cut short."""
    return Finding("log-truncated", values={"byte": cut.byte, "at": shown(cut.end)})


def _opening(path: Path, request: Request) -> Generator[Piece, None, None]:
    """The pieces of a file, of which the first few are taken."""
    items = reader_of(path, request)(path, request, reached=lambda _: None)
    with placed(path), closing(items):
        for item in items:
            if not isinstance(item, Outcome):
                yield item


def _check_silent(path: Path, whole: Request, axes: BoolArray) -> None:
    """Refuse a log whose beginning shows that an axis follows the load, measured or not."""
    try:
        with closing(_opening(path, whole)) as stream:
            log = _log(next(stream, ()), whole)
    except (DataError, RigError):  # such fields are not there, or hold no numbers
        return
    if min(len(force.time) for force in log.force) > 1:
        readings = [force.value for force in log.force]
        check_unmeasured(
            log.supports,
            axes,
            scatter=np.array([value.std(axis=0) for value in readings]),
            noise=np.array([np.diff(value, axis=0).std(axis=0) / np.sqrt(2) for value in readings])
            if whole.mapping.rows == "timeseries"
            else np.zeros(axes.shape),
        )


def _in_sequence(paths: Sequence[Path], request: Request) -> list[Path]:
    """Order the files by their first time."""
    if len(paths) == 1:
        return list(paths)
    starts: dict[Path, float] = {}
    untimed = 0
    for path in paths:
        starts[path] = np.inf
        with closing(_opening(path, request)) as stream:
            for piece in stream:
                untimed += any(block.clock == "row" for block in piece)
                times = [float(block.time[0]) for block in piece if block.time.size]
                if times:
                    starts[path] = min(times)
                    break
    if untimed == len(paths):
        return list(paths)
    if untimed:
        raise DataError(
            "some of the logs have a time column and some have none",
            where=", ".join(map(str, paths)),
            hint="calibrate from logs of one kind",
        )
    return sorted(paths, key=lambda path: starts[path])


class _Streams:
    """The streams of one file as their pieces pass.

    reached : s, per signal, where the file before ended. row : rows of the files before.
    last : s, per signal, the latest time. count : samples of each signal.
    """

    def __init__(self, request: Request, reached: FloatArray, row: int) -> None:
        self._request, self._reached, self._row = request, reached, row
        self._clocks: dict[str, Clock] = {}
        self._lone = {
            number: LoneReadings(signal)
            for number, signal in enumerate(request.signals)
            if signal.quantity != "temperature" and request.mapping.rows == "timeseries"
        }
        self.last = reached.copy()
        self.count = np.zeros(len(reached), dtype=np.int64)

    def passed(self, piece: Piece) -> list[Block]:
        """Leave out the samples that do not ascend; refuse what cannot be."""
        blocks = [part for block in piece for part in self._parted(self._ascending(block))]
        for block in blocks:
            self._check_size(block)
            for number in block.value:
                self.count[number] += block.time.size
                if block.time.size:
                    self.last[number] = block.time[-1]
        return blocks

    def _ascending(self, block: Block) -> Block:
        if block.clock == "row" and self._row:  # without a time, rows count on over the files
            block = replace(block, time=block.time + self._row)
        if block.clock not in self._clocks:
            before = max(float(self._reached[number]) for number in block.value)
            self._clocks[block.clock] = Clock(block.clock, self._request.mapping.rows, before)
            if block.time.size and block.time[0] < before:
                raise DataError(
                    f"{block.clock} starts at {shown(block.time[0])} s, before the end of another "
                    f"log at {shown(before)} s",
                    hint="logs of one campaign follow each other; leave out the one that overlaps",
                )
        keep = self._clocks[block.clock].ascending(block.time)
        return block if keep is None else block.at(keep)

    def _parted(self, block: Block) -> Iterator[Block]:
        """The block; signals of which a reading stands alone by themselves, without that."""
        together = dict(block.value)
        for number, value in block.value.items():
            lone = self._lone.get(number)
            keep = None if lone is None else lone.others(block.time, value)
            if keep is not None:
                own = {number: together.pop(number)}
                yield Block(block.clock, block.time, own).at(keep)
        if together:
            yield Block(block.clock, block.time, together)

    def _check_size(self, block: Block) -> None:
        """Refuse what no NCP reaches and no sensor bears; sums of it would overflow."""
        for number, value in block.value.items():
            signal = self._request.signals[number]
            limit, unit = _LARGEST[signal.quantity]
            if not value.size or (value.max() <= limit and value.min() >= -limit):
                continue
            over = np.flatnonzero(np.abs(value).max(axis=1) > limit)
            if over.size:
                raise DataError(
                    f"the {signal.quantity} of {signal.support} is "
                    f"{np.abs(value[over[0]]).max():.3g} {unit} at {shown(block.time[over[0]])} s",
                    hint=f"check the recorder, and the units of the log block; {limit:g} {unit} is "
                    "the largest value read",
                )

    def findings(self, outcome: Outcome) -> list[Finding]:
        """What is to be said at the file's end; refuses a file that lacks a signal."""
        clocks = tuple(self._clocks.values())
        said = [*outcome.findings, *(f for clock in clocks for f in clock.finish()), *apart(clocks)]
        said += [what for lone in self._lone.values() for what in lone.findings()]
        for signal, count in zip(self._request.signals, self.count, strict=True):
            if count:
                continue
            fields = ", ".join(dict.fromkeys(signal.fields))
            what = f"there is no sample of the {signal.quantity} of {signal.support} ({fields})"
            if outcome.cut_at is not None:
                what += f" before byte {outcome.cut_at}, where the file was cut short"
            raise DataError(what)
        return said


def _log(piece: Piece | list[Block], request: Request) -> Log:
    n = len(request.supports)
    series = [Series(_NO_TIME, _NO_VALUE)] * (2 * n + len(request.mapping.temperature))
    for block in piece:
        for index, value in block.value.items():
            measured = request.signals[index].measured
            series[request.numbers[index]] = Series(
                block.time, value if all(measured) else np.where(measured, value, 0.0)
            )
    return Log(
        supports=request.supports,
        position=tuple(series[0 : 2 * n : 2]),
        force=tuple(series[1 : 2 * n : 2]),
        temperature=tuple(series[2 * n :]),
        rows=request.mapping.rows,
    )
