"""Progress on standard error: stages with the time, and a bar where that is a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from tdfscal.cli import streams

if TYPE_CHECKING:
    from tdfscal.workflows.progress import Progress


def on_stderr(*, quiet: bool) -> Progress:
    """Return what shows progress to a user; each line is headed by the seconds since now."""
    from tdfscal.workflows.progress import SILENT, Progress

    if quiet:
        return SILENT
    started = time.monotonic()

    def say(text: str) -> None:
        streams.say(f"[{time.monotonic() - started:5.1f} s] {text}")

    return Progress(stage=lambda stage: say(f"{stage} …"), count=say, reading=_reading_bar)


@contextmanager
def _reading_bar(paths: Sequence[Path]) -> Iterator[Callable[[float], None] | None]:
    """Give what takes the share of the files that is read; None where nobody looks."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TimeRemainingColumn
    from rich.progress import TransferSpeedColumn as SpeedColumn

    size = sum(path.stat().st_size for path in paths if path.is_file())
    with Progress(
        "reading",
        BarColumn(),
        DownloadColumn(),
        SpeedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    ) as bar:
        task = bar.add_task("reading", total=size)
        yield lambda share: bar.update(task, completed=share * size)
