"""A draft of a Digital Calibration Certificate (PTB DCC over D-SI).

A starting point, no certificate: laboratory and customer are blanks, and its head says so.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from math import floor, log10
from typing import Any

import numpy as np

from tdfscal.exports.statements import content_digest, number, origin
from tdfscal.files.calibration.consistency import UNCONFIRMED
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import SupportResult
from tdfscal.files.saving import xml_text
from tdfscal.numerics.distributions import coverage, student_dof
from tdfscal.records import ANGLES
from tdfscal.reporting import traceability
from tdfscal.reporting.calibration import statistics
from tdfscal.reporting.papers import measured_by
from tdfscal.significance import COVERAGE_FACTOR

SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
VERSION = "3.3.0"
BLANK = "to be completed"
DRAFT = (
    "DRAFT written by software. This is not an accredited calibration certificate and carries no "
    "signature; a laboratory must check and complete it."
)
#: Significant digits of an uncertainty, two of them to guard; of a number that has none.
_DIGITS, _BARE = 4, 9
Part = tuple[str, Any]  # name of an element and its text, or its parts; of D-SI behind `si:`
Expanded = tuple[float, float, float]  # half an interval, its factor, its coverage


def certificate(c: Calibration) -> str:
    """Return the draft as XML for the DCC's schema of `VERSION`, over D-SI 2.2."""
    for prefix, space in SPACES.items():
        ET.register_namespace(prefix, space)
    root = ET.Element(f"{{{SPACES['dcc']}}}digitalCalibrationCertificate", schemaVersion=VERSION)
    root.append(ET.Comment(f" {DRAFT} "))
    software = "software", [_name(c.software.name), ("release", c.software.version)]
    mark = "" if c.status == "accepted" else f"{c.status.upper()}: "
    name = _name(f"{mark}Installation rotations of force sensors (DRAFT)")
    said = [line for line in origin(c) if line not in traceability.doubts(c)]  # a warning says it
    result = [name, _description(DRAFT, *said, *_told(c))]
    files = [f"Input: {file.path}, SHA-256 {file.sha256}, {file.integrity}" for file in c.inputs]
    used = _description(f"Command: {c.command}", f"Rig file: SHA-256 {c.rig.sha256}", *files)
    method = "usedMethod", [_name(f"{c.method} calibration"), used]
    result += [("usedMethods", [method]), ("usedSoftware", [software])]
    if warm := c.dwells and c.dwells.temperature:
        ends = (("lowest temperature", min(warm)), ("highest temperature", max(warm)))
        data = "data", [_quantity(which, value, "\\degreecelsius") for which, value in ends]
        condition = "influenceCondition", [_name("Ambient temperature"), data]
        result.append(("influenceConditions", [condition]))
    all_std = {}
    if c.parameters is not None:
        variance = np.diagonal(np.array(c.parameters.matrix))
        all_std = dict(zip(c.parameters.parameters, np.sqrt(variance).tolist(), strict=True))
    results = [_sensor(support, all_std, linear=_linear(c)) for support in c.supports]
    of = f"covariance of {', '.join(c.covariance.parameters)}"
    data = "data", [_matrix(of, c.covariance.matrix, "\\radian\\tothe{2}")]
    together = [_name("All rotations together"), _description(c.covariance.definition), data]
    results.append(("result", together))
    result.append(("results", results))
    _grow(root, "administrativeData", [("dccSoftware", [software]), *_administration(c)])
    _grow(root, "measurementResults", [("measurementResult", result)])
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _linear(c: Calibration) -> bool:
    """The standard uncertainties tell the intervals: k = 2 then covers what it says."""
    return c.monte_carlo is None or not c.monte_carlo.decides


def _told(c: Calibration) -> list[str]:
    """What a reader must know of the numbers: warnings first, then the report's own facts."""
    digest = traceability.report_digest(c)
    facts = [("Report", f"{digest[:8]}, {content_digest(c)}")]
    facts += [("Unconfirmed", f.told) for f in c.found(UNCONFIRMED)]
    facts += [("REJECTED", f.told) for f in c.reasons]
    facts += [("Warning", text) for text in traceability.warnings(c)]
    if c.measured is None:
        facts.append(("Measured", measured_by(None)))
    k = f"expanded uncertainties with k = {COVERAGE_FACTOR:g}, each with what it covers"
    cover = ("Coverage", k if _linear(c) else f"{k}; of angles, the trials' intervals")
    found = (cover if fact[0] == "Coverage" else fact for fact in statistics(c))
    facts += [*traceability.campaign_facts(c), *found, *traceability.assumptions(c)]
    for table in traceability.exact_tables(c):
        for what, *effects in table.rows:
            by = ", ".join(map(" ".join, zip(table.header[1:], effects, strict=True)))
            said = f"{what}, moves roll/pitch/yaw, mrad: {by}"
            facts.append(("Taken as exact, but a typical error", said))
    return [f"{name}: {text}" for name, text in facts]


