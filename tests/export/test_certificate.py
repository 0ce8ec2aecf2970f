"""The draft certificate: read back, and held against a schema of the same shape as PTB's."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from tdfscal.errors import UsageError
from tdfscal.export.certificate import certificate
from tdfscal.export.schemacheck import check, schema_version
from tdfscal.files.calibration import Calibration
from tests.reporting.samples import NASTY, changed, run, sample, saved

NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
C = sample().calibration

#: The path from the root to a number, as the DCC's documentation has it; imports as PTB's does.
DCC_XSD = """\
<xs:schema version="{version}" xmlns:xs="http://www.w3.org/2001/XMLSchema"
    xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si"
    targetNamespace="https://ptb.de/dcc" elementFormDefault="qualified">
  <xs:import namespace="https://ptb.de/si" schemaLocation="https://ptb.de/si/SI_Format.xsd"/>
  <xs:element name="digitalCalibrationCertificate"><xs:complexType><xs:sequence>
    <xs:element name="administrativeData"><xs:complexType><xs:all>
      {administration}
    </xs:all></xs:complexType></xs:element>
    <xs:element name="measurementResults"><xs:complexType><xs:sequence>
      <xs:element name="measurementResult"><xs:complexType><xs:sequence>
        <xs:element name="name" type="xs:anyType"/>
        <xs:element name="description" type="xs:anyType" minOccurs="0"/>
        <xs:element name="usedMethods" type="xs:anyType" minOccurs="0"/>
        <xs:element name="usedSoftware" type="xs:anyType" minOccurs="0"/>
        <xs:element name="results"><xs:complexType><xs:sequence>
          <xs:element name="result" maxOccurs="unbounded"><xs:complexType><xs:sequence>
            <xs:element name="name" type="xs:anyType"/>
            <xs:element name="data"><xs:complexType><xs:sequence>
              <xs:element name="quantity" maxOccurs="unbounded"><xs:complexType><xs:sequence>
                <xs:element name="name" type="xs:anyType"/>
                <xs:element ref="si:real"/>
              </xs:sequence></xs:complexType></xs:element>
            </xs:sequence></xs:complexType></xs:element>
          </xs:sequence></xs:complexType></xs:element>
        </xs:sequence></xs:complexType></xs:element>
      </xs:sequence></xs:complexType></xs:element>
    </xs:sequence></xs:complexType></xs:element>
  </xs:sequence><xs:attribute name="schemaVersion" use="required"><xs:simpleType>
    <xs:restriction base="xs:string"><xs:pattern value="{version}"/></xs:restriction>
  </xs:simpleType></xs:attribute></xs:complexType></xs:element>
</xs:schema>
"""
ADMINISTRATION = (
    "dccSoftware",
    "coreData",
    "items",
    "calibrationLaboratory",
    "respPersons",
    "customer",
)
SI_XSD = """\
<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns:si="https://ptb.de/si"
    targetNamespace="https://ptb.de/si" elementFormDefault="qualified">
  <xs:complexType name="expanded"><xs:sequence>
    <xs:element name="{size}" type="xs:double"/>
    <xs:element name="coverageFactor" type="xs:double"/>
    <xs:element name="coverageProbability" type="xs:double"/>
  </xs:sequence></xs:complexType>
  <xs:element name="real"><xs:complexType><xs:sequence>
    <xs:element name="value" type="xs:double"/>
    <xs:element name="unit" type="xs:string"/>
    {uncertainty}
  </xs:sequence></xs:complexType></xs:element>
