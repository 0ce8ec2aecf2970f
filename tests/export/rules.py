"""What PTB's schemas ask of the elements that a draft certificate uses, in a notation of our own.

Read from dcc.xsd 3.2.1 and SI_Format.xsd 2.2 (© PTB, LGPL 3), whose files are not kept
here. From these tables `write_schemas` makes schemas of the same strictness for such elements:
their order, how often each stands, and what its text may be. An element that a draft does not use
may hold anything.
"""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

#: Children in their order; ? at most once, + once or more, * any number, else exactly once; | or.
COMMON = """
digitalCalibrationCertificate: administrativeData measurementResults comment? document?
dccSoftware: software+
software: name release type? description?
name: content+
description: name? content*
coreData: countryCodeISO3166_1 usedLangCodeISO639_1+ mandatoryLangCodeISO639_1+ uniqueIdentifier \
identifications? receiptDate? beginPerformanceDate endPerformanceDate performanceLocation \
issueDate? reportAmendedSubstituted? previousReport?
identifications: identification+
identification: issuer value name?
calibrationLaboratory: calibrationLaboratoryCode? contact
respPersons: respPerson+
respPerson: person description? role? mainSigner?
person: name eMail? phone? fax? location? descriptionData?
location: city
measurementResults: measurementResult+
measurementResult: name description? usedMethods? usedSoftware? measuringEquipments? \
influenceConditions? results measurementMetaData?
usedMethods: usedMethod+
usedMethod: name description? norm* reference*
usedSoftware: software+
influenceConditions: influenceCondition+
influenceCondition: name description? status? certificate? data
results: result+
result: name description? data
data: quantity+
quantity: name? description? si:real|si:realListXMLList relativeUncertainty? \
usedMethods? usedSoftware? measuringEquipments? influenceConditions? measurementMetaData?
"""
#: In any order.
ADMINISTRATION = "dccSoftware coreData items calibrationLaboratory respPersons customer"
SINCE_3_2 = """
items: name? equipmentClass* description? owner? manufacturer? identifications? item+
item: name equipmentClass* description? installedSoftwares? manufacturer? model? identifications \
itemQuantities?
manufacturer: name eMail? phone? fax? location? descriptionData?
contact: name eMail? phone? fax? location descriptionData?
customer: name eMail? phone? fax? location descriptionData?
"""
SI = """
real: label? quantityType? value unit significantDigit? dateTime? measurementUncertaintyUnivariate?
measurementUncertaintyUnivariate: expandedMU
realListXMLList: labelXMLList? quantityTypeXMLList? valueXMLList unitXMLList
expandedMU: valueExpandedMU coverageFactor coverageProbability distribution?
"""
_TEXT = r"[^\s]+(\s+[^\s]+)*"
_POSITIVE = r"\+?((\d*\.\d+)|(\d+\.\d*)|(\d+\.?))([Ee][-+]?\d+)?|NaN"
_NUMBER = f"([-+]?{_POSITIVE.removeprefix(chr(92) + '+?')})"
#: What the text of an element must look like, by a pattern or a type.
TEXTS = {
    "release": _TEXT,
    "uniqueIdentifier": _TEXT,
    "city": _TEXT,
    "eMail": _TEXT,
    "value": _TEXT,
    "countryCodeISO3166_1": "[A-Z]{2}",
    "usedLangCodeISO639_1": "[a-z]{2}",
    "mandatoryLangCodeISO639_1": "[a-z]{2}",
    "beginPerformanceDate": "xs:date",
    "endPerformanceDate": "xs:date",
    "performanceLocation": "laboratory|customer|laboratoryBranch|customerBranch|other",
    "issuer": "manufacturer|calibrationLaboratory|customer|owner|other",
}
SI_TEXTS = {
    "value": _NUMBER,
    "unit": ".+",
    "valueXMLList": rf"({_NUMBER}\s?)+",
    "unitXMLList": r"([^\s]+\s?)+",
    "valueExpandedMU": _POSITIVE,
    "coverageFactor": r"\+?(([1-9]\d*\.\d*)|([1-9]\d*))|NaN",
    "coverageProbability": r"\+?((0(\.\d*)?)|(1(\.0*)?))|NaN",
}
_COUNTS = {"?": (0, "1"), "+": (1, "unbounded"), "*": (0, "unbounded")}
_HEAD = (
    '<xs:schema version="{version}" xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns="{space}" '
    'xmlns:si="https://ptb.de/si" targetNamespace="{space}" elementFormDefault="qualified">\n'
)
_LANGUAGE = (
    '<xs:complexType name="content"><xs:simpleContent><xs:extension base="xs:string">'
    '<xs:attribute name="lang"><xs:simpleType><xs:restriction base="xs:string">'
    '<xs:pattern value="[a-z]{2}"/></xs:restriction></xs:simpleType></xs:attribute>'
    "</xs:extension></xs:simpleContent></xs:complexType>\n"
)


