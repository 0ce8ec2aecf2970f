"""What every command's result can do: be printed, drawn, put into a table, written as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.catalogue import documents
from tdfscal.errors import UsageError
from tdfscal.files.saving import write_text
from tdfscal.frozen import replace
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
            return self.text
        # Standard error has had them; a numbered report, printed whole, stands for itself.
        if not report.number or (report.summary and not whole):
            report = replace(report, warnings=())
        return shown(report, whole=whole)

    def document(self) -> dict[str, Any]:
        """Return what is the result's own, as plain JSON values, SI units."""
        return {}

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON values: what was found, and the result's own.

        `--json` prints them behind the command line, `command`.
        """
        return {"findings": documents(getattr(self, "findings", ())), **self.document()}

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

    def plot(self, name: str | None = None) -> Figure:
        """Draw one of the result's figures; the first, unless named.

        Raises
        ------
        UsageError
            There is no such figure.
        """
        from tdfscal.reporting.figures.style import to_figure

        drawings = {drawing.name: drawing for drawing in self.drawings()}
        if not drawings:
            raise UsageError(f"{type(self).__name__} has no figure", hint="use to_frame()")
        if name is not None and name not in drawings:
            raise UsageError(
                f"there is no figure {name!r}", hint=f"choose from {', '.join(drawings)}"
            )
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


def by_angle(supports: Sequence[str], **values: FloatArray) -> dict[str, Any]:
    """Return values (n, 3) as columns, one row per support and angle."""
    n = len(supports)
    names = {"support": np.repeat(supports, 3), "angle": np.tile(ANGLES, n)}
    return names | {name: each.ravel() for name, each in values.items()}


def by_column(names: str, rows: Iterable[Sequence[Any]]) -> dict[str, list[Any]]:
    """Return rows as columns of these names, which stand between spaces."""
    whole = list(rows)
    return {name: [row[k] for row in whole] for k, name in enumerate(names.split())}
