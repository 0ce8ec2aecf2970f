"""A `log:` block as a user would write it."""

from __future__ import annotations

from typing import Any

from tdfscal.files.rig.draft import log_lines
from tdfscal.records import LogMapping


def mapping_document(mapping: LogMapping, *, by_topic: bool) -> dict[str, Any]:
    """The block as plain values, without what says no more than the default."""
    block: dict[str, Any] = {}
    if mapping.rows != "timeseries":
        block["rows"] = mapping.rows
    block["time"] = (
        {"source": mapping.time_source}
        if by_topic
        else {"field": mapping.time_field, "unit": mapping.time_unit}
    )
    block["length_unit"] = mapping.length_unit
    block["force_unit"] = mapping.force_unit
    block["force_on"] = mapping.force_on
    if mapping.decimal != ".":
        block["decimal"] = mapping.decimal
    block["supports"] = {
        name: {
            "position": _fields(mapping.position[i]),
            "force": _fields(mapping.force[i]),
        }
        for i, name in enumerate(mapping.supports)
    }
    return {"log": block}


def mapping_block(mapping: LogMapping, *, by_topic: bool) -> str:
    """The block as YAML, ready to paste into rig.yaml."""
    block = mapping_document(mapping, by_topic=by_topic)["log"]
    return "\n".join(log_lines(block)) + "\n"


def _fields(names: tuple[str, ...]) -> str | list[str]:
    return names[0] if len(names) == 1 else list(names)
