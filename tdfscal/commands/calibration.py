"""A calibration in Python: the content of its file, and what scripts and notebooks want of it."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Self, cast

from pydantic import BaseModel

from tdfscal.commands.result import Result, by_column
from tdfscal.errors import UsageError, expect
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.calibration.document import (
    dump_calibration,
    file_content,
    parse_calibration,
    save_calibration,
)
from tdfscal.files.calibration.document import load_calibration as load_file
from tdfscal.files.yaml import as_path
from tdfscal.records import ANGLES
from tdfscal.reporting.layout import Drawing, Report

#: What a command takes as a calibration: a file, `-` for standard input, or one in memory.
CalibrationSource = str | PathLike[str] | CalibrationFile

ANGLE_COLUMNS = "support angle value std low high"
#: What a calibration goes by that no file holds.
IN_MEMORY = "calibration"


class Calibration(Result, CalibrationFile):
    """The installation rotations of a rig's sensors, with all that belongs to them.

    The fields are those of the calibration file; see `docs/reference.md`.
    """

    __hash__ = None  # equal by content, which holds lists

    @classmethod
    def of(cls, file: CalibrationFile) -> Self:
        """Take over the content of a checked calibration file."""
        made = cls.model_construct(**{name: getattr(file, name) for name in cls.model_fields})
        made._read = file._read
        return made

    @property
    def exit_status(self) -> int:
        """1 where the quality gate rejects it."""
        return 0 if self.accepted else 1

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Lay out verdict, angles, evidence, what next."""
        from tdfscal.reporting.calibration import calibration_report

        return calibration_report(self, drawings)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the file as plain JSON values."""
        return file_content(self)

    def table(self) -> dict[str, list[Any]]:
        """Return one row per angle: support, angle, value, std, low, high, in rad."""
        return by_column(ANGLE_COLUMNS, angle_rows(self))

    def drawings(self) -> tuple[Drawing, ...]:
        """Return every figure for which there are data, in the order of the report."""
        from tdfscal.reporting.figures import drawings

        return drawings(self)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the file, .json, .yaml or .yml, whole or not at all. Raises UsageError."""
        save_calibration(self, as_path(path))

    def write(self, path: Path, holds: str) -> None:
        """Write its page, or its file by the name's ending. Raises UsageError."""
        if holds == "content":
            self.save(path)
        else:
            super().write(path, holds)

    @property
    def content(self) -> str:
        """The file as YAML."""
        return dump_calibration(self, "yaml")

    def __dir__(self) -> list[str]:
        return [name for name in super().__dir__() if not hasattr(BaseModel, name)]


def load_calibration(path: str | PathLike[str]) -> Calibration:
    """Read and check a calibration file, JSON where its suffix is .json, else YAML.

    Raises
    ------
    DataError
        It is no calibration file, of a newer format, or contradicts itself.
    UsageError
        It cannot be read.
    """
    return read_source(path)[1]


def read_source(source: CalibrationSource) -> tuple[str, Calibration]:
    """Return the name that a calibration goes by in messages, and the calibration."""
    if isinstance(source, CalibrationFile):
        known = source if isinstance(source, Calibration) else Calibration.of(source)
        return IN_MEMORY, known
    if str(source) == "-":
        name = "standard input"
        return name, Calibration.of(parse_calibration(sys.stdin.buffer.read(), name))
    path = as_path(source)
    if path.is_dir():
        raise UsageError(
            "is a folder; a calibration file is wanted here",
            where=str(path),
            hint="name the .yaml or .json file that calibrate wrote",
        )
    return str(path), Calibration.of(load_file(path))


def read_sources(sources: Sequence[CalibrationSource]) -> list[tuple[str, Calibration]]:
    """Read several, each under a name of its own. Raises DataError, UsageError."""
    if sum(source == "-" or source == Path("-") for source in sources) > 1:
        raise UsageError("standard input can be read once only", hint="name files")
    loaded = [read_source(source) for source in sources]
    if [name for name, _ in loaded].count(IN_MEMORY) > 1:
        loaded = [
            (f"{name} {k}" if name == IN_MEMORY else name, c)
            for k, (name, c) in enumerate(loaded, 1)
        ]
    if len({name for name, _ in loaded}) < len(loaded):
        raise UsageError("a calibration file is named twice", hint="name each file once")
    return loaded


def sources_of(*given: CalibrationSource | Iterable[CalibrationSource]) -> list[CalibrationSource]:
    """Return calibrations that are named one by one, or as a list. Raises UsageError."""
    found: list[CalibrationSource] = []
    for item in given:
        if isinstance(item, list | tuple):
            found += sources_of(*item)
        else:
            expect("files", item, str | PathLike | CalibrationFile, "a calibration or its file")
            found.append(cast(CalibrationSource, item))
    if not found:
        raise UsageError("no file is named", hint="name calibration files")
    return found


def angle_rows(calibration: CalibrationFile) -> Iterator[tuple[str | float, ...]]:
    """Return what stands under `ANGLE_COLUMNS`."""
    for support in calibration.mounted:
        low, high = support.interval.low, support.interval.high
        for angle, *row in zip(ANGLES, support.rpy, support.rpy_std, low, high, strict=True):
            yield (support.name, angle, *(math.nan if value is None else value for value in row))
