"""Success of the assembly against the angle error, in words, rows and a figure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.reports.cells import Row, mean_of, mean_se, number, share_said
from studies.reports.controlled import cell_document
from studies.runs.success import SuccessStudy
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, legend_above
from tdfscal.reporting.layout import Report, Section, Table

_NOTE = (
    "Each controller knows zeros, mass and barycentre, and every sensor is off by a normal turn of "
    "the stated standard deviation about each axis. A run succeeds where it seats and no true "
    "force before was beyond its limit along any axis; intervals are Clopper and Pearson's, 95 %. "
    "Each stiffness has the least damping that is stable with it, and the newtons go with both."
)


def _stiffness(study: SuccessStudy) -> tuple[str, ...]:
    return tuple(f"{1e-6 * k:.2g} N/µm" for k in study.stiffness)


def report(study: SuccessStudy) -> Report:
    """Lay out success, forces and jams by angle error and contact stiffness."""
    rows, columns = range(len(study.deviations)), range(len(study.studies))
    names = [f"{1e3 * d:g} mrad" for d in study.deviations]
    header = ("angle error, std", *_stiffness(study))
    setup = study.studies[0].setup
    limits = ", ".join(f"{v:g}" for v in setup.controller.thresholds)

    def table(caption: str, cell: Any) -> Table:
        body = tuple((names[d], *(cell(s, d) for s in columns)) for d in rows)
        return Table(caption, header, body)

    blocks = (
        table(
            f"Assemblies without a force above its limit ({limits} N), % with interval",
            lambda s, d: share_said(study.studies[s].success(d)),
        ),
        table(
            "Largest true force along an axis, N, mean ± standard error over runs in contact",
            lambda s, d: mean_se(study.force(s, d), study.runs),
        ),
        table(
            "Stopped before the seat, jammed or at a false force, runs",
            lambda s, d: str(study.studies[s].jammed[d].sum()),
        ),
        Table(
            "Damping of the impedance, the least that is stable",
            ("", *_stiffness(study)),
            (("N·s/m", *(f"{one.setup.controller.impedance.damping[0]:.3g}"
                         for one in study.studies)),),
        ),
        _NOTE,
    )  # fmt: skip
    return Report(
        title=f"Success of the assembly: {setup.rig.name}",
        subtitle=f"{setup.speed * 1e3:g} mm/s, {1e3 * setup.gears.length:.3g} mm of engagement, "
        f"{study.runs} runs of each",
        sections=(Section("Success", blocks),),
    )


def document(study: SuccessStudy) -> dict[str, Any]:
    """The study as plain JSON values, SI units."""
    setup = study.studies[len(study.studies) // 2].setup
    return {
        "rig": setup.rig.name,
        "seed": study.seed,
        "runs": study.runs,
        "engagement": setup.gears.length,
        "cell": cell_document(setup.controller),
        "cases": list(_cases(study)),
        "note": _NOTE,
    }


def tables(study: SuccessStudy) -> dict[str, Iterable[Row]]:
    """One row per angle error and stiffness."""
    return {"success.csv": _cases(study)}


def _cases(study: SuccessStudy) -> Iterator[Row]:
    for s, one in enumerate(study.studies):
        for d, deviation in enumerate(study.deviations.tolist()):
            found = one.success(d)
            force, error = map(number, mean_of(study.force(s, d)))
            yield {
                "contact_N_per_m": float(study.stiffness[s]),
                "damping_Ns_per_m": one.setup.controller.impedance.damping[0],
                "angle_std_rad": deviation,
                "runs": found.runs,
                "succeeded": found.count,
                "low": found.low,
                "high": found.high,
                "seated": int(one.seated[d].sum()),
                "jammed": int(one.jammed[d].sum()),
                "touched": int(one.touched[d].sum()),
                "force_N": force,
                "force_standard_error_N": error,
            }


def drawings(study: SuccessStudy) -> tuple[Drawing, ...]:
    """Probability of success against the angle error, a line per stiffness."""
    middle = len(study.studies) // 2
    good = [
        d for d in range(len(study.deviations)) if study.studies[middle].success(d).value >= 0.9
    ]
    reading = f"At {_stiffness(study)[middle]} "
    if good:
        reading += f"nine in ten succeed up to {1e3 * study.deviations[good[-1]]:g} mrad per axis."
    else:
        reading += "no angle error lets nine in ten succeed."
    title = "Assembly without a force above its limit, against the error of the angles"
    return (Drawing("success", title, reading, partial(_paint, study)),)


def _paint(study: SuccessStudy) -> Figure:
    marks = (
        (ink.BLACK, ":", "x"), (ink.ORANGE, "--", "s"), (ink.BLUE, "-", "o"),
        (ink.GREEN, "-.", "^"), (ink.RED, "-", "v"),
    )  # fmt: skip
    fig = figure(3.4)
    ax = fig.subplots()
    for s, name in enumerate(_stiffness(study)):
        colour, line, marker = marks[s % len(marks)]
        found = [study.studies[s].success(d) for d in range(len(study.deviations))]
        value = np.array([f.value for f in found])
        spread = np.array([[f.value - f.low, f.high - f.value] for f in found]).T
        x = 1e3 * study.deviations * (1.0 + 0.04 * (s - (len(study.studies) - 1) / 2))
        ax.errorbar(x, 100 * value, 100 * spread, color=colour, linestyle=line, marker=marker,
                    markersize=4, capsize=2, linewidth=1.1, elinewidth=0.7, label=name)  # fmt: skip
    ax.set_xscale("log")
    ax.set_xticks(1e3 * study.deviations, [f"{1e3 * d:g}" for d in study.deviations])
    ax.minorticks_off()
    ax.set_ylim(-3, 103)
    ax.set_xlabel("standard deviation of a sensor's turn about each axis, mrad")
    ax.set_ylabel("assemblies that succeed, %")
    legend_above(ax, len(study.studies))
    return fig
