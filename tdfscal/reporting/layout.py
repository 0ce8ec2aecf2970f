"""What a report says, laid out once: words, tables and figures in the order of reading.

A builder turns a result into a `Report`; `text` and `html` print any report, and
add nothing of their own. Below stand the parts that several reports share.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from operator import attrgetter
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, cast

from tdfscal.catalogue import sentence
from tdfscal.catalogue.numbers import measured, p_text, rounded, two_digits, typeset, with_std
from tdfscal.errors import visible, without_exponent
from tdfscal.files.saving import plain as as_json
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.records import ANGLES, RecorderClock
from tdfscal.reporting.figures import Drawing as Drawing

if TYPE_CHECKING:
    from tdfscal.files.calibration.evidence import ClockResult, LeftOutStretch, ResidualWrench
    from tdfscal.files.rig.recorders import LogBlock
    from tdfscal.motioncal.blocks import Stretch

Row = tuple[str, ...]
#: The text of a table's column for the angle j of the sensor i.
Cell = Callable[[int, int], str]

#: Share of a stated standard uncertainty, from which on the data have told nothing more.
_AS_STATED = 0.9
LISTED = 8
"""Sentences of a list that a terminal shows at most; two lists of them fill half a screen."""
PHONE = 52
"""Letters that stand beside each other on a telephone."""
ROWS = 10
"""Rows of a summary's table: with what stands above and below they fit a terminal's 24 lines."""


@record
class Table:
    """Rows of text under a header; the first `left` columns are words, the others numbers."""

    caption: str
    header: Row
    rows: tuple[Row, ...]
    left: int = 1

    @property
    def wide(self) -> bool:
        """A telephone has no room for all columns beside each other, folded at their spaces."""
        columns = zip(self.header, *self.rows, strict=True)
        words = ([len(word) for cell in column for word in cell.split(" ")] for column in columns)
        return sum(max(column) + 1 for column in words) > PHONE

    def brief(self) -> Table:
        """The same, cut to `ROWS` rows and the number of the others."""
        more = len(self.rows) - ROWS
        if more <= 1:  # that there is one takes its line
            return self
        last = (f"… {more} more", *[""] * (len(self.header) - 1))
        return replace(self, rows=(*self.rows[:ROWS], last))


@record
class Facts:
    """Names with what is to be said of each; verbatim : commands, paths, digests as they are."""

    rows: tuple[tuple[str, str], ...]
    verbatim: bool = False


@record
class Items:
    """A list of sentences under a caption."""

    caption: str
    items: tuple[str, ...]


#: A str is a paragraph.
Block = Table | Facts | Items | str


@record
class Section:
    """Blocks that belong together, on a page under a title, with a figure.

    reading : what the figure shows, one sentence. page_only : details that text leaves out.
    """

    title: str
    blocks: tuple[Block, ...] = ()
    reading: str = ""
    drawing: Drawing | None = None
    page_only: bool = False


@record
class Report:
    """A result as a reader meets it: verdict, reasons, evidence, what next.

    verdict : one or two words in capitals; none where nothing is judged. accepted,
    provisional : its colour.
    claim : what was achieved, in a sentence. tiles : name, number, remark; seen at a glance.
    number : of the report, on every printed page.
    summary : blocks that a terminal shows in place of the sections, unless asked for all.
    """

    title: str
    subtitle: str = ""
    verdict: str = ""
    accepted: bool = True
    provisional: bool = False
    claim: str = ""
    reasons: tuple[str, ...] = ()
    tiles: tuple[Row, ...] = ()
    summary: tuple[Block, ...] = ()
    sections: tuple[Section, ...] = ()
    warnings: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    created: str = ""
    number: str = ""

    @property
    def mark(self) -> str:
        """The verdict at a glance."""
        return "✗" if not self.accepted else "!" if self.provisional else "✓"

    def blocks(self, *, whole: bool = True) -> Iterator[Block]:
        """Blocks of a rendering without pages; warnings and advice are its end."""
        if self.summary and not whole:
            for block in self.summary:
                yield block.brief() if isinstance(block, Table) else block
            return
        for section in self.sections:
            yield from () if section.page_only else section.blocks


def legible(report: Report, minus: str) -> Report:
    """The same with one sign of negative numbers, and a visible escape of what does not print.

    Names, paths and foreign files may hold anything; drawings make outlines of their text.
    """
    return cast(Report, _mapped(report, minus))


def _mapped(part: object, minus: str) -> object:
    if isinstance(part, str):
        return typeset(without_exponent(visible(part)), minus) if minus else visible(part)
    if isinstance(part, tuple):
        return tuple(_mapped(each, minus) for each in part)
    if isinstance(part, Report | Section | Table | Facts | Items):
        minus = "" if isinstance(part, Facts) and part.verbatim else minus
        own = ((f.name, getattr(part, f.name)) for f in fields(part))
        changes: dict[str, Any] = {name: _mapped(value, minus) for name, value in own}
        return type(part)(**changes)
    return part


def illustrated(
    drawings: tuple[Drawing, ...], blocks: Mapping[str, tuple[Block, ...]]
) -> list[Section]:
    """Sections of figures with the blocks beside them, by the figure's name; then blocks alone."""
    sections = [Section(d.title, blocks.get(d.name, ()), d.reading, d) for d in drawings]
    drawn = {drawing.name for drawing in drawings}
    alone = (beside for name, beside in blocks.items() if beside and name not in drawn)
    return [*sections, *(Section("", beside) for beside in alone)]


