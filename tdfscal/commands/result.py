"""What every result can do: be printed, drawn, put into a table, written; so a `Calibration`."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from html import escape
from os import PathLike
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
from pydantic import BaseModel

from tdfscal.catalogue import documents
from tdfscal.commands.campaign import kind_of
from tdfscal.errors import DataError, UsageError, expect, without_exponent
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.calibration.document import (
    dump_calibration,
    file_content,
    parse_calibration,
    save_calibration,
)
from tdfscal.files.calibration.document import load_calibration as load_file
from tdfscal.files.outputs import CALIBRATION, DOCUMENT, kind_by, protect
from tdfscal.files.saving import write_text
from tdfscal.files.yaml import as_path
from tdfscal.findings import rejecting
from tdfscal.frozen import record, replace
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.layout import Drawing, Report

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


#: Letters that a result's repr says of it, and rows of its table in a notebook, at most.
_LINE = 100
_ROWS = 60


class Result:
    """Base of the results; `print(result)` shows what the command prints.

    Each carries `to_dict()` (what `--json` prints), `to_frame()`, `plot()` and `exit_status`.
    """

    __slots__ = ()

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report | None:
        """Return the result in words and tables; None where its text has no such parts.

        drawings : figures of a page, beside which it says more.
        """
        return None

    @property
    def text(self) -> str:
        """What the command prints, as plain text."""
        from tdfscal.reporting.text import render

        report = self.to_report()
        return "" if report is None else render(report, whole=False)

    def shown(self, *, whole: bool) -> str:
        """Return what the command prints, in colours on a terminal; whole : not the summary."""
        from tdfscal.reporting.text import shown

        report = self.to_report()
        if report is None:
            return without_exponent(self.text)
        # Standard error has had them; a numbered report, printed whole, stands for itself.
        if not report.number or (report.summary and not whole):
            report = replace(report, warnings=())
        return shown(report, whole=whole)

    def document(self) -> dict[str, Any]:
        """Return what is the result's own, as plain JSON values, SI units."""
        return {}

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON values, as `--json` prints them: command, findings, and its own."""
        found = documents(getattr(self, "findings", ()))
        return {"command": getattr(self, "command", ""), "findings": found, **self.document()}

    def table(self) -> Mapping[str, Any]:
        """Return the result's main table by column, SI units."""
        return {}

    def to_frame(self) -> pd.DataFrame:
        """Return the result's main table."""
        import pandas as pd

        return pd.DataFrame(self.table())

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figures of this result, each named."""
        return ()

    def plot(self, name: str | Drawing | None = None) -> Figure:
        """Draw one of the result's figures; the first, unless named; its table, where it has none.

        Raises UsageError where there is no such figure.
        """
        from tdfscal.reporting.figures.style import of_table, to_figure

        name = getattr(name, "name", name)  # of a drawing
        drawings = {drawing.name: drawing for drawing in self.drawings()}
        if name is not None and name not in drawings:
            hint = f"choose from {', '.join(drawings)}" if drawings else "name none: the table"
            raise UsageError(f"there is no figure {name!r}", hint=hint)
        if not drawings:
            return of_table(self.to_frame())
        return to_figure(drawings[name] if name else next(iter(drawings.values())))

    @property
    def html(self) -> str:
        """The result as a page; empty where it has none."""
        from tdfscal.reporting.html import render

        page = self.to_report(self.drawings())
        return "" if page is None else render(page)

    def write(self, path: Path, holds: str) -> None:
        """Write one of its texts, such as `html`, to a file. Raises UsageError."""
        write_text(path, getattr(self, holds))

    @property
    def notes(self) -> tuple[str, ...]:
        """What the command says on standard error beside the result."""
        report = self.to_report()
        return () if report is None else report.warnings

    @property
    def exit_status(self) -> int:
        """Status with which the command ends: 1 where the result is a refusal."""
        return 0

    @property
    def kept(self) -> bool:
        """A folder holds it, so that the command's text only reports."""
        return False

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        first = self.text.strip().partition("\n\n")[0]
        return f"{type(self).__name__}: {shorten(first, _LINE, placeholder=' …')}"

    def _repr_html_(self) -> str:
        """Return verdict and tables as a notebook shows them, angles in mrad."""
        report = self.to_report()
        if report is None:
            head = f"<pre>{escape(repr(self))}</pre>"
            return head + self.to_frame().to_html(max_rows=_ROWS, index=False)
        from tdfscal.reporting.html import card

        return card(report)

    def __dir__(self) -> list[str]:
        """Return what is the result's own, without what a library or Python adds."""
        names = {name for name in object.__dir__(self) if not name.startswith(("_", "model_"))}
        return sorted(name for name in names if hasattr(self, name))


