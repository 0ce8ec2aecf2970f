"""Phrases that several reports share."""

from __future__ import annotations

from collections.abc import Iterable

from tdfscal.files.calibration.parts import Input
from tdfscal.records import InputFile
from tdfscal.reporting.layout import Table

METHODS = {
    "self": "self-calibration",
    "tracker": "laser-tracker calibration",
    "joint": "joint calibration, self and tracker",
}


def inputs_table(inputs: Iterable[Input | InputFile], caption: str = "Input files") -> Table:
    """Files with their digests."""
    rows = tuple((f.path, f.sha256, f"{f.bytes:,}", _stated(f)) for f in inputs)
    return Table(caption, ("file", "SHA-256", "bytes", "integrity"), rows, left=2)


def _stated(file: Input | InputFile) -> str:
    return file.integrity if file.note is None else f"{file.integrity}; {file.note}"


def probability(p: float) -> str:
    """Two digits where they say something, else the magnitude."""
    return f"{p:.2f}" if p >= 0.01 else f"{p:.1g}"


def utc(instant: str) -> str:
    """An ISO 8601 instant as people read it."""
    return instant.replace("T", " ").replace("Z", " UTC")
