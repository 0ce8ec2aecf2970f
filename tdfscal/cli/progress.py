"""Progress on standard error: stages with the time, and a bar where that is a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


def speaker(*, quiet: bool) -> Callable[[str], None]:
    """Return what says a line of progress, headed by the seconds since now."""
    started = time.monotonic()

    def say(text: str) -> None:
        if not quiet:
            print(f"[{time.monotonic() - started:5.1f} s] {text}", file=sys.stderr, flush=True)

    return say


def stages(*, quiet: bool) -> Callable[[str], None]:
    """Return what says that a stage of a work begins."""
    say = speaker(quiet=quiet)
    return lambda stage: say(f"{stage} …")


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
