"""What is in some logs, as plain text, and as a document."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from tdfscal.catalogue import sentence
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.inputs import STOPS
from tdfscal.catalogue.numbers import rounded, when
from tdfscal.dwells import offset_finding
from tdfscal.errors import visible
from tdfscal.files.rig.draft import stated_log
from tdfscal.files.saving import in_utf8
from tdfscal.files.yaml import shorten
from tdfscal.logs.contents import Contents, Field, Stream
from tdfscal.logs.describe import LogInfo, mapping_block
from tdfscal.records import by_wall_clock
from tdfscal.reporting.layout import document, plain, told_clock
from tdfscal.reporting.text import bullets, table, wrapped

_LONGEST_NAME = 200
_MOST_FIELDS = 60
_KINDS = {"csv": "text table", "parquet": "Parquet", "mcap": "MCAP", "bag": "bag"}


def as_text(info: LogInfo) -> str:
    """The whole report; lines that are to be copied, fields and mapping, may be longer than 80."""
    blocks = [*map(_file, info.contents), _signals(info), _dwells(info), _problems(info)]
    lines = [line for block in map(list, blocks) if block for line in (*block, "")]
    lines += _mapping(info)
    return "\n".join(map(visible, lines)).rstrip("\n") + "\n"


def as_document(info: LogInfo) -> dict[str, Any]:
    """One object: files, mapping (also as YAML text), signals, dwells, problems."""
    guess, offset, dwells = info.guess.recorders, None, None
    if info.offset is not None:
        definition = "time of the forces less that of the positions"
        offset = {**plain(info.offset), "definition": definition}
    if info.dwells is not None:
        dwells = document(info.dwells, "start end left_out", count=len(info.dwells))
    return document(
        info,
        "signals inputs clocks problems",
        files=[
            document(file, "format bytes streams", path=in_utf8(str(file.path)))
            for file in info.contents
        ],
        read_with=info.source if info.recorders else None,
        mapping={"log": stated_log(guess)} if guess else None,
        mapping_yaml=mapping_block(info) if guess else None,
        mapping_notes=info.guess.notes,
        time_offset=offset,
        dwells=dwells,
    )


def _file(contents: Contents) -> Iterator[str]:
    total = sum(stream.count for stream in contents.streams)
    what = "messages" if contents.by_topic else "rows"
    yield from wrapped(visible(str(contents.path)))
    yield f"{_KINDS[contents.format]}, {contents.bytes:,} bytes, {total} {what}; ranges of samples"
    for stream in contents.streams:
        yield ""
        if contents.by_topic:
            yield from wrapped(f"{stream.name or '(no name)'}  {stream.kind}{_rate(stream)}")
        names = [
            shorten(field.name, _LONGEST_NAME) + (f" [{field.unit}]" if field.unit else "")
            for field in stream.fields[:_MOST_FIELDS]
        ]
        room = max(map(len, names), default=0)
        for label, field in zip(names, stream.fields, strict=False):
            yield f"  {label:<{room}}  {field.kind.rsplit('/', 1)[-1]}{_span(field)}"
        if len(stream.fields) > _MOST_FIELDS:
            yield f"  … and {len(stream.fields) - _MOST_FIELDS} more"


def _rate(stream: Stream) -> str:
    span = 0.0 if stream.start is None or stream.end is None else stream.end - stream.start
    rate = f" in {span:.2f} s, {rounded((stream.count - 1) / span, 4)} Hz" if span > 0 else ""
    return f", {stream.count} messages{rate}"


def _span(field: Field) -> str:
    if field.low is None or field.high is None:
        return ""
    dated = field.kind == "date and time" and by_wall_clock(field.low, field.high)
    form = when if dated else "{:.6g}".format
    return f"  {form(field.low)} … {form(field.high)}"


def _signals(info: LogInfo) -> Iterator[str]:
    if not info.signals:
        return
    which = "the rig file's mapping" if info.source == "rig" else "the mapping guessed below"
    yield from wrapped(f"Signals, as read with {which}")
    rows = [
        (s.support, s.quantity, f"{s.count}", "–" if s.rate is None else f"{s.rate:.5g}",
         f"{(s.end or 0.0) - (s.start or 0.0):.2f}", f"{s.gaps}", rounded(s.longest_interval, 4))
        for s in info.signals
    ]  # fmt: skip
    header = ("support", "quantity", "samples", "Hz", "span s", "gaps", "longest s")
    yield from table(header, rows, left=2)
    for clock in info.clocks:
        told = told_clock(clock, info.recorders)
        yield from wrapped(f"Recorder {clock.recorder}: {told}; times are those of the first one.")
    for found in (offset_finding(info.offset) if info.offset else None, info.lag):
        if found is not None:
            yield from wrapped(begun(sentence(found), "."))
    yield from wrapped(_recorded(info))


def _recorded(info: LogInfo) -> str:
    """When the log was recorded, and what says so."""
    ends = [moment for s in info.signals for moment in (s.start, s.end) if moment is not None]
    for offset in (0.0, *(clock.offset for clock in info.clocks)):  # where the first has no dates
        span = [round(end + offset) for end in (min(ends), max(ends))] if ends else []
        if span and by_wall_clock(*span):
            return f"Recorded {when(span[0])} to {when(span[1])}, by the log's own clock."
    return (
        "The log's clock has no dates. State the day as campaign.date in rig.yaml; else the "
        "file's date is taken, which a copy changes."
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
        yield from wrapped(f"{len(dwells)} dwell{lengths}, {share:.0f} % of the log")
    reasons = Counter(STOPS[out.reason.code] for out in dwells.left_out)
    for reason, count in reasons.most_common():
        yield f"{count} × left out: {reason}"


def _problems(info: LogInfo) -> Iterator[str]:
    yield from ["Problems"] if info.problems else ()
    yield from bullets(info.problems)


def _mapping(info: LogInfo) -> Iterator[str]:
    if not info.guess.recorders:
        return
    read = "" if info.source == "guessed" else "; the rig file's own was used above"
    yield from wrapped(
        f"Mapping guessed{read}. Check it, and paste it into rig.yaml; `tdfscal init` writes a "
        "whole rig file:"
    )
    yield from ("", *mapping_block(info).splitlines(), "", *bullets(info.guess.notes))
