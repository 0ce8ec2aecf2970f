"""The content of a report page: words, tables and figures in the order of reading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.figures import drawings
from tdfscal.reporting.figures.style import Drawing
from tdfscal.reporting.figures.timeline import SHOWN
from tdfscal.reporting.summary import METHODS, Summary, summarise
from tdfscal.reporting.tables import Table


@dataclass(frozen=True, slots=True)
class Section:
    """A figure, a table, or both."""

    title: str
    reading: str
    drawing: Drawing | None = None
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True, slots=True)
class Headline:
    """The box at the head of a page that is no calibration's own; as the parts of a Summary."""

    title: str
    subtitle: str
    accepted: bool
    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    advice: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Page:
    """One calibration, or one validation.

    tiles : name, number, remark; what a reader sees at a glance.
    """

    summary: Summary | Headline
    created: str
    claim: str
    tiles: tuple[tuple[str, str, str], ...]
    sections: tuple[Section, ...]
    provenance: tuple[tuple[str, str], ...]
    inputs: Table
    absent: tuple[str, ...]


def compose(c: Calibration) -> Page:
    """Work out a page from a calibration file's content."""
    summary = summarise(c)
    found = {drawing.name: drawing for drawing in drawings(c)}
    beside = {
        "angles": (_angles(summary),),
        "residuals": (_proof(summary),) if summary.proof else (),
        "timeline": (_left_out(summary),) if len(summary.rejected) > SHOWN else (),
        "rig": _terminal(c, summary),
    }
    return Page(
        summary=summary,
        created=c.created.replace("T", " ").replace("Z", " UTC"),
        claim=_claim(c),
        tiles=_tiles(c),
        sections=tuple(
            Section(drawing.title, drawing.reading, drawing, beside.get(name, ()))
            for name, drawing in found.items()
        ),
        provenance=_provenance(c),
        inputs=Table(
            "Input files",
            ("file", "SHA-256", "bytes", "integrity"),
            tuple((f.path, f.sha256, f"{f.bytes:,}", f.integrity) for f in c.inputs),
            left=2,
        ),
        absent=_absent(c, set(found)),
    )


def _claim(c: Calibration) -> str:
    """Say in one sentence what was achieved."""
    said = f"Every angle is known to {1e3 * c.rpy_std.max():.2g} mrad or better"
    if c.validation is not None:
        v = c.validation.force
        said += (
            f"; the false contact force falls from {v.rms_before:.3g} N to {v.rms_after:.2g} N "
            "at postures held out"
        )
    return f"{said}."


def _tiles(c: Calibration) -> tuple[tuple[str, str, str], ...]:
    tiles = [
        (
            "weakest angle",
            f"{1e3 * c.rpy_std.max():.2g} mrad",
            f"limit {1e3 * c.rig.acceptance.angle_std:.2g} mrad",
        )
    ]
    if c.validation is not None:
        v = c.validation
        tiles.append(
            (
                "false contact force",
                f"{v.force.rms_after:.2g} N",
                f"before {v.force.rms_before:.3g} N",
            )
        )
        tiles.append(
            (
                "false contact moment",
                f"{v.moment.rms_after:.2g} N·m",
                f"before {v.moment.rms_before:.3g} N·m",
            )
        )
    if c.fit is not None:
        total = c.fit.postures + len(c.fit.rejected)
        tiles.append(("postures", f"{c.fit.postures} of {total}", "in the fit"))
        tiles.append(
            (
                "residuals / expected",
                f"{c.fit.birge:.2f}",
                f"limit {c.rig.acceptance.birge_max:.2g}",
            )
        )
    elif c.tracker is not None and isinstance(birge := c.tracker.get("birge"), float):
        tiles.append(("points", f"{c.tracker.get('points')}", "of the survey"))
        tiles.append(
            (
                "residuals / expected",
                f"{birge:.2f}",
                f"limit {c.rig.acceptance.birge_max:.2g}",
            )
        )
    return tuple(tiles)


