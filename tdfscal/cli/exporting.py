"""`tdfscal export`."""

from __future__ import annotations

import sys
from pathlib import Path

from tdfscal.cli.app import emit
from tdfscal.cli.reporting import load
from tdfscal.errors import UsageError
from tdfscal.export import FORMATS, certificate
from tdfscal.files.output_places import check_place
from tdfscal.files.saving import write_text


def run(
    path: Path,
    *,
    to: str,
    output: Path,
    parent: str,
    schema: Path | None,
    allow_rejected: bool,
    json: bool,
) -> int:
    """Write the export; return the exit status: 1, and nothing written, for a rejected result."""
    if schema is not None and to != "dcc":
        raise UsageError("only a DCC has a schema", where="--schema", hint="use --to dcc")
    check_place(output, [path])
    ((_, calibration),) = load([path])
    if calibration.status == "rejected" and not allow_rejected:
        print(
            f"tdfscal: {path}: the quality gate rejected this calibration; nothing was written. "
            "Use --allow-rejected to export it all the same.",
            file=sys.stderr,
        )
        return 1
    if schema is not None:
        from tdfscal.export.schemacheck import check, schema_version

        text = certificate(calibration, schema_version(schema))
        check(text, schema)
    else:
        text = FORMATS[to](calibration, parent)
    to_stdout = str(output) == "-"
    if not to_stdout:
        write_text(output, text)
    if json:
        where = {"content": text} if to_stdout else {"output": str(output)}
        emit({"format": to, "calibration_status": calibration.status, **where})
    elif to_stdout:
        sys.stdout.write(text)
    return 0
