"""The page of a validation: does the calibration still hold, and if not, why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal import __version__
from tdfscal.files.calibration.document import Calibration
from tdfscal.records import InputFile
from tdfscal.reporting.figures.residuals import paint
from tdfscal.reporting.figures.style import Drawing
from tdfscal.reporting.page import Headline, Page, Section
from tdfscal.reporting.summary import METHODS
from tdfscal.reporting.tables import Table
from tdfscal.reporting.verdict import describe, lengths, postures, reasons, totals
from tdfscal.significance import DETECTION_POWER
from tdfscal.validation.residual_wrench import Validation

#: At most as many postures are listed one by one.
_LISTED = 40
_KEEP = (
    "Keep this calibration in use.",
    "Validate it again in a month, and after every work on a sensor, a hinge or the terminal.",
)
_RENEW = (
    "Do not steer by this calibration until the cause is found.",
    "Undo the cause and validate again; where that is not possible, calibrate again.",
)


@dataclass(frozen=True, slots=True)
class Origin:
    """What a validation was made of. calibration : its file. created : UTC, in words."""

    calibration: str
    command: str
    created: str
    inputs: tuple[InputFile, ...]


def compose_validation(
    v: Validation, c: Calibration, warnings: Sequence[str], origin: Origin
) -> Page:
    """Work out the page; warnings are what the command says on standard error too."""
    told = reasons(v)
    claim, why = (" ".join(told), ()) if v.holds else ("", tuple(told))
    head = Headline(
        title=v.rig.name,
        subtitle=f"validation of {origin.calibration}, a {METHODS[c.method]} of "
        f"{c.created[:10]}, on {len(v.used)} postures",
        accepted=v.holds,
        verdict="STILL VALID" if v.holds else "RECALIBRATE",
        reasons=(*why, *(describe(v, cause) for cause in v.suspected)),
        warnings=tuple(warnings),
        advice=_KEEP if v.holds else _RENEW,
    )
    return Page(
        summary=head,
        created=origin.created,
        claim=claim,
        tiles=_tiles(v),
        sections=(_residuals(v), _power(v)),
        provenance=_provenance(v, c, origin),
        inputs=Table(
            "Logs",
            ("file", "SHA-256", "bytes", "integrity"),
            tuple((f.path, f.sha256, f"{f.bytes:,}", f.integrity) for f in origin.inputs),
            left=2,
        ),
        absent=tuple(f"Posture {k + 1}: {why}" for k, why in sorted(v.left_out.items())),
    )


def _tiles(v: Validation) -> tuple[tuple[str, str, str], ...]:
    before, after = (_rms(wrench) for wrench in (v.nominal, v.calibrated))
    return (
        ("postures", f"{len(v.used)} of {len(v.dwells)}", "in the test"),
        ("false contact force", f"{after[0]:.2g} N", f"uncalibrated {before[0]:.3g} N"),
        ("false contact moment", f"{after[1]:.2g} N·m", f"uncalibrated {before[1]:.3g} N·m"),
        ("χ² / degrees of freedom", f"{v.chi2 / v.dof:.2f}", f"p = {v.p_value:.2g}"),
    )


def _rms(wrench: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[float]:
    return [float(x) for x in np.sqrt(np.mean(lengths(wrench) ** 2, axis=0))]


def _residuals(v: Validation) -> Section:
    before, after = lengths(v.nominal), lengths(v.calibrated)
    worst = int(after[:, 0].argmax())
    drawing = Drawing(
        "validation",
        "False contact wrench at each posture",
        f"Nothing should touch the terminal at these postures, so that no force should be left; "
        f"the largest is {after[worst, 0]:.2g} N, at posture {v.used[worst] + 1}.",
        lambda: paint(v.used + 1, before, after, "after: with this calibration"),
    )
    header, rows = totals(v)
    names, cells = postures(v, _LISTED)
    which = "Postures" if len(v.used) <= _LISTED else f"The {_LISTED} worst postures"
    return Section(
        drawing.title,
        drawing.reading,
        drawing,
        (
            Table("Contact wrench that should be zero, LCS, about its origin", header, tuple(rows)),
            Table(
                f"{which}, calibrated; u is the standard uncertainty",
                ("posture", *names[1:]),
                tuple(cells),
            ),
        ),
    )


def _power(v: Validation) -> Section:
    rows = tuple(
        (name, *("none" if not np.isfinite(t) else f"{1e3 * t:.2f}" for t in turn))
        for name, turn in zip(v.rig.supports, v.detectable, strict=True)
    )
    return Section(
        "What these postures would have shown",
        "The smallest turn of a single sensor that is found with a probability of "
        f"{DETECTION_POWER:.0%}; more postures, more tilt and a squeeze make it smaller.",
        tables=(Table("Turn about the BCS's axes, mrad", ("sensor", "x", "y", "z"), rows),),
    )


def _provenance(v: Validation, c: Calibration, origin: Origin) -> tuple[tuple[str, str], ...]:
    return (
        ("Calibration", f"{origin.calibration}, {METHODS[c.method]}, {c.created}, {c.status}"),
        ("Command", origin.command),
        ("Created", origin.created),
        ("Software", f"tdfscal {__version__}"),
        ("Test", f"χ² = {v.chi2:.4g} for {v.dof} degrees of freedom, p = {v.p_value:.2g}"),
        ("Single causes", f"the likeliest by chance alone: p = {v.search_p:.2g}"),
        ("Convention", c.convention),
    )
