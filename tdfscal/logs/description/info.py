"""What is known of some logs before anything is calibrated: the record, as JSON, its mapping."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from tdfscal.dwells import Offset
from tdfscal.files.hashing import printable
from tdfscal.files.rig.draft import log_lines
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.description.mapping_guess import Guess
from tdfscal.records import Dwells, InputFile, LogMapping

Source = Literal["rig", "guessed"]


@dataclass(frozen=True, slots=True)
class Signal:
    """One vector signal as it is read with the mapping.

    fields : in the file. count : samples. start, end : s, None without any. rate : Hz, None below
    two samples. gaps : intervals of more than five periods. longest_interval : s.
    """

    support: str
    quantity: Literal["position", "force"]
    fields: tuple[str, ...]
    count: int
    start: float | None
    end: float | None
    rate: float | None
    gaps: int
    longest_interval: float


@dataclass(frozen=True, slots=True)
class LogInfo:
    """What is in some logs.

    mapping : with which the signals were read: the rig's, or the guess. guess : for the first file.
    problems : what keeps the logs from being used, or wants a look.
    """

    contents: tuple[Contents, ...]
    guess: Guess
    mapping: LogMapping | None
    source: Source
    signals: tuple[Signal, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    dwells: Dwells | None = None
    offset: Offset | None = None
    problems: tuple[str, ...] = ()


def as_document(info: LogInfo) -> dict[str, Any]:
    """One object: files, mapping (also as YAML text), signals, dwells, problems."""
    by_topic = info.contents[0].by_topic
    guess, offset, dwells = info.guess.mapping, None, None
    if info.offset is not None:
        definition = "time of the forces less that of the positions"
        offset = {**asdict(info.offset), "definition": definition}
    if info.dwells is not None:
        dwells = {
            "count": len(info.dwells),
            "start": np.asarray(info.dwells.start).tolist(),
            "end": np.asarray(info.dwells.end).tolist(),
            "left_out": [asdict(out) for out in info.dwells.left_out],
        }
    return {
        "files": [_file(contents) for contents in info.contents],
        "read_with": info.source if info.mapping else None,
        "mapping": mapping_document(guess, by_topic=by_topic) if guess else None,
        "mapping_yaml": mapping_block(guess, by_topic=by_topic) if guess else None,
        "mapping_notes": list(info.guess.notes),
        "signals": [asdict(s) | {"fields": list(s.fields)} for s in info.signals],
        "inputs": [
            {"path": i.path, "sha256": i.sha256, "bytes": i.bytes, "integrity": i.integrity}
            for i in info.inputs
        ],
        "time_offset": offset,
        "dwells": dwells,
        "problems": list(info.problems),
    }


def _file(contents: Contents) -> dict[str, Any]:
    return {
        "path": printable(str(contents.path)),
        "format": contents.format,
        "bytes": contents.bytes,
        "streams": [
            {
                "name": stream.name,
                "type": stream.kind or None,
                "count": stream.count,
                "start": stream.start,
                "end": stream.end,
                "fields": [
                    {"name": f.name, "type": f.kind, "unit": f.unit, "low": f.low, "high": f.high}
                    for f in stream.fields
                ],
            }
            for stream in contents.streams
        ],
    }


def mapping_document(mapping: LogMapping, *, by_topic: bool) -> dict[str, Any]:
    """The block as plain values, without what says no more than the default."""

    def fields(names: tuple[str, ...]) -> str | list[str]:
        return names[0] if len(names) == 1 else list(names)

    each = zip(mapping.supports, mapping.position, mapping.force, strict=True)
    timed = {"field": mapping.time_field, "unit": mapping.time_unit}
    block: dict[str, Any] = {
        "rows": mapping.rows,
        "time": {"source": mapping.time_source} if by_topic else timed,
        "length_unit": mapping.length_unit,
        "force_unit": mapping.force_unit,
        "force_on": mapping.force_on,
        "decimal": mapping.decimal,
        "supports": {n: {"position": fields(p), "force": fields(f)} for n, p, f in each},
    }
    usual = {"rows": "timeseries", "decimal": "."}
    return {"log": {key: value for key, value in block.items() if usual.get(key) != value}}


def mapping_block(mapping: LogMapping, *, by_topic: bool) -> str:
    """The block as YAML, ready to paste into rig.yaml."""
    block = mapping_document(mapping, by_topic=by_topic)["log"]
    return "\n".join(log_lines(block)) + "\n"
