"""`schema`: the JSON Schemas of the file formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from tdfscal.commands import options
from tdfscal.commands.arguments import SILENT, PathLike
from tdfscal.commands.options import Option
from tdfscal.commands.result import Result
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.outputs import make_folder
from tdfscal.files.points.reading import PointFile
from tdfscal.files.rig.model import RigFile
from tdfscal.files.saving import to_json, write_text
from tdfscal.files.yaml import as_path
from tdfscal.frozen import record

_MODELS: dict[str, tuple[type[BaseModel], str]] = {
    "rig": (RigFile, "tdfscal rig file (rig.yaml)"),
    "calibration": (Calibration, "tdfscal calibration file, and what `calibrate --json` prints"),
    "points": (PointFile, "tdfscal point file"),
}


class _WithoutTitles(GenerateJsonSchema):
    """A field's generated title only repeats its key."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


def schemas() -> dict[str, dict[str, Any]]:
    """Return each format's schema by its file name, the same at every call."""
    return {
        f"{name}.schema.json": {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "$id": f"urn:tdfscal:schema:{name}:1",
            **model.model_json_schema(schema_generator=_WithoutTitles),
            "title": title,
        }
        for name, (model, title) in _MODELS.items()
    }


def write_schemas(folder: Path | str) -> tuple[Path, ...]:
    """Write the schemas into a folder, which is made where it is missing; return their paths.

    Raises UsageError where they cannot be written.
    """
    target = make_folder(Path(folder))
    for name, schema in schemas().items():
        write_text(target / name, to_json(schema))
    return tuple(target / name for name in schemas())


@record(eq=False)
class SchemaResult(Result):
    """Schemas that were written. files : where."""

    files: tuple[Path, ...]

    @property
    def text(self) -> str:
        """One path per line."""
        return "".join(f"{path}\n" for path in self.files)

    def to_dict(self) -> dict[str, Any]:
        """Return the paths."""
        return {"files": [str(path) for path in self.files]}

    def table(self) -> dict[str, list[str]]:
        """One row per file: its path."""
        return {"file": [str(path) for path in self.files]}


@options.command("schema schemas")
def schema(
    folder: Annotated[PathLike, Option("where to write", Path, "DIR")] = "schemas",
    *,
    progress: options.Telling = SILENT,
) -> SchemaResult:
    """Write the JSON Schemas of rig, calibration and point files.

    Raises
    ------
    UsageError
        The folder cannot be written.
    """
    return SchemaResult(write_schemas(as_path(folder)))
