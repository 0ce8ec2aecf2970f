import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from docs.generate import laid_out, schemas
from tdfscal.files.calibration.document import dump_calibration
from tdfscal.files.rig.reading import load_rig
from tests.files.edits import DROP, edited
from tests.files.sample_documents import RIG
from tests.reporting.samples import surveyed

ROOT = Path(__file__).parents[2]
NAMES = ("rig", "calibration", "points")
POINTS: dict[str, Any] = {
    "length_unit": "mm",
    "points": [
        {"group": "ncp1", "point": "P1", "x": 1.0, "y": 2.0, "z": 3.0},
        {"group": "ncp1", "point": "P2", "x": 1, "y": 2, "z": 3, "ux": 0.1, "uy": 0.1, "uz": 0.1},
    ],
}


def committed(name: str) -> dict[str, Any]:
    content = json.loads((ROOT / "schemas" / f"{name}.schema.json").read_text(encoding="utf-8"))
    assert isinstance(content, dict)
    return content


def sample(name: str) -> Any:
    if name == "rig":
        return yaml.safe_load(RIG)
    if name == "points":
        return POINTS
    return json.loads(dump_calibration(surveyed()[1], "json"))


def valid(name: str, content: Any) -> bool:
    return bool(jsonschema.Draft202012Validator(committed(name)).is_valid(content))


def test_committed_schemas_are_the_generated_ones() -> None:
    """Where this fails: `python docs/generate.py` writes them anew."""
    committed = {path.name: path.read_text("utf-8") for path in (ROOT / "schemas").iterdir()}
    assert committed == {name: f"{laid_out(schema)}\n" for name, schema in schemas().items()}


@pytest.mark.parametrize("name", NAMES)
def test_schema_is_one_says_which_and_takes_the_sample(name: str) -> None:
    schema = committed(name)
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.Draft202012Validator(schema).validate(sample(name))
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["$id"] == f"urn:tdfscal:schema:{name}:1"


def test_the_rig_of_a_calibration_is_a_rig_file(tmp_path: Path) -> None:
    """Its digest is that of the file it came from, and binds none that is written anew."""
    content = sample("calibration")["rig"]
    assert content["sha256"]
    assert valid("rig", content)
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    assert load_rig(path).sha256 != content["sha256"]


BAD: list[tuple[str, str, Any]] = [
    ("rig", "format", DROP),
    ("rig", "format", "tdfscal-rig/2"),
    ("rig", "trakker", {}),
    ("rig", "supports.0.hinj", [0, 0, 0]),
    ("rig", "supports.0.hinge", [0, 0]),
    ("rig", "supports.0.zero.std", -1),
    ("rig", "supports.0.zero.std", DROP),
    ("rig", "terminal.mass.std", "big"),
    ("rig", "log.supports.ncp1.force", ["a", "b", "c", "d"]),
    ("calibration", "format", DROP),
    ("calibration", "status", "fine"),
    ("calibration", "supports.0.rpy", [0.0, 0.0]),
    ("calibration", "inputs.0.sha256", "abc"),
    ("points", "length_unit", "ell"),
    ("points", "points.0.x", DROP),
    ("points", "points.0.w", 1),
]


@pytest.mark.parametrize(("name", "place", "value"), BAD)
def test_bad_documents_fail(name: str, place: str, value: Any) -> None:
    assert not valid(name, edited(sample(name), (place, value)))
