"""When, where and by whom data were recorded, papers of rig and sensors; how a check was made."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from tdfscal import __version__
from tdfscal.files.calibration.parts import MeasuredResult, instant
from tdfscal.findings import Finding
from tdfscal.frozen import field, record
from tdfscal.records import InputFile, Rig, SensorInfo
from tdfscal.reporting.layout import Block, Facts, Section, Table, utc

_SOURCES = {"log": "by the log's own clock", "rig": "by the rig file", "file": "by the file's date"}


@record
class Making:
    """How a result was made. created : UTC, ISO 8601."""

    command: str
    inputs: tuple[InputFile, ...]
    created: str = field(default_factory=lambda: instant(time.time()))
    version: str = __version__

    def section(self, *facts: tuple[str, str], page_only: bool = True) -> Section:
        """What a result was made of: command, program, facts, and files with their digests."""
        parts = (
            (f"{f.path}, {f.bytes:,} bytes", f.integrity, f.note, f"SHA-256 {f.sha256}")
            for f in self.inputs
        )
        rows = (
            ("Command", self.command),
            ("Created", utc(self.created)),
            ("Software", f"tdfscal {self.version}"),
            *facts,
            *(("Input file", "; ".join(filter(None, each))) for each in parts),
        )
        return Section("Where this result comes from", (Facts(rows),), page_only=page_only)

    def document(self) -> dict[str, Any]:
        """Return it under the keys of a calibration file, as plain JSON values."""
        return {
            "created": self.created,
            "software": {"name": "tdfscal", "version": self.version},
            "command": self.command,
            "inputs": [asdict(file) for file in self.inputs],
        }


def campaign(facts: Iterable[tuple[str, str | None]], rig: Rig) -> tuple[Section, ...]:
    """What is told of a campaign; serial numbers and certificates of its rig's sensors."""
    said = tuple((name, text) for name, text in facts if text)
    papers = tuple(
        (name, each.serial or "", each.certificate or "", each.due or "")
        for name, each in zip(rig.supports, rig.sensors, strict=False)
        if each != SensorInfo()
    )
    header = ("sensor", "serial number", "certificate", "due")
    blocks: tuple[Block, ...] = (Facts(said),) if said else ()
    if papers:
        blocks += (Table("Sensors", header, papers, left=4),)
    return (Section("Campaign and sensors", blocks),) if blocks else ()


def stated_facts(rig: Rig, measured: MeasuredResult | None) -> list[tuple[str, str | None]]:
    """What is told of the rig's serial number, dates, people and place."""
    said, when = rig.campaign, None if measured is None else measured_when(measured)
    people = ("Operator", said.operator), ("Site", said.site), ("Note", said.note)
    return [("Serial number", rig.serial), ("Measured", when), *people]


def measured_by(measured: MeasuredResult | None) -> str:
    """What says when the data were recorded."""
    if measured is None:
        return "not known when; the dates are those of the computation"
    again = "; a copy has another: state campaign.date" if measured.source == "file" else ""
    return f"{_SOURCES[measured.source]}{again}"


def measured_when(measured: MeasuredResult) -> str:
    """From when to when data were recorded, and what says so."""
    begin, end = measured.begin, measured.end
    if begin.endswith("T00:00:00Z") and end.endswith("T23:59:59Z"):  # a date alone is days
        begin, end = begin[:10], end[:10]
    span = " to ".join(dict.fromkeys((utc(begin), utc(end))))
    return f"{span}, {measured_by(measured)}"


def day_measured(measured: MeasuredResult, begin: str = "") -> str:
    """Of which day data are, and what says so; begin : of the first of several campaigns."""
    first = f"{begin[:10]} to " if begin else ""
    return f"{first}{measured.end[:10]}, {_SOURCES[measured.source]}"


def by_file(measured: MeasuredResult | None) -> str:
    """That nothing but a file's date says when data were recorded."""
    undated = measured is not None and measured.source == "file"
    return f" ({_SOURCES['file']})" if undated else ""


def overdue(rig: Rig, day: str, before: str = "") -> tuple[Finding, ...]:
    """Sensors whose own certificate had ended on a day; before : what is of that day."""
    return tuple(
        Finding("sensor-overdue", (name,), values={"due": due, "before": before})
        for due, name in rig.certificates
        if due < day
    )
