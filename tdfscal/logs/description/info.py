"""What is known of some logs before anything is calibrated: the record, as JSON, its mapping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tdfscal.dwells import Offset
from tdfscal.files.hashing import printable
from tdfscal.files.rig.draft import log_lines
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.description.mapping_guess import Guess
from tdfscal.records import Dwells, FloatArray, InputFile, LogMapping, RecorderClock

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

    recorders : with which the signals were read: the rig's, or the guess. problems : what keeps the
    logs from being used, or wants a look. clocks : of all recorders but the first. samples :
    positions in m and forces in N, (K, n, 3), of instants over the log; None where it was not read.
    """

    contents: tuple[Contents, ...]
    guess: Guess
    recorders: tuple[LogMapping, ...]
    source: Source
    signals: tuple[Signal, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    dwells: Dwells | None = None
    offset: Offset | None = None
    problems: tuple[str, ...] = ()
    clocks: tuple[RecorderClock, ...] = ()
    samples: tuple[FloatArray, FloatArray] | None = None

    @property
    def mapping(self) -> LogMapping | None:
        """Of the first recorder; None where nothing is guessed."""
        return self.recorders[0] if self.recorders else None

    def block(self, recorders: Sequence[LogMapping]) -> dict[str, Any] | list[dict[str, Any]]:
        """The `log` block of the recorders, as plain values, without what is the default."""
        blocks = []
        for recorder in recorders:
            own = next((c for c in self.contents if owns_file(recorder, c.path)), self.contents[0])
            blocks.append(mapping_document(recorder, by_topic=own.by_topic))
        return blocks[0] if len(blocks) == 1 else blocks


def owns_file(recorder: LogMapping, path: Path) -> bool:
    """Tell whether a file, or the folder that it is in, is of a recorder's files."""
    names = (path.name, path.parent.name)
    return recorder.files is None or any(fnmatch(name, recorder.files) for name in names)


def as_document(info: LogInfo) -> dict[str, Any]:
    """One object: files, mapping (also as YAML text), signals, dwells, problems."""
    guess, offset, dwells = info.guess.recorders, None, None
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
        "mapping": {"log": info.block(guess)} if guess else None,
        "mapping_yaml": mapping_block(info) if guess else None,
        "mapping_notes": list(info.guess.notes),
        "signals": [asdict(s) | {"fields": list(s.fields)} for s in info.signals],
        "inputs": [
            {"path": i.path, "sha256": i.sha256, "bytes": i.bytes, "integrity": i.integrity}
            for i in info.inputs
        ],
        "clocks": [asdict(replace(clock, activity=None)) for clock in info.clocks],
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

    supports: dict[str, dict[str, str | list[str]]] = {}
    for what, named in (("position", mapping.position), ("force", mapping.force)):
        for name, own in zip(mapping.supports, named, strict=True):
            if own:
                supports.setdefault(name, {})[what] = fields(own)
    timed = {"field": mapping.time_field, "unit": mapping.time_unit}
    block: dict[str, Any] = {
        "files": mapping.files,
        "rows": mapping.rows,
        "time": {"source": mapping.time_source} if by_topic else timed,
        "length_unit": mapping.length_unit if any(mapping.position) else None,
        "force_unit": mapping.force_unit if any(mapping.force) else None,
        "force_on": mapping.force_on if any(mapping.force) else None,
        "decimal": mapping.decimal,
        "supports": supports,
    }
    usual = {"rows": "timeseries", "decimal": "."}
    return {key: value for key, value in block.items() if value not in (None, usual.get(key))}


def mapping_block(info: LogInfo) -> str:
    """The guessed block as YAML, ready to paste into rig.yaml."""
    return "\n".join(log_lines(info.block(info.guess.recorders))) + "\n"