#: Parts of a wrench with their units.
WRENCH = {"force": "N", "moment": "N·m"}
METHODS = {
    "self": "self-calibration",
    "tracker": "laser-tracker calibration",
    "joint": "joint calibration, self and tracker",
}


def by_angle(names: Iterable[str], *columns: Cell) -> tuple[Row, ...]:
    """Rows of a sensor's and an angle's name with each column's cell of this sensor and angle."""
    return tuple(
        (name, angle, *(cell(i, j) for cell in columns))
        for i, name in enumerate(names)
        for j, angle in enumerate(ANGLES)
    )


def mrad(values: Any, form: str = ".3f") -> Cell:
    """Cells of values (n, 3), rad, in mrad."""
    return lambda i, j: format(1e3 * values[i, j], form)


def residual_table(
    found: Mapping[str, ResidualWrench],
    where: str,
    expected: Mapping[str, float] | None = None,
    called: str = "rms expected",
) -> Table:
    """What is left of force and moment; expected : the rms that it may be, by the same names."""
    rows = []
    for name, w in found.items():
        sizes = [w.rms_before, w.rms_after, w.max_before, w.max_after]
        sizes += [expected[name]] if expected else []
        told = (
            f"{measured(x, 3)} {WRENCH[name]}" if math.isfinite(x) else "unknown" for x in sizes
        )
        rows.append((name, *told))
    header = ("", "rms before", "rms after", "largest before", "largest after", called)
    cut = header if expected else header[:-1]
    return Table(f"Residual contact wrench, {where}", cut, tuple(rows))


def residual_tiles(found: Mapping[str, ResidualWrench]) -> tuple[Row, ...]:
    """The same at a glance."""
    return tuple(
        (f"residual contact {name}", f"{two_digits(w.rms_after)} {WRENCH[name]}",
         f"before {measured(w.rms_before, 3)} {WRENCH[name]}")
        for name, w in found.items()
    )  # fmt: skip


def stretches(left_out: Iterable[Stretch | LeftOutStretch]) -> tuple[str, ...]:
    """Stretches of a motion with why each was left out, in words of a file or as a finding."""
    said = ((s, s.reason if isinstance(s.reason, str) else sentence(s.reason)) for s in left_out)
    return tuple(f"{s.begin:.2f} to {s.end:.2f} s: {why}" for s, why in said)


def rejected(left_out: Mapping[int, Finding]) -> tuple[str, ...]:
    """Postures that were left out, by their index, with why."""
    return tuple(f"posture {k + 1}: {sentence(why)}" for k, why in sorted(left_out.items()))


def listed(caption: str, items: Iterable[str]) -> tuple[Items, ...]:
    """A list of sentences, where there are any."""
    found = tuple(items)
    return (Items(caption, found),) if found else ()


def chi_squared(chi2: float, dof: int, p: float | None) -> str:
    """A test in words; none where the noise's spectrum was fitted to the same residuals."""
    tested = "spectrum fitted to it" if p is None else p_text(p)
    return f"χ² = {rounded(chi2, 4)} for {dof} degrees of freedom, {tested}"


def told_clock(clock: ClockResult | RecorderClock, recorders: Iterable[LogBlock]) -> str:
    """Write how far a recorder's clock is from the first one's; recorders : what is stated."""
    stated = [r.clock.rate_std for r in recorders if r.files == clock.recorder]
    rate = f"{with_std(1e6 * abs(clock.rate), 1e6 * INTERVAL_FACTOR * clock.rate_std)} ppm"
    if clock.rate_std > _AS_STATED * max(stated, default=math.inf):
        rate += ", no better known than stated"
    offset = with_std(clock.offset, INTERVAL_FACTOR * clock.offset_std, "+")
    way = "slower" if clock.rate < 0 else "faster"
    return f"its clock is {offset} s from the first one's, and {way} by {rate} (95 %)"


def short(names: Sequence[str]) -> tuple[str, ...]:
    """The files' names without their folders, where these still tell one from another."""
    last = tuple(PurePath(name).name for name in names)
    return last if len(set(last)) == len(last) else tuple(names)


def utc(instant: str) -> str:
    """An ISO 8601 instant as people read it."""
    return instant.replace("T", " ").replace("Z", " UTC")


def plain(value: Any) -> Any:
    """Records and arrays, and what holds them, as JSON values; None for what is not finite."""
    return as_json(value, null=lambda number: not math.isfinite(number))


def document(record: object, names: str, **more: Any) -> dict[str, Any]:
    """These fields of a record, and more, as plain JSON values.

    `key=field` renames one; `key=part.field` is of a part.
    """
    named = (name.partition("=") for name in names.split())
    fields = {key: attrgetter(field or key)(record) for key, _, field in named}
    return {key: plain(value) for key, value in (fields | more).items()}


def each_named(names: Iterable[str], called: str = "name", **columns: Any) -> list[dict[str, Any]]:
    """Rows of a name with each column's value, as plain JSON values; called : the name's key."""
    return [
        {called: name, **{key: plain(values[k]) for key, values in columns.items()}}
        for k, name in enumerate(names)
    ]
