"""A draft of a Digital Calibration Certificate (PTB DCC over D-SI).

It is a starting point for a laboratory, not a certificate: laboratory, customer and responsible
person stand as blanks, and every place that a reader looks at first says that it is a draft.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from math import floor, log10
from typing import Any

import numpy as np

from tdfscal.exports.formats import number, origin
from tdfscal.files.calibration.consistency import UNCONFIRMED
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import SupportResult
from tdfscal.files.saving import xml_text
from tdfscal.numerics.distributions import coverage, student_dof
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.calibration import statistics
from tdfscal.reporting.traceability import (
    assumptions,
    campaign_facts,
    exact_tables,
    report_digest,
    warnings,
)
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
#: Entries of a symmetric matrix by row and column.
_ENTRY = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "yz": (1, 2), "xz": (0, 2), "xy": (0, 1)}
#: What a quantity in no uncertainty might do.
_TYPICAL = "Taken as exact, but a typical error"
Part = tuple[str, Any]
"""Name of an element and its text, or its parts; of D-SI behind `si:`."""


def certificate(c: Calibration) -> str:
    """Return the draft as XML for the DCC's schema of `VERSION`, over D-SI 2.2."""
    for prefix, space in SPACES.items():
        ET.register_namespace(prefix, space)
    root = ET.Element(f"{{{SPACES['dcc']}}}digitalCalibrationCertificate", schemaVersion=VERSION)
    root.append(ET.Comment(f" {DRAFT} "))
    software = ("software", [_name(c.software.name), ("release", c.software.version)])
    mark = "" if c.status == "accepted" else f"{c.status.upper()}: "
    result = [_name(f"{mark}Installation rotations of force sensors (DRAFT)")]
    temperature = c.dwells.temperature if c.dwells is not None else None
    unknown = () if temperature else (f"Ambient temperature: {BLANK}",)
    lines = (DRAFT, *origin(c), *_told(c), *unknown)
    result.append(("description", [("content", line) for line in lines]))
    command = ("description", [("content", f"Command: {c.command}")])
    method = ("usedMethod", [_name(f"{c.method} calibration"), command])
    result += [("usedMethods", [method]), ("usedSoftware", [software])]
    if temperature:
        ends = (("lowest temperature", min(temperature)), ("highest temperature", max(temperature)))
        data = ("data", [_quantity(name, value, "\\degreecelsius") for name, value in ends])
        condition = ("influenceCondition", [_name("Ambient temperature"), data])
        result.append(("influenceConditions", [condition]))
    # The standard uncertainties tell the intervals: k = 2 then covers what it says.
    linear = c.monte_carlo is None or not c.monte_carlo.decides
    each = zip(c.supports, _gain_std(c), strict=True)
    results = [_sensor(support, gain_std, linear=linear) for support, gain_std in each]
    result.append(("results", results))
    administration = [("dccSoftware", [software]), *_administration(c)]
    _grow(root, ("administrativeData", administration))
    _grow(root, ("measurementResults", [("measurementResult", result)]))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _told(c: Calibration) -> list[str]:
    """What a reader must know of the numbers: warnings first, then the report's own facts."""
    digest = report_digest(c)
    facts = [("Report", f"{digest[:8]}, content SHA-256 {digest}")]
    facts += [("Unconfirmed", f.told) for f in c.found(UNCONFIRMED)]
    facts += [("REJECTED", f.told) for f in c.reasons]
    facts += [("Warning", text) for text in warnings(c)]
    if c.measured is None:
        facts.append(("Measured", "not known when; the dates are those of the computation"))
    facts += [*campaign_facts(c), *statistics(c), *assumptions(c)]
    for table in exact_tables(c):
        for what, *effects in table.rows:
            turns = ", ".join(map(" ".join, zip(table.header[1:], effects, strict=True)))
            facts.append((_TYPICAL, f"{what}, moves roll/pitch/yaw, mrad: {turns}"))
    return [f"{name}: {text}" for name, text in facts]


def _administration(c: Calibration) -> list[Part]:
    """Whose certificate, of what, when; the days are the computation's where none are told."""
    begin, end = (
        (c.created, c.created) if c.measured is None else (c.measured.begin, c.measured.end)
    )
    core = [
        ("countryCodeISO3166_1", "XX"),
        ("usedLangCodeISO639_1", "en"),
        ("mandatoryLangCodeISO639_1", "en"),
        ("uniqueIdentifier", f"DRAFT-{c.created}-{report_digest(c)[:8]}"),
        ("beginPerformanceDate", begin[:10]),
        ("endPerformanceDate", end[:10]),
        ("performanceLocation", "other"),
    ]
    items = [_name(c.rig.name)]
    for support, stated in zip(c.supports, c.rig.supports, strict=True):
        papers = stated.sensor
        known = [
            ("owner", support.name, "place on the rig"),
            ("manufacturer", papers and papers.serial, "serial number"),
            ("calibrationLaboratory", papers and papers.certificate, "certificate"),
            ("owner", c.rig.serial, "serial number of the rig"),
        ]
        identifications = [
            ("identification", [("issuer", issuer), ("value", value), _name(name)])
            for issuer, value, name in known
            if value
        ]
        maker = ("manufacturer", [_name(BLANK)])
        name = _name(f"Force sensor of {support.name}")
        items.append(("item", [name, maker, ("identifications", identifications)]))
    blank = [_name(BLANK), ("eMail", BLANK), ("location", [("city", BLANK)])]
    return [
        ("coreData", core),
        ("items", items),
        ("calibrationLaboratory", [("contact", blank)]),
        ("respPersons", [("respPerson", [("person", [_name(BLANK)])])]),
        ("customer", blank),
    ]


