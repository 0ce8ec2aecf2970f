"""A bar with rate and remaining time on standard error, where that is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def reading_bar(paths: Sequence[Path], *, quiet: bool) -> Iterator[Callable[[float], None] | None]:
    """Give what `iter_log` takes as `progress`; None where nobody looks.

    paths : log files, for the rate in bytes.
    """
    if quiet or not sys.stderr.isatty():
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
