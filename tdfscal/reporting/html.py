"""One self-contained HTML page: no network, no script, prints on A4."""

from __future__ import annotations

import hashlib
import re
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from tdfscal import __version__
from tdfscal.reporting.figures.style import to_svg
from tdfscal.reporting.layout import Facts, Items, Report, Table, legible
from tdfscal.reporting.text import render as as_text

#: Tables in a notebook.
_CARD = 2


def render(report: Report) -> str:
    """Return the page of a report; one without a number gets that of its words."""
    number = report.number or hashlib.sha256(as_text(report).encode()).hexdigest()[:8]
    said = {"report": legible(report, "−"), "number": number, "version": __version__}
    return _environment().get_template("report.html.j2").render(said)


def card(report: Report) -> str:
    """Return verdict, claim and first tables of a report, to stand in a notebook."""
    report = legible(report, "−")
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
    for kind in (Table, Facts, Items):
        environment.tests[kind.__name__.lower()] = lambda block, kind=kind: isinstance(block, kind)
    return environment


def _words(text: str) -> Markup:
    """A sentence, what stands between backquotes as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))