def _angles(s: Summary) -> Table:
    """Split the interval into two columns, and name each row's sensor."""
    header, rows = s.angle_table()
    place = header.index("95 % interval")
    return Table(
        f"{s.angle_title}; rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
        (*header[:place], "95 % from", "to", *header[place + 1 :]),
        tuple(
            (
                angle.support,
                *row[1:place],
                f"{angle.low:.3f}",
                f"{angle.high:.3f}",
                *row[place + 1 :],
            )
            for angle, row in zip(s.angles, rows, strict=True)
        ),
        left=2,
    )


def _proof(s: Summary) -> Table:
    return Table(
        "Contact wrench that remains at postures held out, about the LCS origin",
        ("", "rms before", "rms after", "largest before", "largest after"),
        s.proof,
    )


def _left_out(s: Summary) -> Table:
    rows = tuple(tuple(text.split(": ", 1)) for text in s.rejected)
    return Table("Rejected postures", ("posture", "reason"), rows, left=2)


def _terminal(c: Calibration, s: Summary) -> tuple[Table, ...]:
    mass, bary = c.terminal.mass, c.terminal.barycenter
    rows = [("mass, kg", f"{mass.value:.3f}", _std(mass.std, 3))]
    rows += [
        (f"barycentre {axis}, mm", f"{1e3 * value:.3f}", _std(std, 3, 1e3))
        for axis, value, std in zip("xyz", bary.value, bary.std, strict=True)
    ]
    terminal = Table("Terminal after the adjustment, LCS", ("", "value", "std. unc."), tuple(rows))
    zeros = Table("Zero offsets, N, sensor frames", ("sensor", "x", "y", "z"), s.zeros)
    return (zeros, terminal) if s.zeros else (terminal,)


def _std(value: float | None, digits: int, scale: float = 1.0) -> str:
    return "open" if value is None else f"{scale * value:.{digits}f}"


def _provenance(c: Calibration) -> tuple[tuple[str, str], ...]:
    estimator = {"ml": "maximum likelihood", "linear": "linear (the paper's)", None: ""}[
        c.estimator
    ]
    rows = [
        ("Method", METHODS[c.method] + (f", {estimator}" if estimator else "")),
        ("Command", c.command),
        ("Created", c.created),
        ("Software", f"{c.software.name} {c.software.version}"),
        ("Seed", str(c.seed)),
        ("Rig file", f"{c.rig.name}, SHA-256 {c.rig.sha256}"),
        ("Convention", c.convention),
        ("Covariance", c.covariance.definition),
    ]
    rows += _statistics(c)
    return tuple(rows)


def _statistics(c: Calibration) -> list[tuple[str, str]]:
    """Statistics of the fit, and the largest correlation between two angles."""
    rows = [(name, text) for name, text in summarise(c).facts if name != "Postures"]
    std = np.sqrt(np.diagonal(c.rotation_covariance))
    if np.all(std > 0):
        off = c.rotation_covariance / np.outer(std, std) - np.eye(len(std))
        a, b = np.unravel_index(int(np.abs(off).argmax()), off.shape)
        names = c.covariance.parameters
        rows.append(("Correlation", f"largest {off[a, b]:+.2f}, between {names[a]} and {names[b]}"))
    return rows


def _absent(c: Calibration, drawn: set[str]) -> tuple[str, ...]:
    """What the page does not show, and why."""
    notes = []
    if c.method != "tracker" and "residuals" not in drawn:
        notes.append(
            "This file holds no single postures, so neither their residuals nor the log's timeline "
            "can be drawn; calibrate again to have them."
        )
    if c.method == "tracker":
        notes.append("A tracker survey has no postures: no residual wrench and no timeline.")
    if "trials" not in drawn:
        notes.append(
            "A joint result has no Monte Carlo of its own; see each method alone."
            if c.method == "joint"
            else "No Monte Carlo histogram: the trials were switched off, or not kept."
        )
    if "survey" not in drawn and c.method != "self":
        notes.append("This file holds no residuals of single points; calibrate again to have them.")
    return tuple(notes)
