"""One self-contained HTML page: no network, no script, prints on A4."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from tdfscal import __version__
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.saving import write_text
from tdfscal.reporting.figures.style import Drawing, to_svg
from tdfscal.reporting.page import compose
from tdfscal.reporting.several import Several, put_side_by_side, several_drawings
from tdfscal.reporting.validationpage import Origin, compose_validation
from tdfscal.validation.residual_wrench import Validation


def render_page(calibration: Calibration) -> str:
    """Return the page of one calibration."""
    return _render("report.html.j2", page=compose(calibration))


def render_validation(
    v: Validation, c: Calibration, warnings: Sequence[str], origin: Origin
) -> str:
    """Return the page of a validation of a calibration."""
    return _render("report.html.j2", page=compose_validation(v, c, warnings, origin))


def render_several(calibrations: Sequence[tuple[str, Calibration]]) -> str:
    """Return the page of several calibrations, (name, content) each, side by side.

    Raises DataError where they are of different supports.
    """
    view: Several = put_side_by_side(calibrations)
    return _render("several.html.j2", view=view, drawings=several_drawings(view))


def write_page(calibration: Calibration, path: Path) -> None:
    """Write the page of one calibration, whole or not at all. Raises UsageError."""
    write_text(path, render_page(calibration))


def _render(template: str, **content: object) -> str:
    return _environment().get_template(template).render(version=__version__, **content)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("tdfscal.reporting"),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["svg"] = _inline
    environment.filters["minus"] = lambda text: str(text).replace("-", "−")
    return environment


def _inline(drawing: Drawing) -> Markup:
    """SVG as part of the page; all text in it is outlines, so nothing needs escaping."""
    return Markup(to_svg(drawing))
