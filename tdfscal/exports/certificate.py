"""A draft of a Digital Calibration Certificate (PTB DCC 3.x over D-SI 2.x).

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

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
LATEST = "3.3.0"
_UNIVARIATE_SINCE = (3, 3)
"""Version of the DCC whose D-SI (2.2) writes measurementUncertaintyUnivariate."""
_BLANK = "to be completed"
_DRAFT = (
    "DRAFT written by software. This is not an accredited calibration certificate and carries no "
    "signature; a laboratory must check and complete it."
)


def certificate(c: Calibration, version: str = LATEST) -> str:
    """Return the draft as XML for the DCC's schema of that version, 3.0.0 or later."""
    ET.register_namespace("dcc", DCC)
    ET.register_namespace("si", SI)
    root = ET.Element(f"{{{DCC}}}digitalCalibrationCertificate", {"schemaVersion": version})
    root.append(ET.Comment(f" {_DRAFT} "))
    _administration(_add(root, "administrativeData"), c)
    result = _add(_add(root, "measurementResults"), "measurementResult")
    _named(result, "Installation rotations of force sensors (DRAFT)")
    description = _add(result, "description")
    for line in (_DRAFT, *origin(c)):
        _content(description, line)
    method = _add(_add(result, "usedMethods"), "usedMethod")
    _named(method, f"{c.method} calibration")
    _content(_add(method, "description"), f"Command: {c.command}")
    _software(_add(result, "usedSoftware"), c)
    results = _add(result, "results")
    univariate = _numbers(version) >= _UNIVARIATE_SINCE
    for support in c.supports:
        _sensor(results, support, univariate=univariate)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _administration(data: ET.Element, c: Calibration) -> None:
    _software(_add(data, "dccSoftware"), c)
    core, day = _add(data, "coreData"), c.created[:10]
    for name, text in (
        ("countryCodeISO3166_1", "XX"),
        ("usedLangCodeISO639_1", "en"),
        ("mandatoryLangCodeISO639_1", "en"),
        ("uniqueIdentifier", f"DRAFT-{c.created}-{c.rig.sha256[:12]}"),
        ("beginPerformanceDate", day),
        ("endPerformanceDate", day),
        ("performanceLocation", "other"),
    ):
        _add(core, name, text)
    items = _add(data, "items")
    _named(items, c.rig.name)
    for support in c.supports:
        item = _add(items, "item")
        _named(item, f"Force sensor of {support.name}")
        _named(_add(item, "manufacturer"), _BLANK)  # asked for by 3.0 and 3.1
        identification = _add(_add(item, "identifications"), "identification")
        _add(identification, "issuer", "owner")
        _add(identification, "value", support.name)
    _contact(_add(_add(data, "calibrationLaboratory"), "contact"))
    person = _add(_add(_add(data, "respPersons"), "respPerson"), "person")
    _named(person, _BLANK)
    _contact(_add(data, "customer"))


def _sensor(results: ET.Element, support: SupportResult, *, univariate: bool) -> None:
    result = _add(results, "result")
    _named(result, f"Installation angles of {support.name}")
    data = _add(result, "data")
    mounting = support.mounting
    for k, angle in enumerate(ANGLES):
        if mounting is None:
            break
        interval, value, std = mounting.interval, mounting.rpy[k], mounting.rpy_std[k]
        # D-SI knows no coverage factor below 1.
        half = max(interval.high[k] - value, value - interval.low[k], std)
        quantity = _add(data, "quantity")
        _named(quantity, f"{angle} of {support.name}")
        real = _si(quantity, "real")
        _si(real, "value", number(value))
        _si(real, "unit", "\\radian")
        if std > 0:
            _expanded(real, half, half / std, interval.coverage, univariate=univariate)
    for axis, value in zip("xyz", support.zero, strict=True):
        if value is None:
            continue
        quantity = _add(data, "quantity")
        _named(quantity, f"zero {axis} of {support.name}")
        real = _si(quantity, "real")
        _si(real, "value", number(value))
        _si(real, "unit", "\\newton")


def _expanded(
    real: ET.Element, half: float, k: float, coverage: float, *, univariate: bool
) -> None:
    """Expanded uncertainty: half the file's interval, with k so that half / k is standard."""
    if univariate:
        place = _si(_si(real, "measurementUncertaintyUnivariate"), "expandedMU")
        _si(place, "valueExpandedMU", number(half))
    else:
        place = _si(real, "expandedUnc")
        _si(place, "uncertainty", number(half))
    _si(place, "coverageFactor", number(k))
    _si(place, "coverageProbability", number(coverage))


def _software(place: ET.Element, c: Calibration) -> None:
    software = _add(place, "software")
    _named(software, c.software.name)
    _add(software, "release", c.software.version)


def _contact(place: ET.Element) -> None:
    _named(place, _BLANK)
    _add(place, "eMail", _BLANK)  # asked for by 3.0 and 3.1
    _add(_add(place, "location"), "city", _BLANK)


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


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".") if part.isdecimal())
