"""`tdfscal report`."""

from __future__ import annotations

import sys
from pathlib import Path

from tdfscal.cli.app import emit
from tdfscal.files.calibration import load_calibration
from tdfscal.reporting.text import render


def run(files: list[Path], *, json: bool) -> None:
    """Print each calibration."""
    loaded = [load_calibration(path) for path in files]
    if json:
        documents = [c.model_dump(mode="json", exclude_none=True) for c in loaded]
        emit(documents[0] if len(documents) == 1 else {"calibrations": documents})
        return
    sys.stdout.write("\n".join(render(c) for c in loaded))
