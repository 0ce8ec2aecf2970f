"""Phrases that several reports share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from tdfscal.catalogue import sentence
from tdfscal.files.calibration.evidence_model import LeftOutStretch
from tdfscal.files.calibration.log_time import Clock
from tdfscal.files.calibration.parts import ClockResult, Input, RejectedPosture, ResidualWrench
from tdfscal.records import InputFile, RecorderClock
from tdfscal.reporting.layout import Items, Row, Section, Table

if TYPE_CHECKING:
    from tdfscal.comparison.compatibility import Comparison
    from tdfscal.motioncal.blocks import Stretch

METHODS = {
    "self": "self-calibration",
    "tracker": "laser-tracker calibration",
    "joint": "joint calibration, self and tracker",
}

#: Parts of a wrench with their units.
WRENCH = {"force": "N", "moment": "N·m"}


def inputs_table(inputs: Iterable[Input | InputFile], caption: str = "Input files") -> Table:
    """Files with their digests."""
    rows = tuple((f.path, f.sha256, f"{f.bytes:,}", _stated(f)) for f in inputs)
    return Table(caption, ("file", "SHA-256", "bytes", "integrity"), rows, left=2)


def _stated(file: Input | InputFile) -> str:
    return file.integrity if file.note is None else f"{file.integrity}; {file.note}"


def residual_table(found: Mapping[str, ResidualWrench], where: str) -> Table:
    """What is left of force and moment."""
    rows = tuple(
        (name, *(f"{size:.3g} {WRENCH[name]}" for size in
                 (w.rms_before, w.rms_after, w.max_before, w.max_after)))
        for name, w in found.items()
    )  # fmt: skip
    header = ("", "rms before", "rms after", "largest before", "largest after")
    return Table(f"Residual contact wrench, {where}", header, rows)


def residual_tiles(found: Mapping[str, ResidualWrench]) -> tuple[Row, ...]:
    """The same at a glance."""
    return tuple(
        (f"residual contact {name}", f"{w.rms_after:.2g} {WRENCH[name]}",
         f"before {w.rms_before:.3g} {WRENCH[name]}")
        for name, w in found.items()
    )  # fmt: skip


def stretches(left_out: Iterable[Stretch | LeftOutStretch]) -> tuple[str, ...]:
    """Stretches of a motion with why each was left out."""
    return tuple(f"{s.begin:.2f} to {s.end:.2f} s: {reason(s)}" for s in left_out)


def reason(left_out: Stretch | LeftOutStretch) -> str:
    """Return why a stretch was left out."""
    return left_out.reason if isinstance(left_out, LeftOutStretch) else sentence(left_out.reason)


def postures(rejected: Iterable[RejectedPosture], clock: Clock) -> tuple[str, ...]:
    """Rejected postures with when and why."""
    found = []
    for r in rejected:
        dated = r.start is not None and r.end is not None
        when = f" ({clock.stretch(r.start or 0.0, r.end or 0.0)})" if dated else ""
        found.append(f"posture {r.index + 1}{when}: {r.reason}")
    return tuple(found)


def not_shown(notes: Sequence[str]) -> tuple[Section, ...]:
    """What a page does not show, and why."""
    said = (Items("", tuple(notes)),)
    return (Section("What this page does not show", said, page_only=True),) if notes else ()


def chi_squared(chi2: float, dof: int, p: float) -> str:
    """A test in words."""
    return f"χ² = {chi2:.4g} for {dof} degrees of freedom, p = {probability(p)}"


def probability(p: float) -> str:
    """Two digits where they say something, else the magnitude."""
    return f"{p:.2f}" if p >= 0.01 else f"{p:.1g}"


def told_clock(clock: ClockResult | RecorderClock) -> str:
    """Write how far a recorder's clock is from the first one's."""
    digits = ".4f" if abs(clock.offset) >= 1e3 else ".6g"
    return (
        f"its clock is {clock.offset:+{digits}} s from the first one's, ± "
        f"{1e3 * clock.offset_std:.2g} ms, and faster by {1e6 * clock.rate:.3g} ± "
        f"{1e6 * clock.rate_std:.2g} ppm"
    )


def utc(instant: str) -> str:
    """An ISO 8601 instant as people read it."""
    return instant.replace("T", " ").replace("Z", " UTC")


def verdict(c: Comparison) -> str:
    """Return whether two calibrations agree, in words."""
    said = sentence(c.finding)
    return said if c.obstacle is None else f"{sentence(c.obstacle)} ({said})"
