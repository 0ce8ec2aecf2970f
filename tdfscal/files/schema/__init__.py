"""The published JSON Schemas: of the file formats, made of the models; of what `--json` prints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from tdfscal.errors import TdfscalError
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.outputs import make_folder
from tdfscal.files.points.reading import PointFile
from tdfscal.files.rig.model import RigFile
from tdfscal.files.saving import to_json, write_text
from tdfscal.files.yaml import read_document

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
    made = {
        f"{name}.schema.json": {
            "$schema": DIALECT,
            "$id": f"urn:tdfscal:schema:{name}:1",
            **_described_last(model.model_json_schema(schema_generator=_WithoutTitles)),
            "title": title,
        }
        for name, (model, title) in _MODELS.items()
    }
    blocks = made["calibration.schema.json"]["$defs"]
    return made | {"results.schema.json": _of_results(blocks)}


def _of_results(of_files: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of what `--json` prints, by command under `$defs`.

    of_files : blocks of the calibration file, some of which stand in results too.
    """
    path = Path(__file__).with_name("results.yaml")
    told: dict[str, Any] = read_document(path, TdfscalError).content
    blocks, commands = told["blocks"], told["commands"]

    def block(keys: dict[str, Any]) -> dict[str, Any]:
        """`+` adds the keys of a shared block; NAME stands for any name."""
        if "NAME" in keys:
            return {"type": "object", "additionalProperties": {"description": keys["NAME"]}}
        whole = blocks.get(keys.get("+"), {}) | keys
        properties = {k.replace("[]", ""): one(k, v) for k, v in whole.items() if k != "+"}
        return {"type": "object", "properties": properties, "additionalProperties": False}

    def one(key: str, said: Any) -> dict[str, Any]:
        text = "its keys" if isinstance(said, dict) else said.removeprefix("→ ")
        holds: dict[str, Any] = {}
        if text != said:
            within = block(said) if isinstance(said, dict) else {"$ref": _ref(text)}
            holds = {"anyOf": [within, {"type": "null"}]}
        for _ in range(key.count("[]")):
            holds = {"type": ["array", "null"], "items": holds}
        return holds | {"description": text}

    shared = {name: of_files[name] for name in ("FindingResult", "MeasuredResult")}
    return {
        "$schema": DIALECT,
        "$id": "urn:tdfscal:schema:results:1",
        "anyOf": [{"$ref": _ref(name)} for name in commands],
        "$defs": shared | {name: block(keys) for name, keys in (blocks | commands).items()},
        "title": "tdfscal: what a command prints with --json, by command under $defs",
    }


def _ref(text: str) -> str:
    return f"#/$defs/{text.partition(':')[0]}"


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
