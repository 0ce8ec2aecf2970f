"""What is in some logs, as plain text."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from tdfscal.errors import visible
from tdfscal.files.yaml.scalars import shorten
from tdfscal.logs.common.contents import Contents, Field, Stream
from tdfscal.logs.description.info import LogInfo, Signal, mapping_block
from tdfscal.records import Dwells
from tdfscal.reporting.text import table, width

_LONGEST_NAME = 200
_MOST_FIELDS = 60


def as_text(info: LogInfo) -> str:
    """The whole report; the mapping's lines alone may be longer, as they are to be pasted."""
    lines: list[str] = []
    for contents in info.contents:
        lines += [*_file(contents), ""]
    if info.signals:
        lines += [*_signals(info), ""]
    if info.dwells is not None:
        lines += [*_dwells(info.dwells, info.signals), ""]
    if info.problems:
        lines.append("Problems")
        for problem in info.problems:
            lines += _wrapped(problem, "- ")
        lines.append("")
    if info.guess.mapping is not None:
        read = "" if info.source == "guessed" else "; the rig file's own was used above"
        lines += _wrapped(
            f"Mapping guessed{read}. Check it, and paste it into rig.yaml; `tdfscal init` writes a "
            "whole rig file:",
            "",
        )
        lines.append("")
        lines += mapping_block(info.guess.mapping, by_topic=info.contents[0].by_topic).splitlines()
        lines.append("")
        for note in info.guess.notes:
            lines += _wrapped(note, "- ")
    return "\n".join(map(visible, lines)).rstrip("\n") + "\n"


def _file(contents: Contents) -> Iterator[str]:
    yield from _wrapped(visible(str(contents.path)), "")
    kind = {"csv": "text table", "parquet": "Parquet", "mcap": "MCAP", "bag": "bag"}[
        contents.format
    ]
    total = sum(stream.count for stream in contents.streams)
    what = "messages" if contents.by_topic else "rows"
    yield f"{kind}, {_size(contents.bytes)}, {total} {what}"
    yield ""
    for stream in contents.streams:
        if contents.by_topic:
            yield from _topic(stream)
        shown = stream.fields[:_MOST_FIELDS]
        yield from _fields(shown)
        if len(stream.fields) > len(shown):
            yield f"  … and {len(stream.fields) - len(shown)} more"


def _fields(fields: Sequence[Field]) -> Iterator[str]:
    """A line per field, or two where a name needs the width for itself: names are to be copied."""
    rows = []
    for field in fields:
        label = shorten(field.name, _LONGEST_NAME) + (f" [{field.unit}]" if field.unit else "")
        known = field.low is not None and field.high is not None
        span = f"{field.low:.6g} … {field.high:.6g}" if known else ""
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
    yield from _wrapped(f"{stream.name or '(no name)'}  {stream.kind}", "")
    row = f"  {stream.count} messages"
    if stream.start is not None and stream.end is not None and stream.end > stream.start:
        span = stream.end - stream.start
        row += f" in {span:.2f} s, {(stream.count - 1) / span:.4g} Hz"
    yield row


def _signals(info: LogInfo) -> Iterator[str]:
    which = "the rig file's mapping" if info.source == "rig" else "the mapping guessed below"
    yield f"Signals, as read with {which}"
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
    if info.offset is not None:
        yield from _wrapped(f"Clocks: {info.offset}.", "  ")


def _dwells(dwells: Dwells, signals: Sequence[Signal]) -> Iterator[str]:
    length = dwells.end - dwells.start
    if not len(dwells):
        yield "No dwells"
    elif not length.any():
        yield f"{len(dwells)} postures, one per row"
    else:
        span = max((s.end for s in signals if s.end is not None), default=0.0) - min(
            (s.start for s in signals if s.start is not None), default=0.0
        )
        yield from _wrapped(
            f"{len(dwells)} dwells of {length.min():.2f} to {length.max():.2f} s (median "
            f"{np.median(length):.2f} s), {100 * length.sum() / max(span, 1e-9):.0f} % of the log",
            "",
        )
    reasons = Counter(out.reason.split(":")[0].split(" in ")[0] for out in dwells.left_out)
    for reason, count in reasons.most_common():
        yield from _wrapped(f"{count} × left out: {reason}", "  ")


def _wrapped(text: str, first: str) -> list[str]:
    indent = " " * len(first)
    return textwrap.wrap(
        text, width(), initial_indent=first, subsequent_indent=indent, break_on_hyphens=False
    ) or [first]


def _size(count: int) -> str:
    value = float(count)
    for unit in ("B", "kB", "MB"):
        if value < 1000.0:
            return f"{value:.3g} {unit}"
        value /= 1000.0
    return f"{value:.4g} GB"