</xs:schema>
"""
OLD = '<xs:element name="expandedUnc" type="si:expanded" minOccurs="0"/>'
NEW = (
    '<xs:element name="measurementUncertaintyUnivariate" minOccurs="0"><xs:complexType>'
    '<xs:sequence><xs:element name="expandedMU" type="si:expanded"/></xs:sequence>'
    "</xs:complexType></xs:element>"
)


def schema(folder: Path, version: str, administration: tuple[str, ...] = ADMINISTRATION) -> Path:
    """A schema file with the one that it imports beside it."""
    new = version.startswith("3.3")
    named = "".join(f'<xs:element name="{a}" type="xs:anyType"/>' for a in administration)
    path = folder / "dcc.xsd"
    path.write_text(DCC_XSD.format(version=version, administration=named), encoding="utf-8")
    text = SI_XSD.format(
        size="valueExpandedMU" if new else "uncertainty", uncertainty=NEW if new else OLD
    )
    (folder / "SI_Format.xsd").write_text(text, encoding="utf-8")
    return path


def content(element: ET.Element) -> str:
    return str(element.findtext("dcc:name/dcc:content", namespaces=NAMES))


def test_numbers_come_back_to_the_bit() -> None:
    root = ET.fromstring(certificate(C))
    found = {
        content(quantity): quantity.find("si:real", NAMES)
        for quantity in root.iterfind(".//dcc:quantity", NAMES)
    }
    for support in C.supports:
        for k, angle in enumerate(("roll", "pitch", "yaw")):
            real = found[f"{angle} of {support.name}"]
            assert real is not None
            assert float(str(real.findtext("si:value", namespaces=NAMES))) == support.rpy[k]
            assert real.findtext("si:unit", namespaces=NAMES) == "\\radian"
            place = real.find("si:measurementUncertaintyUnivariate/si:expandedMU", NAMES)
            assert place is not None
            U, factor, p = (float(str(part.text)) for part in place)
            assert U / factor == pytest.approx(support.rpy_std[k], rel=1e-14)
            assert p == support.rpy_interval.coverage == 0.95
            assert support.rpy[k] + U >= support.rpy_interval.high[k] - 1e-15
            assert support.rpy[k] - U <= support.rpy_interval.low[k] + 1e-15
        zeros = [found[f"zero {a} of {support.name}"] for a in "xyz"]
        values = [float(str(z.findtext("si:value", namespaces=NAMES))) for z in zeros if z]
        assert values == list(support.zero)


def test_it_says_that_it_is_a_draft() -> None:
    text = certificate(C)
    root = ET.fromstring(text)
    said = str(root.findtext(".//dcc:uniqueIdentifier", namespaces=NAMES))
    assert said.startswith("DRAFT-")
    description = root.find(".//dcc:measurementResult/dcc:description", NAMES)
    assert description is not None
    words = " ".join("".join(description.itertext()).split())
    assert "not an accredited calibration certificate" in words
    assert C.convention in words
    assert text.index("DRAFT") < text.index("administrativeData")
    assert root.find(".//{http://www.w3.org/2000/09/xmldsig#}Signature") is None


@pytest.mark.parametrize("version", ["3.2.1", "3.3.0"])
def test_schema_accepts(version: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("xmlschema")
    path, out = schema(tmp_path, version), tmp_path / "out.xml"
    done = run(
        capsys,
        *("export", saved(C, tmp_path, "c.yaml"), "--to", "dcc", "--schema", path, "-o", out),
    )
    assert (done.status, done.err) == (0, "")
    assert ET.parse(out).getroot().get("schemaVersion") == version


def test_schema_refuses(tmp_path: Path) -> None:
    pytest.importorskip("xmlschema")
    path = schema(tmp_path, "3.3.0", (*ADMINISTRATION, "statements"))
    with pytest.raises(UsageError, match=r"does not obey the schema at .*administrativeData"):
        check(certificate(C), path)
    wrong = certificate(C).replace("valueExpandedMU", "uncertainty")
    with pytest.raises(UsageError, match="expandedMU"):
        check(wrong, schema(tmp_path, "3.3.0"))


def test_a_schema_that_is_not_there_is_no_question_for_the_network(tmp_path: Path) -> None:
    pytest.importorskip("xmlschema")
    path = schema(tmp_path, "3.3.0")
    (tmp_path / "SI_Format.xsd").unlink()
    with pytest.raises(UsageError, match="schema cannot be used"):
        check(certificate(C), path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<a/>", "no XML schema"),
        ("rubbish", "cannot be read"),
        (DCC_XSD.format(version="2.4.0", administration=""), "version 2.4.0"),
    ],
)
def test_other_files_are_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "x.xsd"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=message):
        schema_version(path)


def test_any_text_makes_sound_xml() -> None:
    c = changed(sample(n=6, name=NASTY).calibration, command="tdfscal \x07 calibrate\n--x '<&>'")
    root = ET.fromstring(certificate(c))
    assert root.findtext(".//dcc:items/dcc:name/dcc:content", namespaces=NAMES) == NASTY
    words = "".join(root.itertext())
    assert "tdfscal calibrate --x '<&>'" in words


def test_known_exactly_has_no_uncertainty() -> None:
    """An angle without uncertainty gets none, rather than a division by zero."""
    document = C.model_dump()
    document["covariance"]["matrix"] = np.zeros((9, 9)).tolist()
    document["parameters"] = None
    for support in document["supports"]:
        support["rpy_std"] = (0.0, 0.0, 0.0)
    root = ET.fromstring(certificate(Calibration.model_validate(document)))
    assert root.find(".//si:expandedMU", NAMES) is None
    assert len(root.findall(".//si:real", NAMES)) == 18
