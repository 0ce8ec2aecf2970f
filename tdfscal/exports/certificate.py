"""A draft of a Digital Calibration Certificate (PTB DCC over D-SI).

It is a starting point for a laboratory, not a certificate: laboratory, customer and responsible
person stand as blanks, and every place that a reader looks at first says that it is a draft.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

from tdfscal.exports.words import number, origin
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import SupportResult
from tdfscal.files.escaping import xml_text
from tdfscal.records import ANGLES
from tdfscal.significance import COVERAGE_FACTOR, EXPANDED_COVERAGE

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
VERSION = "3.3.0"
BLANK = "to be completed"
DRAFT = (
    "DRAFT written by software. This is not an accredited calibration certificate and carries no "
    "signature; a laboratory must check and complete it."
)


def certificate(c: Calibration) -> str:
    """Return the draft as XML for the DCC's schema of `VERSION`, over D-SI 2.2."""
    ET.register_namespace("dcc", DCC)
    ET.register_namespace("si", SI)
    root = ET.Element(f"{{{DCC}}}digitalCalibrationCertificate", {"schemaVersion": VERSION})
    root.append(ET.Comment(f" {DRAFT} "))
    _administration(_add(root, "administrativeData"), c)
    result = _add(_add(root, "measurementResults"), "measurementResult")
    _named(result, "Installation rotations of force sensors (DRAFT)")
    description = _add(result, "description")
    unknown = [] if ambient(c) else [f"Ambient temperature: {BLANK}"]
    for line in (DRAFT, *origin(c), *unknown):
        _content(description, line)
    method = _add(_add(result, "usedMethods"), "usedMethod")
    _named(method, f"{c.method} calibration")
    _content(_add(method, "description"), f"Command: {c.command}")
    _software(_add(result, "usedSoftware"), c)
    if (span := ambient(c)) is not None:
        _conditions(result, *span)
    results = _add(result, "results")
    # The standard uncertainties tell the intervals: k = 2 then covers what it says.
    linear = c.monte_carlo is None or c.monte_carlo.linear_interval_validated
    for support in c.supports:
        _sensor(results, support, linear=linear)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _administration(data: ET.Element, c: Calibration) -> None:
    _software(_add(data, "dccSoftware"), c)
    core = _add(data, "coreData")
    begin, end = days(c)
    for name, text in (
        ("countryCodeISO3166_1", "XX"),
        ("usedLangCodeISO639_1", "en"),
        ("mandatoryLangCodeISO639_1", "en"),
        ("uniqueIdentifier", f"DRAFT-{c.created}-{c.rig.sha256[:12]}"),
        ("beginPerformanceDate", begin),
        ("endPerformanceDate", end),
        ("performanceLocation", "other"),
    ):
        _add(core, name, text)
    items = _add(data, "items")
    _named(items, c.rig.name)
    for support, stated in zip(c.supports, c.rig.supports, strict=True):
        item = _add(items, "item")
        _named(item, f"Force sensor of {support.name}")
        _named(_add(item, "manufacturer"), BLANK)
        known = [("owner", support.name, "place on the rig")]
        if stated.sensor is not None and stated.sensor.serial:
            known.append(("manufacturer", stated.sensor.serial, "serial number"))
        if stated.sensor is not None and stated.sensor.certificate:
            known.append(("calibrationLaboratory", stated.sensor.certificate, "certificate"))
        if c.rig.serial:
            known.append(("owner", c.rig.serial, "serial number of the rig"))
        identifications = _add(item, "identifications")
        for issuer, value, name in known:
            identification = _add(identifications, "identification")
            _add(identification, "issuer", issuer)
            _add(identification, "value", value)
            _named(identification, name)
    _contact(_add(_add(data, "calibrationLaboratory"), "contact"))
    person = _add(_add(_add(data, "respPersons"), "respPerson"), "person")
    _named(person, BLANK)
    _contact(_add(data, "customer"))


def days(c: Calibration) -> tuple[str, str]:
    """First and last day of the measurement; that of the computation where a file tells neither."""
    if c.measured is None:
        return c.created[:10], c.created[:10]
    return c.measured.begin[:10], c.measured.end[:10]


def ambient(c: Calibration) -> tuple[float, float] | None:
    """Lowest and highest temperature of the dwells, °C, where it was recorded."""
    temperature = c.dwells.temperature if c.dwells is not None else None
    return (min(temperature), max(temperature)) if temperature else None


def _conditions(result: ET.Element, low: float, high: float) -> None:
    condition = _add(_add(result, "influenceConditions"), "influenceCondition")
    _named(condition, "Ambient temperature")
    data = _add(condition, "data")
    for name, value in (("lowest temperature", low), ("highest temperature", high)):
        _real(data, name, value, "\\degreecelsius")


def _sensor(results: ET.Element, support: SupportResult, *, linear: bool) -> None:
    result = _add(results, "result")
    _named(result, f"Installation angles of {support.name}")
    data = _add(result, "data")
    mounting = support.mounting
    for k, angle in enumerate(ANGLES):
        if mounting is None:
            break
        interval, value, std = mounting.interval, mounting.rpy[k], mounting.rpy_std[k]
        low, high = interval.low[k], interval.high[k]
        real = _real(data, f"{angle} of {support.name}", value, "\\radian")
        if low is None or high is None:  # roll and yaw are one turn: neither has an uncertainty
            continue
        half = max(high - value, value - low, std)  # D-SI knows no coverage factor below 1
        if std > 0 and linear:
            _doubled(real, std)
        elif std > 0:
            _expanded(real, half, half / std, interval.coverage)
    for axis, zero, open_std in zip("xyz", support.zero, support.zero_std, strict=True):
        if zero is None:
            continue
        real = _real(data, f"zero {axis} of {support.name}", zero, "\\newton")
        if open_std:
            _doubled(real, open_std)


def _real(data: ET.Element, name: str, value: float, unit: str) -> ET.Element:
    quantity = _add(data, "quantity")
    _named(quantity, name)
    real = _si(quantity, "real")
    _si(real, "value", number(value))
    _si(real, "unit", unit)
    return real


def _doubled(real: ET.Element, std: float) -> None:
    """Expanded uncertainty with k = 2 of a normal distribution."""
    _expanded(real, COVERAGE_FACTOR * std, COVERAGE_FACTOR, EXPANDED_COVERAGE)


def _expanded(real: ET.Element, half: float, k: float, coverage: float) -> None:
    """Expanded uncertainty: half an interval, with k so that half / k is standard."""
    place = _si(_si(real, "measurementUncertaintyUnivariate"), "expandedMU")
    _si(place, "valueExpandedMU", number(half))
    _si(place, "coverageFactor", number(k))
    _si(place, "coverageProbability", number(coverage))


def _software(place: ET.Element, c: Calibration) -> None:
    software = _add(place, "software")
    _named(software, c.software.name)
    _add(software, "release", c.software.version)


def _contact(place: ET.Element) -> None:
    _named(place, BLANK)
    _add(place, "eMail", BLANK)
    _add(_add(place, "location"), "city", BLANK)


def _named(place: ET.Element, text: str) -> None:
    _content(_add(place, "name"), text)


def _content(place: ET.Element, text: str) -> None:
    _add(place, "content", text).set("lang", "en")


def _add(place: ET.Element, name: str, text: str | None = None) -> ET.Element:
    element = ET.SubElement(place, f"{{{DCC}}}{name}")
    element.text = text if text is None else xml_text(text)
    return element


def _si(place: ET.Element, name: str, text: str | None = None) -> ET.Element:
    element = ET.SubElement(place, f"{{{SI}}}{name}")
    element.text = text
    return element
