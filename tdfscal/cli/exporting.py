"""`tdfscal export`."""

from __future__ import annotations

import sys
from pathlib import Path

from tdfscal.cli.reporting import load
from tdfscal.errors import UsageError
from tdfscal.export import FORMATS, certificate
from tdfscal.files.saving import write_text


def run(
    path: Path,
    *,
    to: str,
    output: Path,
    parent: str,
    schema: Path | None,
    allow_rejected: bool,
) -> int:
    """Write the export; return the exit status: 1, and nothing written, for a rejected result."""
    if schema is not None and to != "dcc":
        raise UsageError("only a DCC has a schema", where="--schema", hint="use --to dcc")
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
    if str(output) == "-":
        sys.stdout.write(text)
    else:
        write_text(output, text)
    return 0
