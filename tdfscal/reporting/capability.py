"""Thresholds and the smallest contact seen, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.catalogue import told
from tdfscal.detection.capability import Capability, Remedy, Request
from tdfscal.findings import Finding, rejecting
from tdfscal.reporting.layout import Block, Drawing, Items, Report, Section, Table, illustrated
from tdfscal.wrench.contact_wrench import COMPONENTS

#: Units of the components.
UNITS = ("N", "N", "N", "N·m", "N·m", "N·m")
#: Remedies that are told.
_TOLD = 3
_DO = {
    "tare": "tare each sensor before the run",
    "set-to-zero": "set the wrench to zero before the run, hanging free for 3 s",
    "weigh": "weigh the terminal, and find its barycentre, exactly",
    "calibrate": "calibrate twice as well: four times the postures, or a harder squeeze",
}


def capability_report(
    found: Capability, request: Request, remedies: Sequence[Remedy], findings: Sequence[Finding],
    about: tuple[float, float, float], drawings: tuple[Drawing, ...], *, timed: bool,
) -> Report:  # fmt: skip
    """Lay out thresholds, smallest contacts, what they come from, and what would help."""
    bad = rejecting(findings)
    place = f"({', '.join(f'{x:g}' for x in about)}) m" if any(about) else "its origin"
    band = "no filter" if request.cutoff is None else f"filter {request.cutoff:g} Hz"
    length = f"{found.duration:.4g} s" if timed else "postures, as if an hour long"
    header = ("axis", "", "threshold", "smallest contact", *(f"{s}" for s in found.shares))
    rows = tuple(
        (
            axis,
            unit,
            _number(found.threshold[k]),
            _number(found.smallest_contact[k]),
            *(_share(share[k]) for share in found.shares.values()),
        )
        for k, (axis, unit) in enumerate(zip(COMPONENTS, UNITS, strict=True))
    )
    blocks: tuple[Block, ...] = (Table("", header, rows, left=2),)
    if lines := tuple(_remedy(one, found) for one in remedies[:_TOLD]):
        blocks = (*blocks, Items("What lowers the smallest contact", lines))
    over = illustrated(drawings, {"capability": ()})
    return Report(
        "Contact that this rig sees",
        f"path of {length}; {band}; LCS, moments about {place}",
        verdict="NOT AS IT IS" if bad else "",
        accepted=not bad,
        claim=f"At most {request.false_stops:g} false stops an hour and axis; the smallest contact "
        f"exceeds its threshold with {request.detect:.4g} probability.",
        reasons=tuple(told(one) for one in bad),
        warnings=() if not drawings else tuple(told(f) for f in findings if not f.rejects),
        sections=(Section("", blocks), *over),
    )


def _remedy(remedy: Remedy, found: Capability) -> str:
    """What to do, and what the worst force and torque come down to."""
    now, then = found.smallest_contact, remedy.smallest_contact
    do = _DO.get(remedy.kind) or f"filter at {remedy.value:.3g} Hz"
    said = []
    for first, unit in ((0, "N"), (3, "N·m")):
        rows = slice(first, first + 3)
        if np.isfinite(now[rows]).any():
            worst = first + int(np.nanargmax(now[rows]))
            said.append(f"{COMPONENTS[worst]} {now[worst]:.3g} → {then[worst]:.3g} {unit}")
    return f"{do}: {', '.join(said)}"


def _number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "unknown"


def _share(value: float) -> str:
    return f"{value:.0%}" if np.isfinite(value) else "–"
