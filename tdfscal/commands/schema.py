"""`schema`: the JSON Schemas of the file formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from tdfscal.commands import options
from tdfscal.commands.arguments import SILENT, PathLike
from tdfscal.commands.options import Option
from tdfscal.commands.result import Result
from tdfscal.files.schema import write_schemas
from tdfscal.files.yaml import as_path
from tdfscal.frozen import record


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
    """Write the JSON Schemas of rig, calibration and point files, and of results (`--json`).

    Raises
    ------
    UsageError
        The folder cannot be written.
    """
    return SchemaResult(write_schemas(as_path(folder)))
