"""The draft certificate: read back, and held against the rules of PTB's schemas."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xmlschema

from tdfscal.catalogue import document as finding_document
from tdfscal.exports.certificate import VERSION, certificate
from tdfscal.files.calibration.document import Calibration, load_calibration
from tdfscal.files.calibration.parts import CONVENTION_WITH_SENSITIVITY, MeasuredResult
from tdfscal.files.rig.model import Campaign, Sensor
from tdfscal.findings import Finding
from tdfscal.records import ANGLES
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.layout import Table
from tests.cli.running import Cli
from tests.export.rules import write_schemas
from tests.reporting.samples import by_hand, changed, sample, saved

NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
C = sample().calibration


def check(document: str, folder: Path) -> None:
    """Hold a document against the rules of the version it is written for."""
    path = write_schemas(folder, VERSION)
    places = {NAMES["si"]: str(path.with_name("SI_Format.xsd"))}
    xmlschema.XMLSchema(str(path), locations=places, allow="local").validate(document)


def content(element: ET.Element) -> str:
    return str(element.findtext("dcc:name/dcc:content", namespaces=NAMES))


def quantities(c: Calibration) -> dict[str, ET.Element | None]:
    return {
        content(quantity): quantity.find("si:real", NAMES)
        for quantity in ET.fromstring(certificate(c)).iterfind(".//dcc:quantity", NAMES)
    }


MU = "si:measurementUncertaintyUnivariate/si:expandedMU/si:"


def told(real: ET.Element | None, path: str = "si:value") -> float:
    """A number of a quantity."""
    assert real is not None
    return float(str(real.findtext(path, namespaces=NAMES)))


def test_numbers_keep_two_digits_beyond_those_of_the_uncertainty() -> None:
    """The last of four digits of U is at most a thousandth of U, and half of it is rounded off.

    With k = 2, which covers 95.45 %: the noise is as stated, so that ν = ∞.
    """
    found = quantities(C)
    for support, mounting in zip(C.supports, C.mounted, strict=True):
        names = [*ANGLES, *(f"zero {axis}" for axis in "xyz")]
        units = ["\\radian"] * 3 + ["\\newton"] * 3
        values = np.array([*mounting.rpy, *support.zero], dtype=np.float64)
        stds = np.array([*mounting.rpy_std, *support.zero_std], dtype=np.float64)
        for name, unit, value, std in zip(names, units, values, stds, strict=True):
            real = found[f"{name} of {support.name}"]
            assert real is not None
            assert told(real) == pytest.approx(value, abs=1.01e-3 * std, rel=0)
            assert told(real) != value
            assert real.findtext("si:unit", namespaces=NAMES) == unit
            assert told(real, MU + "valueExpandedMU") == pytest.approx(2.0 * std, rel=5e-4)
            assert told(real, MU + "coverageFactor") == 2.0
            assert told(real, MU + "coverageProbability") == pytest.approx(0.9545, abs=5e-5)


def test_no_other_coverage_factor_is_told() -> None:
    """A sentence on the intervals of the page would contradict the numbers here."""
    text = certificate(C)
    assert set(re.findall(r"k = (\d[\d.]*\d|\d)", text)) == {"2"}
    factors = ET.fromstring(text).iterfind(".//si:coverageFactor", NAMES)
    assert {float(str(e.text)) for e in factors} == {2.0}


def test_sensitivities_stand_in_certificate_and_report(tmp_path: Path) -> None:
    document = C.model_dump()
    S = np.array([[1.003, 0.001, 0.0], [0.001, 0.998, -0.002], [0.0, -0.002, 1.0]])
    document["supports"][1]["sensitivity"] = S.tolist()
    document["convention"] = CONVENTION_WITH_SENSITIVITY
    c = by_hand(document)
    found = quantities(c)
    for a, b in np.ndindex(3, 3):
        assert told(found[f"sensitivity {'xyz'[a]}{'xyz'[b]} of support_2"]) == S[a, b]
    assert "sensitivity xx of support_1" not in found
    check(certificate(c), tmp_path)
    blocks = [b for s in calibration_report(c).sections for b in s.blocks if isinstance(b, Table)]
    (table,) = (t for t in blocks if t.caption.startswith("Sensitivity"))
    assert [[float(cell) for cell in row[1:]] for row in table.rows] == S.tolist()


def test_a_sensitivity_has_the_uncertainty_of_its_parameter() -> None:
    """Twice the root of its variance in the file's joint covariance; symmetric as S is."""
    c = load_calibration(Path(__file__).parents[1] / "files/reference_1_0/joint.json")
    found, block, support = quantities(c), c.parameters, c.supports[1]
    assert block is not None
    assert support.sensitivity is not None
    std = dict(zip(block.parameters, np.sqrt(np.diagonal(np.array(block.matrix))), strict=True))
    for a, b in np.ndindex(3, 3):
        one, other = "xyz"[a], "xyz"[b]
        real = found[f"sensitivity {one}{other} of {support.name}"]
        own = std[f"{support.name}.sensitivity.{''.join(sorted((one, other)))}"]
        assert told(real, MU + "valueExpandedMU") == pytest.approx(2 * own, rel=5e-4)
        assert told(real) == pytest.approx(support.sensitivity[a][b], abs=1.01e-3 * own, rel=0)


def test_a_provisional_result_names_its_lines(tmp_path: Path) -> None:
    keys = ("terminal.mass (line 12)", "gravity (line 3)")
    draft = finding_document(Finding("draft-unconfirmed", keys, len(keys)))
    text = certificate(changed(C, status="provisional", findings=[draft]))
    name = ET.fromstring(text).findtext(
        ".//dcc:measurementResult/dcc:name/dcc:content", namespaces=NAMES
    )
    assert str(name).startswith("PROVISIONAL")
    assert all(key in text for key in keys)
    check(text, tmp_path)


