"""Cost against accuracy in words, rows and a figure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.reports.cells import Row, number
from studies.runs.cost import Assumptions, Choice, CostStudy
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, legend_above
from tdfscal.reporting.layout import Facts, Report, Section, Table

_NOTE = (
    "Hours are those in which the machine cannot assemble; the instrument's and the people's run "
    "beside them. The error is that of simulated calibrations against the truth, rms over all "
    "angles. The assumptions are ours, not the paper's; change them in a YAML file of these keys "
    "with --assumptions."
)


def _error_said(choice: Choice) -> str:
    if np.isnan(choice.rms):
        return "–"
    std = choice.standard_error
    return f"{1e3 * choice.rms:.3f}" + ("" if np.isnan(std) else f" ± {1e3 * std:.2g}")


def report(study: CostStudy) -> Report:
    """Lay out effort and error of each way to calibrate, and the assumptions."""
    lost = any(c.failed for c in study.choices)
    rows = tuple(
        (f"{c.method}: {c.what}", f"{c.effort.machine:.2f}", f"{c.effort.instrument:.2f}",
         f"{c.effort.people:.2f}", f"{c.effort.cost:.0f}", _error_said(c),
         *((str(c.failed),) if lost else ()))
        for c in study.choices
    )  # fmt: skip
    header = ("", "machine, h", "tracker, h", "people, h", "cost", "error, mrad",
              *(("failed",) if lost else ()))  # fmt: skip
    assumed = tuple(
        (f.name, f"{getattr(study.assumptions, f.name):g} {f.metadata['meaning']}")
        for f in fields(Assumptions)
    )
    blocks = (
        Table("Effort, and rms error of an angle ± standard error", header, rows),
        "Assumptions:",
        Facts(assumed),
        _NOTE,
    )
    return Report(
        title=f"Cost and accuracy: {study.rig.name}",
        subtitle=f"{study.runs} simulated rigs of each",
        sections=(Section("Cost and accuracy", blocks),),
    )


def document(study: CostStudy) -> dict[str, Any]:
    """The study as plain JSON values."""
    return {
        "rig": study.rig.name,
        "seed": study.seed,
        "runs": study.runs,
        "assumptions": {f.name: getattr(study.assumptions, f.name) for f in fields(Assumptions)},
        "choices": list(_choices(study)),
        "note": _NOTE,
    }


def tables(study: CostStudy) -> dict[str, Iterable[Row]]:
    """One row per way to calibrate."""
    return {"cost.csv": _choices(study)}


def _choices(study: CostStudy) -> Iterator[Row]:
    for c in study.choices:
        yield {
            "method": c.method,
            "what": c.what,
            "machine_h": c.effort.machine,
            "tracker_h": c.effort.instrument,
            "people_h": c.effort.people,
            "cost": c.effort.cost,
            "rms_error_rad": number(c.rms),
            "standard_error_rad": number(c.standard_error),
            "runs": int(c.error.size),
            "failed": c.failed,
        }


def drawings(study: CostStudy) -> tuple[Drawing, ...]:
    """Error against cost, a line per method."""
    known = [c for c in study.choices if not np.isnan(c.rms)]
    best = min(known, key=lambda c: c.rms * c.effort.cost) if known else None
    reading = "No way to calibrate gave a result."
    if best is not None:
        reading = (
            f"Least error times cost: {best.method}, {best.what}, {1e3 * best.rms:.2g} mrad for "
            f"{best.effort.cost:.0f}."
        )
    return (Drawing("cost", "Accuracy against cost", reading, partial(_paint, study)),)


def _paint(study: CostStudy) -> Figure:
    looks = {
        "self, static": (ink.BLUE, "o"), "self, moving": (ink.GREEN, "^"),
        "tracker": (ink.ORANGE, "s"), "joint": (ink.BLACK, "D"),
    }  # fmt: skip
    fig = figure(3.6)
    ax = fig.subplots()
    for method, (colour, marker) in looks.items():
        own = [c for c in study.choices if c.method == method and not np.isnan(c.rms)]
        x = [c.effort.cost for c in own]
        y = [1e3 * c.rms for c in own]
        error = [1e3 * np.nan_to_num(c.standard_error) for c in own]
        ax.errorbar(x, y, error, color=colour, marker=marker, linestyle="-", linewidth=1.0,
                    capsize=2, label=method)  # fmt: skip
        left = method == "self, moving"
        for choice, cost, value in zip(own, x, y, strict=True):
            ax.annotate(choice.what, (cost, value), xytext=(-7 if left else 7, 3), fontsize=7,
                        textcoords="offset points", ha="right" if left else "left")  # fmt: skip
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.margins(x=0.3, y=0.15)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:g}"[:1] in "25" else "")
    ax.tick_params(which="minor", labelsize=7)
    ax.set_xlabel("cost: machine, people and instrument")
    ax.set_ylabel("rms error of an angle, mrad")
    legend_above(ax, len(looks))
    return fig
