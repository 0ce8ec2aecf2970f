"""A draft of a Digital Calibration Certificate (PTB DCC over D-SI).

It is a starting point for a laboratory, not a certificate: laboratory, customer and responsible
person stand as blanks, and every place that a reader looks at first says that it is a draft.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

from tdfscal.exports.statements import number, origin
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import SupportResult
from tdfscal.files.saving import xml_text
from tdfscal.records import ANGLES
from tdfscal.reporting.traceability import assumptions, campaign_facts
from tdfscal.significance import COVERAGE_FACTOR, EXPANDED_COVERAGE

SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
VERSION = "3.3.0"
BLANK = "to be completed"
DRAFT = (
    "DRAFT written by software. This is not an accredited calibration certificate and carries no "
    "signature; a laboratory must check and complete it."
)
Part = tuple[str, Any]
"""Name of an element and its text, or its parts; of D-SI behind `si:`."""


def certificate(c: Calibration) -> str:
    """Return the draft as XML for the DCC's schema of `VERSION`, over D-SI 2.2."""
    for prefix, space in SPACES.items():
        ET.register_namespace(prefix, space)
    root = ET.Element(f"{{{SPACES['dcc']}}}digitalCalibrationCertificate", schemaVersion=VERSION)
    root.append(ET.Comment(f" {DRAFT} "))
    software = ("software", [_name(c.software.name), ("release", c.software.version)])
    result = [_name("Installation rotations of force sensors (DRAFT)")]
    temperature = c.dwells.temperature if c.dwells is not None else None
    unknown = () if temperature else (f"Ambient temperature: {BLANK}",)
    told = (f"{name}: {text}" for name, text in (*campaign_facts(c), *assumptions(c)))
    lines = (DRAFT, *origin(c), *told, *unknown)
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
    linear = c.monte_carlo is None or c.monte_carlo.linear_interval_validated
    result.append(("results", [_sensor(support, linear=linear) for support in c.supports]))
    administration = [("dccSoftware", [software]), *_administration(c)]
    _grow(root, ("administrativeData", administration))
    _grow(root, ("measurementResults", [("measurementResult", result)]))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _administration(c: Calibration) -> list[Part]:
    """Whose certificate, of what, when; the days are the computation's where none are told."""
    begin, end = (
        (c.created, c.created) if c.measured is None else (c.measured.begin, c.measured.end)
    )
    core = [
        ("countryCodeISO3166_1", "XX"),
        ("usedLangCodeISO639_1", "en"),
        ("mandatoryLangCodeISO639_1", "en"),
        ("uniqueIdentifier", f"DRAFT-{c.created}-{c.rig.sha256[:12]}"),
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


def _sensor(support: SupportResult, *, linear: bool) -> Part:
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
            expanded = _doubled(std) if linear else (half, half / std, interval.coverage)
        name = f"{angle} of {support.name}"
        quantities.append(_quantity(name, value, "\\radian", expanded))
    for axis, zero, open_std in zip("xyz", support.zero, support.zero_std, strict=True):
        if zero is not None:
            expanded = _doubled(open_std) if open_std else None
            name = f"zero {axis} of {support.name}"
            quantities.append(_quantity(name, zero, "\\newton", expanded))
    return "result", [_name(f"Installation angles of {support.name}"), ("data", quantities)]


def _doubled(std: float) -> tuple[float, float, float]:
    """Expanded uncertainty with k = 2 of a normal distribution, k, and its coverage."""
    return COVERAGE_FACTOR * std, COVERAGE_FACTOR, EXPANDED_COVERAGE


def _quantity(
    name: str, value: float, unit: str, expanded: tuple[float, float, float] | None = None
) -> Part:
    """A number with its unit; expanded : half an interval, its factor, its coverage."""
    real: list[Part] = [("si:value", number(value)), ("si:unit", unit)]
    if expanded is not None:
        names = ("si:valueExpandedMU", "si:coverageFactor", "si:coverageProbability")
        stated = list(zip(names, map(number, expanded), strict=True))
        real.append(("si:measurementUncertaintyUnivariate", [("si:expandedMU", stated)]))
    return "quantity", [_name(name), ("si:real", real)]


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