@record(eq=False, kw_only=True)
class CommandResult(Result):
    """Base of the results that are no file. command : line, or function, that asked for it."""

    command: str = ""

    @property
    def exit_status(self) -> int:
        """1 where a finding rejects the result."""
        return int(bool(rejecting(getattr(self, "findings", ()))))


def by_column(names: str, rows: Iterable[Sequence[Any]]) -> dict[str, list[Any]]:
    """Return rows as columns of these names, which stand between spaces."""
    whole = list(rows)
    return {name: [row[k] for row in whole] for k, name in enumerate(names.split())}


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

    def __init__(self, *_: Any, **__: Any) -> None:
        what = "a Calibration is made by `calibrate`, or read by `load_calibration`"
        raise UsageError(what, hint="call one of these")

    @classmethod
    def of(cls, file: CalibrationFile) -> Self:
        """Take over the content of a checked calibration file."""
        made = cls.model_construct(**{name: getattr(file, name) for name in cls.model_fields})
        made._source = file._source
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
        """Return the content of the file as plain JSON values, what was found first."""
        content = file_content(self)
        return {key: content[key] for key in ("command", "findings")} | content

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

    Raises UsageError where it cannot be read or is no calibration file, DataError for one that is
    of a newer format, is not whole or contradicts itself.
    """
    return read_source(path)[1]


def read_source(source: CalibrationSource) -> tuple[str, Calibration]:
    """Return the name that a calibration goes by in messages, and the calibration."""
    if isinstance(source, CalibrationFile):
        known = source if isinstance(source, Calibration) else Calibration.of(source)
        return IN_MEMORY, known
    if str(source) == "-":
        name, raw = "standard input", sys.stdin.buffer.read()
        kind, read = kind_by(raw, raw), partial(parse_calibration, raw, name)
    else:
        path = as_path(source)
        protect([path])
        name, kind, read = str(path), kind_of(path), partial(load_file, path)
    try:
        if kind in ("", CALIBRATION, DOCUMENT):  # of a long one the head does not tell
            return name, Calibration.of(read())
    except DataError as error:
        if kind == CALIBRATION:
            raise
        if not kind:
            raise UsageError(error.what, where=error.where, hint=error.hint) from error
    raise UsageError(
        f"is {kind}; a calibration file is wanted here",
        where=name,
        hint="name the .yaml or .json file that calibrate wrote",
    )


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


def angle_rows(calibration: CalibrationFile) -> Iterator[tuple[Any, ...]]:
    """Return what stands under `ANGLE_COLUMNS`, nan for what is unknown."""
    for s in calibration.mounted:
        each = (s.rpy, s.rpy_std, s.interval.low, s.interval.high)
        yield from each_angle([s.name], *(np.array([row], float) for row in each))


def each_angle(names: Iterable[str], *columns: FloatArray) -> Iterator[tuple[Any, ...]]:
    """Return rows of a sensor's name, an angle's, and each column's (n, 3) value of it."""
    for i, name in enumerate(names):
        for j, angle in enumerate(ANGLES):
            yield (name, angle, *(column[i, j].item() for column in columns))
