"""`tdfscal report` and `tdfscal compare`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tdfscal.cli.app import emit
from tdfscal.cli.progress import stages
from tdfscal.errors import UsageError
from tdfscal.files.calibration.document import Calibration, load_calibration, parse_calibration
from tdfscal.files.output_places import check_calibration, check_place
from tdfscal.files.saving import write_text
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.terminal import show

Named = tuple[str, Calibration]


def run(
    files: list[Path], *, html: Path | None, figures: Path | None, json: bool, quiet: bool
) -> None:
    """Print one calibration, or several side by side; write page and figures where asked."""
    if str(html) == "-" and json:
        raise UsageError("--html - and --json both want standard output", hint="name a file")
    if html is not None:
        check_place(html, files)
    loaded = load(files)
    say = stages(quiet=quiet)
    if figures is not None:
        say("drawing the figures")
        _write_figures(loaded, figures)
    if html is not None:
        say("drawing the report")
        page = page_of(*loaded)
        if str(html) == "-":
            sys.stdout.write(page)
            return
        write_text(html, page)
    if json:
        _print_json(loaded)
    elif len(loaded) == 1:
        show(calibration_report(loaded[0][1]))
    else:
        from tdfscal.reporting.several import put_side_by_side, several_report

        show(several_report(put_side_by_side(loaded)))


def compare(files: list[Path], *, json: bool) -> None:
    """Compare the first calibration with each of the others, in the order given."""
    from tdfscal.comparison.compatibility import compare_pair
    from tdfscal.reporting.several import comparison_document, comparison_report
    from tdfscal.reporting.text import render

    if len(files) < 2:
        raise UsageError("one calibration cannot be compared", hint="name two files or more")
    loaded = [(name, c.rotations()) for name, c in load(files)]
    pairs = [compare_pair(loaded[0], other) for other in loaded[1:]]
    if json:
        documents = [comparison_document(pair, {}) for pair in pairs]
        emit(
            documents[0]
            if len(documents) == 1
            else {"verified": all(pair.verified for pair in pairs), "comparisons": documents}
        )
    else:
        sys.stdout.write("\n".join(render(comparison_report(pair)) for pair in pairs))


def load(files: Sequence[Path]) -> list[Named]:
    """Read calibration files, `-` from standard input; names tell them apart.

    Raises DataError, UsageError.
    """
    if sum(str(path) == "-" for path in files) > 1:
        raise UsageError("standard input can be read once only", hint="name files")
    for path in files:
        check_calibration(path)
    loaded = [
        ("standard input", parse_calibration(sys.stdin.buffer.read(), "standard input"))
        if str(path) == "-"
        else (str(path), load_calibration(path))
        for path in files
    ]
    if len({name for name, _ in loaded}) < len(loaded):
        raise UsageError("a calibration file is named twice", hint="name each file once")
    return loaded


def page_of(*loaded: Named) -> str:
    """Return the HTML page of one calibration, or of several side by side. Raises DataError."""
    from tdfscal.reporting.html import render_page, render_several

    return render_page(loaded[0][1]) if len(loaded) == 1 else render_several(loaded)


def _print_json(loaded: list[Named]) -> None:
    documents = [c.model_dump(mode="json", exclude_none=True) for _, c in loaded]
    if len(documents) == 1:
        emit(documents[0])
        return
    from tdfscal.reporting.several import document, put_side_by_side

    comparison = document(put_side_by_side(loaded))
    emit({"calibrations": documents, "comparison": comparison})


def _write_figures(loaded: list[Named], folder: Path) -> None:
    from tdfscal.reporting.figures import several_drawings, write_figures
    from tdfscal.reporting.figures.style import save
    from tdfscal.reporting.several import put_side_by_side

    if len(loaded) == 1:
        write_figures(loaded[0][1], folder)
        return
    for drawing in several_drawings(put_side_by_side(loaded)):
        save(drawing, folder)
