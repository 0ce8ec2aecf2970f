"""How well each method finds the angles (Figs. 7–9, 12–14, Table 2)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.reports.cells import Row
from studies.runs.accuracy import Accuracy, MethodResult, angle_names
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, legend_above, logarithmic, signed
from tdfscal.reporting.layout import Items, Report, Section, Table

_SHORT = {"ml": "self, ML", "linear": "self, linear", "tracker": "tracker"}
_COLUMN = {"ml": "ML", "linear": "linear", "tracker": "tracker"}
_MARKS = {"ml": (ink.BLUE, "o"), "linear": (ink.ORANGE, "s"), "tracker": (ink.GREEN, "^")}

#: Standard uncertainties (n, 3), rad, that given calibrations state, by their names.
Stated = Mapping[str, FloatArray]


def report(study: Accuracy, stated: Stated) -> Report:
    """Lay out Table 2 of this rig, and how given calibrations compare with it."""
    rig, options, survey = study.setup.rig, study.setup.options, study.setup.survey
    header = ["sensor", "angle"]
    for result in study.results:
        header += [f"{_COLUMN[result.method]} mean", "std"]
    rows = []
    for i, j, name, angle in angle_names(rig):
        row = [name, angle]
        for result in study.results:
            row += [f"{1e3 * result.mean[i, j]:.4f}", f"{1e3 * result.std[i, j]:.4f}"]
        rows.append(tuple(row))
    left_out = (f"{_SHORT[name]} is left out: {why}" for name, why in study.left_out.items())
    against = (_against(study, name, std) for name, std in stated.items())
    caption = "Error of the installation angles, mrad: mean and standard deviation"
    blocks = (
        Table(caption, tuple(header), tuple(rows), left=2),
        Items(study.verdict, (*map(_judged, study.results), *left_out, *against)),
    )
    return Report(
        title=f"Accuracy of {rig.name}",
        subtitle=f"{study.setup.runs} simulated campaigns of {options.count} postures, tilt "
        f"{np.rad2deg(options.tilt):g}°, internal forces {options.squeeze:g} N; tracker "
        f"{survey.distance:g} m away, {len(survey.targets)} targets per sensor",
        sections=(Section("Accuracy", blocks),),
    )


def _judged(result: MethodResult) -> str:
    """Bias and honesty of one method."""
    worst = float(np.abs(result.bias).max())
    text = f"{result.name}: " + ("unbiased" if result.unbiased else "biased")
    text += f", the largest mean is {worst:.1f} standard errors"
    if result.stated is not None:
        ratio = result.std / result.stated
        text += f"; scatter is {ratio.min():.2f} to {ratio.max():.2f} times the stated"
    if result.failed:
        text += f"; no result in {result.failed} campaigns"
    return text


def _against(study: Accuracy, name: str, std: FloatArray) -> str:
    """How far a calibration, by its stated (n, 3) in rad, is from what this rig allows."""
    best, mean = study.ranking[0], float(std.mean())
    reached = float(best.rms.mean())
    text = f"{name} states {1e3 * mean:.3g} mrad for an angle in the mean: "
    if mean > 1.1 * reached:
        return f"{text}{mean / reached:.3g} times what {best.name} reaches here"
    return f"{text}as good as {best.name} gets here ({1e3 * reached:.3g} mrad)"


def document(study: Accuracy, stated: Stated) -> dict[str, Any]:
    """The study as plain JSON values, SI units."""
    rig, best = study.setup.rig, study.ranking[0]
    reached = float(best.rms.mean())
    return {
        "rig": rig.name,
        "runs": study.setup.runs,
        "seed": study.setup.seed,
        "postures": study.setup.options.count,
        "methods": [
            {
                "method": result.method,
                "name": result.name,
                "failed": result.failed,
                "unbiased": result.unbiased,
                "mean_rms": float(result.rms.mean()),
                "factor": float(result.rms.mean() / best.rms.mean()),
                "supports": [
                    {
                        "name": name,
                        "mean": result.mean[i].tolist(),
                        "std": result.std[i].tolist(),
                        "stated_std": None if result.stated is None else result.stated[i].tolist(),
                    }
                    for i, name in enumerate(rig.supports)
                ],
            }
            for result in study.results
        ],
        "left_out": study.left_out,
        "best": best.method,
        "verdict": study.verdict,
        "calibrations": [
            {"name": name, "rpy_std": std.tolist(), "factor": float(std.mean() / reached)}
            for name, std in stated.items()
        ],
    }


def tables(study: Accuracy, stated: Stated) -> dict[str, Iterable[Row]]:
    """Table 2, the histograms, and every error."""
    del stated
    return {
        "accuracy.csv": _deviations(study),
        "histograms.csv": _bins(study),
        "errors.csv": _errors(study),
    }


def _deviations(study: Accuracy) -> Iterator[Row]:
    for result in study.results:
        runs = len(result.error)
        for i, j, name, angle in angle_names(study.setup.rig):
            std = float(result.std[i, j])
            yield {
                "method": result.method,
                "support": name,
                "angle": angle,
                "runs": runs,
                "failed": result.failed,
                "mean_rad": float(result.mean[i, j]),
                "std_rad": std,
                "rms_rad": float(result.rms[i, j]),
                "standard_error_rad": std / runs**0.5,
                "mean_in_standard_errors": float(result.bias[i, j]),
                "stated_std_rad": None if result.stated is None else float(result.stated[i, j]),
            }


def _bins(study: Accuracy) -> Iterator[Row]:
    """Figs. 7–9 and 12–14 as numbers."""
    for result in study.results:
        for i, j, name, angle in angle_names(study.setup.rig):
            counts, edges = result.histogram(i, j)
            for b in range(len(counts)):
                yield {
                    "method": result.method,
                    "support": name,
                    "angle": angle,
                    "low_rad": float(edges[b]),
                    "high_rad": float(edges[b + 1]),
                    "count": int(counts[b]),
                }


def _errors(study: Accuracy) -> Iterator[Row]:
    """Every campaign."""
    names = [f"{name}.{angle}" for _, _, name, angle in angle_names(study.setup.rig)]
    for result in study.results:
        for run, row in enumerate(result.error.reshape(len(result.error), -1).tolist()):
            yield {"method": result.method, "run": run, **dict(zip(names, row, strict=True))}


def drawings(study: Accuracy, stated: Stated) -> tuple[Drawing, ...]:
    """One figure of histograms per sensor, and all standard deviations together."""
    del stated
    each = (
        Drawing(
            f"errors-{i + 1}-{''.join(c if c.isalnum() else '_' for c in name)}",
            f"Errors of the installation angles of {name}",
            f"{study.setup.runs} simulated campaigns per method.",
            partial(_paint_errors, study, i),
        )
        for i, name in enumerate(study.setup.rig.supports)
    )
    overview = partial(_paint_overview, study)
    return (*each, Drawing("accuracy", "Accuracy of each method", f"{study.verdict}.", overview))


def _paint_errors(study: Accuracy, i: int) -> Figure:
    rows = len(study.results)
    fig = figure(0.5 + 1.9 * rows)
    grid = fig.subplots(rows, 3, squeeze=False)
    name = study.setup.rig.supports[i]
    for row, result in enumerate(study.results):
        for j in range(3):
            ax = grid[row, j]
            _histogram(ax, result, i, j)
            ax.set_title(f"{name}  {ANGLES[j]}: {_SHORT[result.method]}", fontsize=8, pad=3)
            ax.set_xlabel("error, mrad", fontsize=7.5)
        grid[row, 0].set_ylabel("campaigns")
    return fig


def _histogram(ax: Axes, result: MethodResult, i: int, j: int) -> None:
    """Histogram of an angle's errors with the normal curve of their mean and deviation."""
    counts, edges = result.histogram(i, j)
    mean, std = 1e3 * float(result.mean[i, j]), 1e3 * float(result.std[i, j])
    edges = 1e3 * edges
    ax.stairs(counts, edges, fill=True, color="#c6d6ea")
    ax.stairs(counts, edges, color=ink.BLACK, linewidth=0.5)
    x = np.linspace(mean - 4 * std, mean + 4 * std, 121)
    height = counts.sum() * (edges[1] - edges[0]) / (std * np.sqrt(2 * np.pi))
    ax.plot(x, height * np.exp(-(((x - mean) / std) ** 2) / 2), color=ink.ORANGE, linewidth=1.2)
    ax.axvline(0.0, color=ink.BLACK, linewidth=0.8, linestyle="--")
    ax.set_ylim(0.0, 1.45 * max(float(counts.max()), height))
    said = f"mean {signed(mean, '+.2g')}\nσ {std:.3g}"
    ax.text(0.03, 0.96, said, transform=ax.transAxes, va="top", fontsize=7)
    ax.grid(visible=False)
    ax.tick_params(labelsize=7)


def _paint_overview(study: Accuracy) -> Figure:
    names = angle_names(study.setup.rig)
    fig = figure(3.2)
    ax = fig.subplots()
    place = np.arange(len(names)) + 0.6 * np.repeat(np.arange(study.setup.rig.n), 3)
    for k, result in enumerate(study.results):
        here = place + 0.22 * (k - (len(study.results) - 1) / 2)  # side by side
        colour, marker = _MARKS[result.method]
        for value, size, fill, what in (
            (result.std, 6, "full", "standard deviation"),
            (np.abs(result.mean), 4, "none", "|mean|"),
        ):
            ax.plot(
                here, 1e3 * value.ravel(), linestyle="none", marker=marker, color=colour,
                markersize=size, fillstyle=fill, label=f"{_SHORT[result.method]}, {what}",
            )  # fmt: skip
    logarithmic(ax)
    ax.set_ylabel("error of the angle, mrad")
    labels = [f"{name}  {angle}" for _, _, name, angle in names]
    ax.set_xticks(place, labels, rotation=45, ha="right", fontsize=7.5)
    legend_above(ax, len(study.results))
    return fig