def _administration(c: Calibration) -> list[Part]:
    """Whose certificate, of what, when; the days are the computation's where none are told."""
    begin, end = (m.begin, m.end) if (m := c.measured) else (c.created, c.created)
    codes = ("countryCodeISO3166_1", "usedLangCodeISO639_1", "mandatoryLangCodeISO639_1")
    # The schema has no better room beside the dates for who says them.
    by = measured_by(c.measured)
    dated = [("issuer", "other"), ("value", by), _name("origin of the performance dates")]
    core: list[Part] = [
        *zip(codes, ("XX", "en", "en"), strict=True),
        ("uniqueIdentifier", f"DRAFT-{c.created}-{traceability.report_digest(c)[:8]}"),
        ("identifications", [("identification", dated)]),
        ("beginPerformanceDate", begin[:10]),
        ("endPerformanceDate", end[:10]),
        ("performanceLocation", "other"),
    ]
    items = [_name(c.rig.name)]
    for support, stated in zip(c.supports, c.rig.supports, strict=True):
        papers = stated.sensor
        known = (
            ("owner", support.name, "place on the rig"),
            ("manufacturer", papers and papers.serial, "serial number"),
            ("calibrationLaboratory", papers and papers.certificate, "certificate"),
            ("calibrationLaboratory", papers and papers.due, "day on which the certificate ends"),
            ("owner", c.rig.serial, "serial number of the rig"),
        )
        names = [(issuer, value, _name(name)) for issuer, value, name in known if value]
        each = [("identification", [("issuer", a), ("value", b), name]) for a, b, name in names]
        item = [_name(f"Force sensor of {support.name}"), ("manufacturer", [_name(BLANK)])]
        items.append(("item", [*item, ("identifications", each)]))
    blank = [_name(BLANK), ("eMail", BLANK), ("location", [("city", BLANK)])]
    operator = c.rig.campaign and c.rig.campaign.operator
    role = [("role", "operator")] if operator else []
    return [
        ("coreData", core),
        ("items", items),
        ("calibrationLaboratory", [("contact", blank)]),
        ("respPersons", [("respPerson", [("person", [_name(operator or BLANK)]), *role])]),
        ("customer", blank),
    ]


def _sensor(support: SupportResult, all_std: Mapping[str, float], *, linear: bool) -> Part:
    """Angles, rotation, zeros and sensitivity of a sensor. all_std : of parameters, by name."""
    quantities: list[Part] = []
    of, m = f"of {support.name}", support.mounting
    if m is not None:
        cover = m.interval.coverage
        each = zip(ANGLES, m.rpy, m.rpy_std, m.interval.low, m.interval.high, strict=True)
        for angle, value, std, low, high in each:
            expanded: Expanded | None = None
            # Where roll and yaw are one turn, neither has an uncertainty.
            if low is not None and high is not None and std > 0:
                half = max(high - value, value - low, std)  # D-SI knows no factor below 1
                expanded = half, half / std, cover
                if linear:
                    expanded = _doubled(std, float(student_dof(cover, (high - low) / (2 * std))))
            quantities.append(_quantity(f"{angle} {of}", value, "\\radian", expanded))
        quantities.append(_matrix(f"rotation {of}", m.rotation, "\\one"))
    for axis, zero, open_std in zip("xyz", support.zero, support.zero_std, strict=True):
        if zero is not None:
            quantities.append(_quantity(f"zero {axis} {of}", zero, "\\newton", _doubled(open_std)))
    for a, row in zip("xyz", support.sensitivity or (), strict=False):
        for b, value in zip("xyz", row, strict=True):
            gain = _doubled(all_std.get(f"{support.name}.sensitivity.{min(a, b)}{max(a, b)}"))
            quantities.append(_quantity(f"sensitivity {a}{b} {of}", value, "\\one", gain))
    return "result", [_name(f"Installation angles {of}"), ("data", quantities)]


def _doubled(std: float | None, dof: float = np.inf) -> Expanded | None:
    """Expanded uncertainty with k = 2, k, and its coverage by Student's t (GUM, G.3)."""
    return (COVERAGE_FACTOR * std, COVERAGE_FACTOR, coverage(COVERAGE_FACTOR, dof)) if std else None


def _quantity(name: str, value: float, unit: str, expanded: Expanded | None = None) -> Part:
    """A number with its unit, rounded where its uncertainty has two digits and two to guard."""
    shown, uncertainty = float(f"{value:.{_BARE}g}"), list[Part]()
    if expanded is not None:
        half, factor = (float(f"{given:.{_DIGITS}g}") for given in expanded[:2])
        shown = round(value, _DIGITS - 1 - floor(log10(half))) + 0.0
        names = ("si:valueExpandedMU", "si:coverageFactor", "si:coverageProbability")
        stated = list(zip(names, map(number, (half, factor, round(expanded[2], 4))), strict=True))
        uncertainty = [("si:measurementUncertaintyUnivariate", [("si:expandedMU", stated)])]
    real = "si:real", [("si:value", number(shown)), ("si:unit", unit), *uncertainty]
    return "quantity", [_name(name), real]


def _matrix(name: str, rows: Iterable[Iterable[float]], unit: str) -> Part:
    """All numbers of a matrix in full, row by row."""
    values = " ".join(number(value) for row in rows for value in row)
    numbers = [("si:valueXMLList", values), ("si:unitXMLList", unit)]
    return "quantity", [_name(f"{name}, row by row"), ("si:realListXMLList", numbers)]


def _name(text: str) -> Part:
    return "name", [("content", text)]


def _description(*lines: str) -> Part:
    return "description", [("content", line) for line in lines]


def _grow(place: ET.Element, name: str, content: Any) -> None:
    """Put an element with its text, or all its parts, into a place."""
    space, _, tag = name.rpartition(":")
    element = ET.SubElement(place, f"{{{SPACES[space or 'dcc']}}}{tag}")
    if tag == "content":
        element.set("lang", "en")
    if isinstance(content, str):
        element.text = xml_text(content)
        return
    for inner in content:
        _grow(element, *inner)