def write_schemas(folder: Path, version: str) -> Path:
    """Write dcc.xsd of a version and SI_Format.xsd beside it."""
    rules = _parse(COMMON + SINCE_3_2)
    dcc = _HEAD.format(version=version, space="https://ptb.de/dcc")
    dcc += '<xs:import namespace="https://ptb.de/si" schemaLocation="SI_Format.xsd"/>\n' + _LANGUAGE
    members = "".join(_element(name, rules, TEXTS) for name in ADMINISTRATION.split())
    dcc += f'<xs:complexType name="administrativeData"><xs:all>{members}</xs:all></xs:complexType>'
    known = rules | {"administrativeData": [], "content": []}
    dcc += "".join(_complex(name, children, known, TEXTS) for name, children in rules.items())
    dcc += (
        '<xs:element name="digitalCalibrationCertificate"><xs:complexType><xs:complexContent>'
        '<xs:extension base="digitalCalibrationCertificate"><xs:attribute name="schemaVersion" '
        'use="required"><xs:simpleType><xs:restriction base="xs:string"><xs:pattern '
        f'value="{version}"/></xs:restriction></xs:simpleType></xs:attribute></xs:extension>'
        "</xs:complexContent></xs:complexType></xs:element></xs:schema>"
    )
    quantities = _parse(SI)
    si = _HEAD.format(version="2.2.1", space="https://ptb.de/si")
    si += "".join(_complex(n, children, quantities, SI_TEXTS) for n, children in quantities.items())
    for name in ("real", "realListXMLList"):
        si += f'<xs:element name="{name}" type="{name}"/>'
    si += "</xs:schema>"
    (folder / "SI_Format.xsd").write_text(si, encoding="utf-8")
    path = folder / "dcc.xsd"
    path.write_text(dcc, encoding="utf-8")
    return path


def _parse(rules: str) -> dict[str, list[str]]:
    lines = (line.partition(":") for line in rules.splitlines() if line)
    return {name: children.split() for name, _, children in lines}


def _complex(
    name: str, children: list[str], known: dict[str, list[str]], texts: dict[str, str]
) -> str:
    inside = "".join(_element(child, known, texts) for child in children)
    return f'<xs:complexType name="{name}"><xs:sequence>{inside}</xs:sequence></xs:complexType>\n'


def _element(word: str, known: dict[str, list[str]], texts: dict[str, str]) -> str:
    if "|" in word:
        each = "".join(_element(one, known, texts) for one in word.split("|"))
        return f"<xs:choice>{each}</xs:choice>"
    name = word.rstrip("?+*")
    least, most = _COUNTS.get(word[len(name) :], (1, "1"))
    count = f'minOccurs="{least}" maxOccurs="{most}"'
    if ":" in name:
        return f'<xs:element ref="{name}" {count}/>'
    text = texts.get(name)
    if text is None:
        return (
            f'<xs:element name="{name}" type="{name if name in known else "xs:anyType"}" {count}/>'
        )
    if text.startswith("xs:"):
        return f'<xs:element name="{name}" type="{text}" {count}/>'
    return (
        f'<xs:element name="{name}" {count}><xs:simpleType><xs:restriction base="xs:string">'
        f"<xs:pattern value={quoteattr(text)}/></xs:restriction></xs:simpleType></xs:element>"
    )
