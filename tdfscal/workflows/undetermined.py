"""A page for a calibration that ends without angles: `--html` is written whatever the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tdfscal.errors import NotConvergedError, NotIdentifiableError
from tdfscal.files.outputs import appear_now
from tdfscal.files.saving import write_text
from tdfscal.workflows.arguments import PathLike
from tdfscal.workflows.campaign import Campaign
from tdfscal.workflows.log_pass import LogPass
from tdfscal.workflows.progress import Progress


@contextmanager
def pages_of_failure(
    paths: Sequence[Path],
    campaign: Campaign,
    log: LogPass | None,
    page: Path | None,
    figures: PathLike | None,
    command: str,
    progress: Progress,
) -> Iterator[None]:
    """Write page and figures of an error that says the data do not give the angles; it goes on.

    campaign : the one whose rig file counts. log : as far as it was read; None of several.
    """
    try:
        yield
    except (NotIdentifiableError, NotConvergedError) as error:
        if (page is None and figures is None) or error.exit_status != 4:
            raise
        from tdfscal.reporting.figures.style import save
        from tdfscal.reporting.html import render
        from tdfscal.reporting.undetermined import (
            Attempt,
            undetermined_drawings,
            undetermined_report,
        )

        progress.stage("drawing the report")
        inputs, messages = (log.inputs, log.messages) if log is not None else ((), ())
        names = tuple(map(str, paths))
        attempt = Attempt(error, campaign.rig, tuple(inputs), tuple(messages), names, command)
        drawings = undetermined_drawings(attempt)
        if figures is not None:
            for drawing in drawings:
                save(drawing, Path(figures))
        if page is None:
            appear_now()
            raise
        write_text(page, render(undetermined_report(attempt, drawings)))
        appear_now()
        look = f"{page} shows what is weak and what the log holds"
        raise error.restated(hint=f"{error.hint}. {look}" if error.hint else look) from error
