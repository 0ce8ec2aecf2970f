"""One self-contained HTML page: no network, no script, prints on A4."""

from __future__ import annotations

import re
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from tdfscal import __version__
from tdfscal.reporting.figures.style import to_svg
from tdfscal.reporting.layout import Facts, Items, Report, Table, legible

#: Tables in a notebook.
_CARD = 2


def render(report: Report) -> str:
    """Return the page of a report."""
    return (
        _environment()
        .get_template("report.html.j2")
        .render(report=legible(report), version=__version__)
    )


def card(report: Report) -> str:
    """Return verdict, claim and first tables of a report, to stand in a notebook."""
    report = legible(report)
    tables = [block for block in report.blocks(whole=False) if isinstance(block, Table)]
    colour = "#a50f15" if not report.accepted else "#8a5a00" if report.provisional else "#0f6b33"
    shown = {"report": report, "colour": colour, "blocks": tables[:_CARD]}
    return _environment().get_template("card.html.j2").render(shown)


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