def _gain_std(c: Calibration) -> list[FloatArray]:
    """Standard uncertainties (3, 3) of each sensor's sensitivity; 0 where none is stated."""
    std = [np.zeros((3, 3)) for _ in c.supports]
    if c.parameters is not None:
        variance = np.diagonal(np.array(c.parameters.matrix))
        known = dict(zip(c.parameters.parameters, np.sqrt(variance), strict=True))
        for of, support in zip(std, c.supports, strict=True):
            for entry, (a, b) in _ENTRY.items():
                of[a, b] = of[b, a] = known.get(f"{support.name}.sensitivity.{entry}", 0.0)
    return std


def _sensor(support: SupportResult, gain_std: FloatArray, *, linear: bool) -> Part:
    quantities: list[Part] = []
    mounting = support.mounting
    for k, angle in enumerate(ANGLES if mounting is not None else ()):
        assert mounting is not None  # else there are no angles
        interval, value, std = mounting.interval, mounting.rpy[k], mounting.rpy_std[k]
        low, high = interval.low[k], interval.high[k]
        expanded: tuple[float, float, float] | None = None
        # Where roll and yaw are one turn, neither has an uncertainty.
        if low is not None and high is not None and std > 0:
            half = max(high - value, value - low, std)  # D-SI knows no coverage factor below 1
            expanded = (half, half / std, interval.coverage)
            if linear:
                factor = (high - low) / (2 * std)
                expanded = _doubled(std, float(student_dof(interval.coverage, factor)))
        name = f"{angle} of {support.name}"
        quantities.append(_quantity(name, value, "\\radian", expanded))
    for axis, zero, open_std in zip("xyz", support.zero, support.zero_std, strict=True):
        if zero is not None:
            expanded = _doubled(open_std) if open_std else None
            name = f"zero {axis} of {support.name}"
            quantities.append(_quantity(name, zero, "\\newton", expanded))
    for a, row in zip("xyz", support.sensitivity or (), strict=False):
        for b, value in zip("xyz", row, strict=True):
            gain = float(gain_std["xyz".index(a), "xyz".index(b)])
            name = f"sensitivity {a}{b} of {support.name}"
            quantities.append(_quantity(name, value, "\\one", _doubled(gain) if gain else None))
    return "result", [_name(f"Installation angles of {support.name}"), ("data", quantities)]


def _doubled(std: float, dof: float = np.inf) -> tuple[float, float, float]:
    """Expanded uncertainty with k = 2, k, and its coverage by Student's t (GUM, G.3)."""
    return COVERAGE_FACTOR * std, COVERAGE_FACTOR, coverage(COVERAGE_FACTOR, dof)


def _quantity(
    name: str, value: float, unit: str, expanded: tuple[float, float, float] | None = None
) -> Part:
    """A number with its unit; expanded : half an interval, its factor, its coverage.

    Rounded where the uncertainty has two significant digits and two to guard.
    """
    shown = float(f"{value:.{_BARE}g}")
    if expanded is not None:
        expanded = (_significant(expanded[0]), _significant(expanded[1]), round(expanded[2], 4))
        shown = round(value, _DIGITS - 1 - floor(log10(expanded[0]))) + 0.0
    real: list[Part] = [("si:value", number(shown)), ("si:unit", unit)]
    if expanded is not None:
        names = ("si:valueExpandedMU", "si:coverageFactor", "si:coverageProbability")
        stated = list(zip(names, map(number, expanded), strict=True))
        real.append(("si:measurementUncertaintyUnivariate", [("si:expandedMU", stated)]))
    return "quantity", [_name(name), ("si:real", real)]


def _significant(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _name(text: str) -> Part:
    return "name", [("content", text)]


def _grow(place: ET.Element, part: Part) -> None:
    """Put an element with all its parts into a place."""
    (name, content) = part
    space, _, tag = name.rpartition(":")
    element = ET.SubElement(place, f"{{{SPACES[space or 'dcc']}}}{tag}")
    if tag == "content":
        element.set("lang", "en")
    if isinstance(content, str):
        element.text = xml_text(content)
        return
    for inner in content:
        _grow(element, inner)
