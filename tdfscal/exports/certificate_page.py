"""The draft certificate as a page to print: the content of the DCC."""

from __future__ import annotations

from tdfscal.exports.certificate import BLANK, DRAFT, ambient, days
from tdfscal.exports.words import origin
from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.html import render
from tdfscal.reporting.layout import Facts, Report, Section, Table, by_angle
from tdfscal.reporting.phrases import inputs_table
from tdfscal.reporting.traceability import decision_rule
from tdfscal.significance import COVERAGE_FACTOR, EXPANDED_COVERAGE

_K = f"U, k = {COVERAGE_FACTOR:g}"


def certificate_page(c: Calibration) -> str:
    """Return one HTML page: object, dates, conditions, method, results with U, statements."""
    return render(certificate_report(c))


def certificate_report(c: Calibration) -> Report:
    """Lay the draft certificate out."""
    begin, end = days(c)
    span = ambient(c)
    machine = f"{c.rig.name}, {c.rig.serial}" if c.rig.serial else c.rig.name
    facts = (
        ("Identifier", f"DRAFT-{c.created}-{c.rig.sha256[:12]}"),
        ("Object", f"force sensors of {machine}"),
        ("Measured", begin if begin == end else f"{begin} to {end}"),
        ("Ambient temperature", f"{span[0]:.2f} to {span[1]:.2f} °C" if span else BLANK),
        ("Laboratory", BLANK),
        ("Customer", BLANK),
        ("Responsible person, signature", BLANK),
    )
    statement = (
        f"U is the expanded uncertainty with the coverage factor k = {COVERAGE_FACTOR:g}, which "
        f"covers {EXPANDED_COVERAGE:.1%} of a normal distribution (JCGM 100)."
    )
    stated = (*origin(c), f"Command: {c.command}", f"Decision rule: {decision_rule(c)}.")
    return Report(
        title="Calibration certificate (draft)",
        subtitle=c.rig.name,
        verdict=c.status.upper(),
        accepted=c.status == "accepted",
        claim=DRAFT,
        sections=(
            Section("Object and measurement", (Facts(facts), _sensors(c))),
            Section("Results", (_angles(c), _zeros(c), statement)),
            Section("Method and statements", (*stated, inputs_table(c.inputs))),
        ),
        created=c.created,
    )


def _sensors(c: Calibration) -> Table:
    rows = []
    for support in c.rig.supports:
        papers = support.sensor
        stated = (papers.serial, papers.certificate, papers.due) if papers else ("", "", "")
        rows.append((support.name, *(text or BLANK for text in stated)))
    return Table("Sensors", ("sensor", "serial number", "certificate", "due"), tuple(rows), left=4)


def _angles(c: Calibration) -> Table:
    rows = by_angle(
        [s.name for s in c.mounted],
        lambda i, k: (
            f"{1e3 * c.mounted[i].rpy[k]:.3f}",
            f"{1e3 * COVERAGE_FACTOR * c.mounted[i].rpy_std[k]:.3f}",
        ),
    )
    return Table("Installation angles, mrad", ("sensor", "angle", "value", _K), rows, left=2)


def _zeros(c: Calibration) -> Table:
    rows = tuple(
        (s.name, axis, f"{value:.2f}", "open" if std is None else f"{COVERAGE_FACTOR * std:.2f}")
        for s in c.supports
        for axis, value, std in zip("xyz", s.zero, s.zero_std, strict=True)
        if value is not None
    )
    return Table("Zero offsets, N, sensor frames", ("sensor", "axis", "value", _K), rows, left=2)