def test_what_was_taken_as_exact_stands_with_what_its_error_would_do() -> None:
    assert C.taken_as_exact
    text = certificate(C)
    for one in C.taken_as_exact:
        (line,) = (line for line in text.splitlines() if f"typical error: {one.name}, " in line)
        shown = re.findall(r"(\S+) (\S+)/(\S+)/(\S+?)(?=, |<)", line.split("mrad: ")[1])
        assert [name for name, *_ in shown] == [effect.name for effect in one.supports]
        effects = np.array([row for _, *row in shown], dtype=np.float64)
        stated = 1e3 * np.array([effect.rpy for effect in one.supports], dtype=np.float64)
        np.testing.assert_allclose(effects, stated, rtol=0, atol=0.0051)


def documented() -> Calibration:
    """A calibration with all that a certificate asks of dates, serials and conditions."""
    dwells = C.dwells
    assert dwells is not None
    warm = tuple(20.0 + 0.1 * k for k in range(len(dwells.start)))
    rig = C.rig.model_copy(
        update={
            "serial": "RH-02",
            "campaign": Campaign(operator="R. Höhn", site="hall 3"),
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
    assert {f"SN-{s.name}" for s in c.supports} | {"RH-02", "2027-03-01"} <= set(values)
    warm = root.iterfind(".//dcc:influenceCondition//si:real/si:value", NAMES)
    last = 20.0 + 0.1 * (len(c.dwells.start if c.dwells else ()) - 1)
    assert [float(str(e.text)) for e in warm] == [20.0, last]
    person = root.find(".//dcc:respPerson", NAMES)
    assert person is not None
    assert person.findtext("dcc:person/dcc:name/dcc:content", namespaces=NAMES) == "R. Höhn"
    assert person.findtext("dcc:role", namespaces=NAMES) == "operator"
    assert "Site: hall 3" in text
    check(text, tmp_path)


def test_a_date_without_a_time_is_a_day() -> None:
    day = {"begin": "2026-11-20T00:00:00Z", "end": "2026-11-20T23:59:59Z", "source": "rig"}
    text = certificate(by_hand({**C.model_dump(), "measured": day}))
    assert "Measured: 2026-11-20, by the rig file" in text


def test_matrices_stand_in_full() -> None:
    """Rotations and the covariance of all, to the last bit, by row."""
    lists = {
        content(quantity): quantity.find("si:realListXMLList", NAMES)
        for quantity in ET.fromstring(certificate(C)).iterfind(".//dcc:quantity", NAMES)
    }
    matrices: dict[str, tuple[Any, str]] = {
        f"rotation of {s.name}": (s.rotation, "\\one") for s in C.supports
    }
    of = f"covariance of {', '.join(C.covariance.parameters)}"
    matrices[of] = (C.covariance.matrix, "\\radian\\tothe{2}")
    for name, (rows, unit) in matrices.items():
        listed = lists[f"{name}, row by row"]
        assert listed is not None
        values = str(listed.findtext("si:valueXMLList", namespaces=NAMES)).split()
        assert np.array_equal([float(value) for value in values], np.ravel(rows))
        assert listed.findtext("si:unitXMLList", namespaces=NAMES) == unit


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


def test_schema_accepts(tmp_path: Path, cli: Cli) -> None:
    out = tmp_path / "out.xml"
    done = cli("export", saved(C, tmp_path, "c.yaml"), "--to", "dcc", "-o", out)
    assert (done.status, done.err) == (0, "")
    check(out.read_text(encoding="utf-8"), tmp_path)


def test_the_schema_refuses_what_is_wrong(tmp_path: Path) -> None:
    wrong = certificate(C).replace("valueExpandedMU", "uncertainty")
    with pytest.raises(xmlschema.XMLSchemaException):
        check(wrong, tmp_path)


def test_an_interval_shorter_than_a_standard_uncertainty(tmp_path: Path) -> None:
    """D-SI knows no coverage factor below 1: the uncertainty stated is then the larger one."""
    document = C.model_dump()
    rpy = [support["rpy"] for support in document["supports"]]
    document["monte_carlo"] = {"trials": 5000, "rpy_std": rpy, "low": rpy, "high": rpy}
    document["monte_carlo"] |= {"tolerance": 0.0, "linear_interval_validated": False}
    for support in document["supports"]:
        support["rpy_interval"] = {"coverage": 0.95, "low": support["rpy"], "high": support["rpy"]}
    text = certificate(Calibration.model_validate(document))
    check(text, tmp_path)
    factors = [
        float(str(e.text)) for e in ET.fromstring(text).iterfind(".//si:coverageFactor", NAMES)
    ]
    assert factors == [1.0, 1.0, 1.0, 2.0, 2.0, 2.0] * 3  # angles, zeros


def test_known_exactly_has_no_uncertainty() -> None:
    """An angle without uncertainty gets none, rather than a division by zero."""
    document = C.model_dump()
    document["covariance"]["matrix"] = np.zeros((9, 9)).tolist()
    for support in document["supports"]:
        support["rpy_std"] = support["turn_std"] = support["zero_std"] = (0.0, 0.0, 0.0)
    root = ET.fromstring(certificate(by_hand(document)))
    assert root.find(".//si:expandedMU", NAMES) is None
    assert len(root.findall(".//si:real", NAMES)) == 18
