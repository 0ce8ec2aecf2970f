"""`tdfscal info`."""

from __future__ import annotations

import sys
from pathlib import Path

from tdfscal.cli.app import emit
from tdfscal.cli.progress import reading_bar
from tdfscal.files.rig import RIG_NAME
from tdfscal.files.rig.reading import LoadedRig, load_rig
from tdfscal.logs import expand, is_log
from tdfscal.logs.describe import describe_logs
from tdfscal.logs.description.document import as_document
from tdfscal.reporting.log_description import as_text
from tdfscal.workflows.campaign import find_logs


def run(paths: list[Path], *, rig: Path | None, json: bool, quiet: bool) -> None:
    """Look through the logs and print what is there."""
    loaded = _rig(paths, rig)
    apart = loaded.tracker.paths if loaded is not None and loaded.tracker is not None else ()
    logs = find_logs(paths, apart=apart)
    with reading_bar(expand(logs), quiet=quiet) as progress:
        info = describe_logs(logs, loaded, progress=progress)
    if json:
        emit(as_document(info))
    else:
        sys.stdout.write(as_text(info))


def _rig(paths: list[Path], given: Path | None) -> LoadedRig | None:
    """The rig that is named, or the rig.yaml of a campaign folder; none is fine."""
    if given is not None:
        return load_rig(given)
    for path in paths:
        if path.is_dir() and not is_log(path) and (path / RIG_NAME).is_file():
            return load_rig(path / RIG_NAME)
    return None
