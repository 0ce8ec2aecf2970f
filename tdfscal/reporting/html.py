"""One self-contained HTML page: no network, no script, prints on A4."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from tdfscal import __version__
from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.figures import drawings, drift, motion, residuals
from tdfscal.reporting.figures.style import to_svg
from tdfscal.reporting.layout import Facts, Items, Report, Section, Table, legible
from tdfscal.reporting.several import put_side_by_side, several_report
from tdfscal.reporting.validation import Origin, validation_report
from tdfscal.reporting.validation_in_motion import moving_validation_report
from tdfscal.validation.in_motion import MovingValidation
from tdfscal.validation.residual_wrench import Validation


def render(report: Report) -> str:
    """Return the page of a report."""
    return (
        _environment()
        .get_template("report.html.j2")
        .render(report=legible(report), version=__version__)
    )


def render_page(calibration: Calibration, more: tuple[Section, ...] = ()) -> str:
    """Return the page of one calibration; more : what is said besides."""
    return render(calibration_report(calibration, drawings(calibration), more))


def render_validation(
    v: Validation | MovingValidation, warnings: Sequence[str], origin: Origin
) -> str:
    """Return the page of a validation."""
    if isinstance(v, MovingValidation):
        figures = (motion.validated(v),)
        return render(moving_validation_report(v, warnings, origin, figures))
    return render(validation_report(v, warnings, origin, (residuals.validated(v),)))


def render_several(calibrations: Sequence[tuple[str, Calibration]]) -> str:
    """Return the page of several calibrations, (name, content) each, side by side.

    Raises DataError where they are of different supports.
    """
    view = put_side_by_side(calibrations)
    return render(several_report(view, (drift.draw(view.history, view.letters, view.days),)))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("tdfscal.reporting"),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # All text of a figure is outlines, so nothing in it needs escaping.
    environment.filters["svg"] = lambda drawing: Markup(to_svg(drawing))
    environment.filters["words"] = _words
    environment.filters["minus"] = lambda text: re.sub(r"-(?=[\d.])", "−", str(text))
    for kind in (Table, Facts, Items):
        environment.tests[kind.__name__.lower()] = lambda block, kind=kind: isinstance(block, kind)
    return environment


def _words(text: str) -> Markup:
    """A sentence, what stands between backquotes as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))
