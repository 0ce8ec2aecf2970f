"""What is in some logs, as plain JSON values."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdfscal.files.hashing import printable
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.description.info import LogInfo, Signal
from tdfscal.logs.description.mapping_text import mapping_block, mapping_document
from tdfscal.records import Dwells


def as_document(info: LogInfo) -> dict[str, Any]:
    """One object: files, mapping (also as YAML text), signals, dwells, problems."""
    by_topic = info.contents[0].by_topic
    guess = info.guess.mapping
    return {
        "files": [_file(contents) for contents in info.contents],
        "read_with": info.source if info.mapping else None,
        "mapping": mapping_document(guess, by_topic=by_topic) if guess else None,
        "mapping_yaml": mapping_block(guess, by_topic=by_topic) if guess else None,
        "mapping_notes": list(info.guess.notes),
        "signals": [_signal(signal) for signal in info.signals],
        "inputs": [
            {"path": i.path, "sha256": i.sha256, "bytes": i.bytes, "integrity": i.integrity}
            for i in info.inputs
        ],
        "time_offset": None
        if info.offset is None
        else {
            "seconds": info.offset.seconds,
            "std": info.offset.std,
            "moves": info.offset.moves,
            "definition": "time of the forces less that of the positions",
        },
        "dwells": None if info.dwells is None else _dwells(info.dwells),
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


def _signal(signal: Signal) -> dict[str, Any]:
    some = signal.count > 0
    return {
        "support": signal.support,
        "quantity": signal.quantity,
        "fields": list(signal.fields),
        "count": signal.count,
        "start": signal.start if some else None,
        "end": signal.end if some else None,
        "rate": signal.rate,
        "gaps": signal.gaps,
        "longest_interval": signal.longest,
    }


def _dwells(dwells: Dwells) -> dict[str, Any]:
    return {
        "count": len(dwells),
        "start": np.asarray(dwells.start).tolist(),
        "end": np.asarray(dwells.end).tolist(),
        "left_out": [
            {"start": out.start, "end": out.end, "reason": out.reason} for out in dwells.left_out
        ],
    }
