"""`info`: what is in a log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tdfscal.commands import options
from tdfscal.commands.campaign import find_logs, listed, one
from tdfscal.commands.options import silent, window
from tdfscal.commands.result import CommandResult, by_column
from tdfscal.errors import RigError
from tdfscal.files import RIG_NAME
from tdfscal.files.rig.reading import LoadedRig, load_rig
from tdfscal.frozen import record, replace
from tdfscal.logs.describe import LogInfo, describe_logs
from tdfscal.reporting.log_description import as_document, as_text


@record(eq=False)
class InfoResult(CommandResult):
    """What is in some logs. description : fields, rates, gaps, dwells, problems, a mapping."""

    description: LogInfo

    @property
    def problems(self) -> tuple[str, ...]:
        """What keeps the logs from being used, or wants a look."""
        return self.description.problems

    @property
    def text(self) -> str:
        """Description in words."""
        return as_text(self.description)

    def document(self) -> dict[str, Any]:
        """Return the description as plain JSON values."""
        return as_document(self.description)

    def table(self) -> dict[str, list[Any]]:
        """One row per field of each file."""
        rows = (
            (str(file.path), stream.name, f.name, f.kind, f.unit, stream.count, f.low, f.high)
            for file in self.description.contents
            for stream in file.streams
            for f in stream.fields
        )
        return by_column("path stream field type unit count low high", rows)


@options.command("info campaign/log.csv")
def info(
    paths: options.Paths,
    *,
    rig: options.RigFile = None,
    from_: options.Begin = None,
    to: options.End = None,
    progress: options.Telling = silent,
) -> InfoResult:
    """Show what is in a log: fields, rates, gaps, dwells, problems, a mapping to paste."""
    part = window(from_, to)
    loaded, fault = _rig(listed(paths), one(rig))
    logs = find_logs(paths, apart=loaded.surveys if loaded is not None else ())
    progress("reading the log")
    found = describe_logs(logs, loaded, window=part)
    return InfoResult(replace(found, problems=(*fault, *found.problems)))


def _rig(paths: list[Path], named: Path | None) -> tuple[LoadedRig | None, tuple[str, ...]]:
    """The rig that is named, or the rig.yaml of a campaign folder, and what is wrong with that.

    None is fine, and so is one that is being written.
    """
    if named is not None:
        return load_rig(named), ()
    for path in paths:
        if (path / RIG_NAME).is_file():
            try:
                return load_rig(path / RIG_NAME), ()
            except RigError as error:
                return None, (f"the rig file is not used: {error}",)
    return None, ()
