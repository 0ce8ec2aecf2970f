"""The draft certificate: read back, and held against the rules of PTB's schemas."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from tdfscal.errors import UsageError
from tdfscal.exports.certificate import certificate
from tdfscal.exports.certificate_page import certificate_page
from tdfscal.exports.schemacheck import check, schema_version
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.files.rig.model import Sensor
from tests.export.rules import write_schemas
from tests.reporting.samples import NASTY, by_hand, changed, run, sample, saved

NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
C = sample().calibration


def content(element: ET.Element) -> str:
    return str(element.findtext("dcc:name/dcc:content", namespaces=NAMES))


def test_numbers_come_back_to_the_bit() -> None:
    root = ET.fromstring(certificate(C))
    found = {
        content(quantity): quantity.find("si:real", NAMES)
        for quantity in root.iterfind(".//dcc:quantity", NAMES)
    }
    for support, mounting in zip(C.supports, C.mounted, strict=True):
        for k, angle in enumerate(("roll", "pitch", "yaw")):
            real = found[f"{angle} of {support.name}"]
            assert real is not None
            assert float(str(real.findtext("si:value", namespaces=NAMES))) == mounting.rpy[k]
            assert real.findtext("si:unit", namespaces=NAMES) == "\\radian"
            place = real.find("si:measurementUncertaintyUnivariate/si:expandedMU", NAMES)
            assert place is not None
            U, factor, p = (float(str(part.text)) for part in place)
            assert U / factor == pytest.approx(mounting.rpy_std[k], rel=1e-14)
            assert factor == 2.0
            assert p == pytest.approx(0.9545, abs=5e-5)
        zeros = [found[f"zero {a} of {support.name}"] for a in "xyz"]
        values = [float(str(z.findtext("si:value", namespaces=NAMES))) for z in zeros if z]
        assert values == list(support.zero)
        path = "si:measurementUncertaintyUnivariate/si:expandedMU/si:valueExpandedMU"
        expanded = [float(str(z.findtext(path, namespaces=NAMES))) for z in zeros if z]
        assert expanded == [2.0 * std for std in support.zero_std if std is not None]


def documented() -> Calibration:
    """A calibration with all that a certificate asks of dates, serials and conditions."""
    dwells = C.dwells
    assert dwells is not None
    warm = tuple(20.0 + 0.1 * k for k in range(len(dwells.start)))
    rig = C.rig.model_copy(
        update={
            "serial": "RH-02",
            "supports": tuple(
                s.model_copy(update={"sensor": Sensor(serial=f"SN-{s.name}", due="2027-03-01")})
                for s in C.rig.supports
            ),
        }
    )
    measured = MeasuredResult(
        begin="2026-11-20T08:00:00Z", end="2026-11-21T09:00:00Z", source="log"
    )
    return C.model_copy(
        update={
            "rig": rig,
            "measured": measured,
            "dwells": dwells.model_copy(update={"temperature": warm}),
        }
    )


def test_dates_serials_and_conditions_are_those_of_the_measurement(tmp_path: Path) -> None:
    c = documented()
    text = certificate(c)
    root = ET.fromstring(text)
    assert root.findtext(".//dcc:beginPerformanceDate", namespaces=NAMES) == "2026-11-20"
    assert root.findtext(".//dcc:endPerformanceDate", namespaces=NAMES) == "2026-11-21"
    values = [str(e.text) for e in root.iterfind(".//dcc:identification/dcc:value", NAMES)]
    assert {f"SN-{s.name}" for s in c.supports} | {"RH-02"} <= set(values)
    warm = root.iterfind(".//dcc:influenceCondition//si:real/si:value", NAMES)
    last = 20.0 + 0.1 * (len(c.dwells.start if c.dwells else ()) - 1)
    assert [float(str(e.text)) for e in warm] == [20.0, last]
    pytest.importorskip("xmlschema")
    for version in ("3.1.2", "3.3.0"):
        folder = tmp_path / version
        folder.mkdir()
        check(certificate(c, version), write_schemas(folder, version))


def test_the_page_has_the_content_of_the_certificate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = certificate_page(documented())
    for text in ("RH-02", "SN-support_1", "2026-11-20 to 2026-11-21", "20.00 to", "k = 2", "draft"):
        assert text in page
    value, std = C.mounted[0].rpy[2], C.mounted[0].rpy_std[2]
    assert f"{1e3 * value:.3f}".replace("-", "−") in page
    assert f"{2e3 * std:.3f}" in page
    out = tmp_path / "certificate.html"
    done = run(capsys, "export", saved(C, tmp_path, "c.yaml"), "--to", "certificate", "-o", out)
    assert done.status == 0
    assert out.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


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


@pytest.mark.parametrize("version", ["3.1.2", "3.2.1", "3.3.0"])
def test_schema_accepts(version: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("xmlschema")
    path, out = write_schemas(tmp_path, version), tmp_path / "out.xml"
    done = run(
        capsys,
        *("export", saved(C, tmp_path, "c.yaml"), "--to", "dcc", "--schema", path, "-o", out),
    )
    assert (done.status, done.err) == (0, "")
    assert ET.parse(out).getroot().get("schemaVersion") == version


def test_an_interval_shorter_than_a_standard_uncertainty(tmp_path: Path) -> None:
    """D-SI knows no coverage factor below 1: the uncertainty stated is then the larger one."""
    pytest.importorskip("xmlschema")
    document = C.model_dump()
    rpy = [support["rpy"] for support in document["supports"]]
    document["monte_carlo"] = {"trials": 1, "seed": 0, "rpy_std": rpy, "low": rpy, "high": rpy}
    document["monte_carlo"] |= {"tolerance": 0.0, "linear_interval_validated": False}
    for support in document["supports"]:
        support["rpy_interval"] = {"coverage": 0.95, "low": support["rpy"], "high": support["rpy"]}
    text = certificate(Calibration.model_validate(document))
    check(text, write_schemas(tmp_path, "3.3.0"))
    factors = [
        float(str(e.text)) for e in ET.fromstring(text).iterfind(".//si:coverageFactor", NAMES)
    ]
    assert factors == [1.0, 1.0, 1.0, 2.0, 2.0, 2.0] * 3  # angles, zeros


def test_schema_refuses(tmp_path: Path) -> None:
    pytest.importorskip("xmlschema")
    path = write_schemas(tmp_path, "3.3.0", more="statements")
    with pytest.raises(UsageError, match=r"does not obey the schema at .*administrativeData"):
        check(certificate(C), path)
    wrong = certificate(C).replace("valueExpandedMU", "uncertainty")
    with pytest.raises(UsageError, match="expandedMU"):
        check(wrong, write_schemas(tmp_path, "3.3.0"))


def test_a_schema_that_is_not_there_is_no_question_for_the_network(tmp_path: Path) -> None:
    pytest.importorskip("xmlschema")
    path = write_schemas(tmp_path, "3.3.0")
    (tmp_path / "SI_Format.xsd").unlink()
    with pytest.raises(UsageError, match="schema cannot be used"):
        check(certificate(C), path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<a/>", "no XML schema"),
        ("rubbish", "cannot be read"),
        ('<schema xmlns="http://www.w3.org/2001/XMLSchema" version="2.4.0"/>', "version 2.4.0"),
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
    assert "tdfscal \\x07 calibrate\n--x '<&>'" in words


def test_known_exactly_has_no_uncertainty() -> None:
    """An angle without uncertainty gets none, rather than a division by zero."""
    document = C.model_dump()
    document["covariance"]["matrix"] = np.zeros((9, 9)).tolist()
    for support in document["supports"]:
        support["rpy_std"] = support["turn_std"] = support["zero_std"] = (0.0, 0.0, 0.0)
    root = ET.fromstring(certificate(by_hand(document)))
    assert root.find(".//si:expandedMU", NAMES) is None
    assert len(root.findall(".//si:real", NAMES)) == 18
