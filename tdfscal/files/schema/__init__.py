"""The published JSON Schemas of the file formats, generated from the models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.outputs import make_folder
from tdfscal.files.points.reading import PointFile
from tdfscal.files.rig.model import RigFile
from tdfscal.files.saving import to_json, write_text

DIALECT = "https://json-schema.org/draft/2020-12/schema"

_MODELS: dict[str, tuple[type[BaseModel], str]] = {
    "rig": (RigFile, "tdfscal rig file (rig.yaml)"),
    "calibration": (Calibration, "tdfscal calibration file"),
    "points": (PointFile, "tdfscal point file"),
}


class _WithoutTitles(GenerateJsonSchema):
    """A field's generated title only repeats its key."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


def _described_last(schema: dict[str, Any]) -> dict[str, Any]:
    """Put what a key says behind what it may hold."""
    for model in (schema, *schema["$defs"].values()):
        for told in model.get("properties", {}).values():
            told["description"] = told.pop("description")
    return schema


def schemas() -> dict[str, dict[str, Any]]:
    """Return each format's schema by its file name, the same at every call."""
    return {
        f"{name}.schema.json": {
            "$schema": DIALECT,
            "$id": f"urn:tdfscal:schema:{name}:1",
            **_described_last(model.model_json_schema(schema_generator=_WithoutTitles)),
            "title": title,
        }
        for name, (model, title) in _MODELS.items()
    }


def write_schemas(folder: Path | str) -> tuple[Path, ...]:
    """Write the schemas into a folder, which is made where it is missing; return their paths.

    Raises UsageError where they cannot be written.
    """
    target = make_folder(Path(folder))
    paths = []
    for name, schema in schemas().items():
        write_text(target / name, to_json(schema))
        paths.append(target / name)
    return tuple(paths)
