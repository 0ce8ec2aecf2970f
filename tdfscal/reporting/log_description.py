"""What is in some logs, as plain text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from tdfscal.catalogue import sentence
from tdfscal.catalogue.entry import begun, by_wall_clock, when
from tdfscal.catalogue.inputs import STOPS
from tdfscal.errors import visible
from tdfscal.files.yaml import shorten
from tdfscal.logs.contents import Contents, Field, Stream
from tdfscal.logs.describe import LogInfo, mapping_block
from tdfscal.reporting.layout import told_clock
from tdfscal.reporting.text import table, width, wrapped

_LONGEST_NAME = 200
_MOST_FIELDS = 60
_KINDS = {"csv": "text table", "parquet": "Parquet", "mcap": "MCAP", "bag": "bag"}
#: Neither indented nor hanging.
_PLAIN = ("", "")


def as_text(info: LogInfo) -> str:
    """The whole report; the mapping's lines alone may be longer, as they are to be pasted."""
    blocks = [*map(_file, info.contents), _signals(info), _dwells(info), _problems(info)]
    lines = [line for block in map(list, blocks) if block for line in (*block, "")]
    lines += _mapping(info)
    return "\n".join(map(visible, lines)).rstrip("\n") + "\n"


def _problems(info: LogInfo) -> Iterator[str]:
    yield from ["Problems"] if info.problems else ()
    for problem in info.problems:
        yield from wrapped(f"- {problem}", "")


def _mapping(info: LogInfo) -> Iterator[str]:
    if info.guess.mapping is None:
        return
    read = "" if info.source == "guessed" else "; the rig file's own was used above"
    yield from wrapped(
        f"Mapping guessed{read}. Check it, and paste it into rig.yaml; `tdfscal init` writes a "
        "whole rig file:",
        *_PLAIN,
    )
    block = mapping_block(info)
    yield from ("", *block.splitlines(), "")
    for note in info.guess.notes:
        yield from wrapped(f"- {note}", "")


def _file(contents: Contents) -> Iterator[str]:
    yield from wrapped(visible(str(contents.path)), *_PLAIN)
    total = sum(stream.count for stream in contents.streams)
    what = "messages" if contents.by_topic else "rows"
    yield f"{_KINDS[contents.format]}, {_size(contents.bytes)}, {total} {what}"
    yield ""
    for stream in contents.streams:
        if contents.by_topic:
            yield from _topic(stream)
        yield from _fields(stream.fields[:_MOST_FIELDS])
        if len(stream.fields) > _MOST_FIELDS:
            yield f"  … and {len(stream.fields) - _MOST_FIELDS} more"


def _fields(fields: Sequence[Field]) -> Iterator[str]:
    """A line per field, or two where a name needs the width for itself: names are to be copied."""
    rows = []
    for field in fields:
        label = shorten(field.name, _LONGEST_NAME) + (f" [{field.unit}]" if field.unit else "")
        span = ""
        if field.low is not None and field.high is not None:
            dated = field.kind == "date and time" and by_wall_clock(field.low, field.high)
            form = when if dated else "{:.6g}".format
            span = f"{form(field.low)} … {form(field.high)}"
        rows.append((label, field.kind.rsplit("/", 1)[-1], span))
    widths = [max((len(row[k]) for row in rows), default=0) for k in range(3)]
    whole = sum(widths) + 6 <= width()
    for row in rows:
        if whole:
            yield f"  {row[0]:<{widths[0]}}  {row[1]:<{widths[1]}}  {row[2]}".rstrip()
        else:
            yield f"  {row[0]}"
            yield f"      {row[1]}  {row[2]}".rstrip()


def _topic(stream: Stream) -> Iterator[str]:
    yield from wrapped(f"{stream.name or '(no name)'}  {stream.kind}", *_PLAIN)
    span = 0.0 if stream.start is None or stream.end is None else stream.end - stream.start
    rate = f" in {span:.2f} s, {(stream.count - 1) / span:.4g} Hz" if span > 0 else ""
    yield f"  {stream.count} messages{rate}"


def _signals(info: LogInfo) -> Iterator[str]:
    if not info.signals:
        return
    which = "the rig file's mapping" if info.source == "rig" else "the mapping guessed below"
    yield from wrapped(f"Signals, as read with {which}", "", "")
    rows = []
    for s in info.signals:
        rate = "–" if s.rate is None else f"{s.rate:.5g}"
        span = 0.0 if s.start is None or s.end is None else s.end - s.start
        rows.append(
            (s.support, s.quantity, f"{s.count}", rate, f"{span:.2f}", f"{s.gaps}",
             f"{s.longest_interval:.4g}")
        )  # fmt: skip
    header = ("support", "quantity", "samples", "Hz", "span s", "gaps", "longest s")
    yield from table(header, rows, left=2)
    for clock in info.clocks:
        yield from wrapped(
            f"Recorder {clock.recorder}: {told_clock(clock, info.recorders)}; times are those of "
            "the first recorder.",
            hanging="",
        )
    for found in (info.offset.finding if info.offset else None, info.lag):
        if found is not None:
            yield from wrapped(begun(sentence(found), "."), hanging="")
    yield from wrapped(_recorded(info), hanging="")


def _recorded(info: LogInfo) -> str:
    """When the log was recorded, and what says so."""
    ends = [moment for s in info.signals for moment in (s.start, s.end) if moment is not None]
    for offset in (0.0, *(clock.offset for clock in info.clocks)):  # where the first has no dates
        span = [round(end + offset) for end in (min(ends), max(ends))] if ends else []
        if span and by_wall_clock(*span):
            return f"Recorded {when(span[0])} to {when(span[1])}, by the log's own clock."
    return (
        "The log's clock has no dates: the file's own, which a copy changes, stands for when it "
        "was recorded unless campaign.date of rig.yaml says it."
    )


def _dwells(info: LogInfo) -> Iterator[str]:
    dwells = info.dwells
    if dwells is None:
        return
    length = dwells.end - dwells.start
    if not len(dwells):
        yield "No dwells"
    elif not length.any():
        yield f"{len(dwells)} postures, one per row"
    else:
        first = min((s.start for s in info.signals if s.start is not None), default=0.0)
        last = max((s.end for s in info.signals if s.end is not None), default=0.0)
        share = 100 * length.sum() / max(last - first, 1e-9)
        many = f"s of {length.min():.2f} to {length.max():.2f} s (median {np.median(length):.2f} s)"
        lengths = many if len(dwells) > 1 else f" of {length[0]:.2f} s"
        yield from wrapped(f"{len(dwells)} dwell{lengths}, {share:.0f} % of the log", *_PLAIN)
    reasons = Counter(STOPS[out.reason.code] for out in dwells.left_out)
    for reason, count in reasons.most_common():
        yield from wrapped(f"{count} × left out: {reason}", hanging="")


def _size(count: int) -> str:
    value = float(count)
    for unit in ("B", "kB", "MB"):
        if value < 1000.0:
            return f"{value:.3g} {unit}"
        value /= 1000.0
    return f"{value:.4g} GB"
