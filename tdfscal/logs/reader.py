"""One pass over the files of a campaign, whatever their format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np

from tdfscal.checks.faulty_sensors import check_unmeasured
from tdfscal.errors import DataError, RigError, UsageError
from tdfscal.files.hashing import fingerprint
from tdfscal.frozen import replace
from tdfscal.logs.formats import expand, files_of, open_log
from tdfscal.logs.log_file import ahead, placed
from tdfscal.logs.recorders import files_by_recorder, on_one_clock
from tdfscal.logs.request import Request, make_request, with_cure
from tdfscal.logs.streams import Streams, as_log
from tdfscal.logs.window import TimeWindow
from tdfscal.records import BoolArray, Log, LogMapping, Series

Progress = Callable[[float], None]
#: Mappings of one recorder, of several, or of the default names.
Recorders = LogMapping | Sequence[LogMapping] | None


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
    progress: Progress | None = None,
) -> Iterator[Log]:
    """Read recorded logs as a stream of pieces, in bounded memory.

    Each piece holds the new samples of every stream. A file's entry in `inputs` and its warnings
    come with its last piece. Parameters and errors as `read_log`.

    window : the part of the log that is wanted; files are read, and checked, to their end.
    progress : told the share of all bytes that is read, from 0 to 1, not descending.
    """
    if not paths:
        raise UsageError("no log is given", hint="name a CSV, Parquet or MCAP file")
    mappings = (recorders,) if isinstance(recorders, LogMapping) else tuple(recorders or ())
    groups = files_by_recorder(paths, mappings)
    sizes = [path.stat().st_size for _, own in groups for path in expand(own)]
    total = max(sum(sizes), 1) * (1 if len(groups) == 1 else 2)  # several are read twice
    before = 0

    def reached(position: int, whole: int = 0) -> None:
        """Tell how far the file at hand is read, or that it is and how long it was."""
        nonlocal before
        before += whole
        if progress is not None:
            progress(min((before + position) / total, 1.0))

    streams = []
    for mapping, own in groups:
        request = make_request(mapping, supports, axes)
        if axes is not None and not axes.all():
            _check_silent(expand(own)[0], make_request(mapping, supports), axes)
        streams.append((request.mapping, partial(_campaign, own, request, reached)))
    pieces = streams[0][1]() if len(streams) == 1 else on_one_clock(streams)
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
        findings=tuple(f for p in parts for f in p.findings),
        clocks=tuple(c for p in parts for c in p.clocks),
    )


def _campaign(given: Sequence[Path], request: Request, told: Callable[..., None]) -> Iterator[Log]:
    """Read the files of one recorder, one after the other; told : how far."""
    reached = np.full(len(request.signals), -np.inf)
    row = 0
    bags = files_of(given)
    for path in _in_sequence([*bags], request) if len(bags) > 1 else bags:
        streams = Streams(request, reached, row)
        file = open_log(path, bags[path])
        pending = as_log((), request)
        with fingerprint(path) as described, closing(ahead(file.pieces(request))) as pieces:
            try:
                for number, piece in enumerate(pieces):
                    told(file.position)
                    ascending = streams.passed(piece)
                    if number:
                        yield pending
                    pending = as_log(ascending, request)
                said = streams.findings(file)
            except DataError as error:
                with placed(path):
                    raise with_cure(error, request) from error
            entry = described(file.integrity)
        reached = streams.last
        row += int(streams.count[0])
        told(0, entry.bytes)
        findings = tuple(replace(f, values={**f.values, "file": str(path)}) for f in said)
        yield replace(pending, inputs=(entry,), findings=findings)


def _check_silent(path: Path, whole: Request, axes: BoolArray) -> None:
    """Refuse a log whose beginning shows that an axis follows the load, measured or not."""
    try:
        with closing(open_log(path).pieces(whole)) as stream:
            log = as_log(next(stream, ()), whole)
    except (DataError, RigError):  # such fields are not there, or hold no numbers
        return
    if min(len(force.time) for force in log.force) > 1:
        readings = [force.value for force in log.force]
        steps = [np.diff(value, axis=0).std(axis=0) / np.sqrt(2) for value in readings]
        series = whole.mapping.rows == "timeseries"
        check_unmeasured(
            log.supports,
            axes,
            scatter=np.array([value.std(axis=0) for value in readings]),
            noise=np.array(steps) if series else np.zeros(axes.shape),
        )


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
