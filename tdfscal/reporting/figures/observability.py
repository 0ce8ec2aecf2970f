"""Which directions are weak: the uncertainty ellipsoid of each sensor's rotation."""

from __future__ import annotations

from math import ceil
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from tdfscal.files.calibration.document import Calibration
from tdfscal.records import FloatArray
from tdfscal.reporting.figures.style import BLUE, INK, ORANGE, Drawing, figure

_COLUMNS = 3
#: Axes closer than this to the load's line are called the load's own.
_ALONG = np.radians(20.0)


def draw(c: Calibration) -> Drawing:
    """One ellipsoid per sensor, its longest axis, and the loads' line of action."""
    std, axes = principal(c)
    i = int(std[:, 2].argmax())
    j = int(np.argmax(std[:, 2] / std[:, 0]))
    said = (
        f"The weakest direction is a turn of {c.mounted[i].name} about "
        f"{_about(axes[i, :, 2])}: {1e3 * std[i, 2]:.2g} mrad"
    )
    off = _from_load(c, i, axes[i, :, 2])
    if off is not None:
        said += f", {np.degrees(off):.0f}° from the line of its loads"
        if off < _ALONG:
            said += " (turning a sensor about its load changes nothing)"
    ratio = std[j, 2] / std[j, 0]
    said += f". Weak and strong directions of one sensor differ by a factor of {ratio:.2g} at most."
    return Drawing("observability", "Observability", said, lambda: _paint(c))


def principal(c: Calibration) -> tuple[FloatArray, FloatArray]:
    """Standard uncertainties (m, 3), rad, ascending, and their axes (m, 3, 3), columns, BCS.

    Of the m sensors that the data determine.
    """
    n, known = len(c.supports), np.flatnonzero(c.determined)
    blocks = c.rotation_covariance.reshape(n, 3, n, 3)[known, :, known]
    values, vectors = np.linalg.eigh(blocks)
    return np.sqrt(np.maximum(values, 0.0)), vectors


def _from_load(c: Calibration, i: int, axis: FloatArray) -> float | None:
    loads = c.observability.loads if c.observability else None
    if not loads:
        return None
    load = np.array(loads[np.flatnonzero(c.determined)[i]].axis)
    return float(np.arccos(min(1.0, abs(float(axis @ load)))))


def _about(axis: FloatArray) -> str:
    """Words for a direction of the BCS."""
    k = int(np.abs(axis).argmax())
    off = np.degrees(np.arccos(min(1.0, abs(float(axis[k])))))
    name = "XYZ"[k]
    return f"{name} of the BCS" if off < 5 else f"an axis {off:.0f}° from {name} of the BCS"


def _paint(c: Calibration) -> Figure:
    std, axes = principal(c)
    n = len(std)
    columns = min(n, _COLUMNS) if n != 4 else 2
    rows = ceil(n / columns)
    fig = figure(0.35 + 2.75 * rows)
    reach = 1.25e3 * float(std.max())
    for i, support in enumerate(c.mounted):
        ax: Any = fig.add_subplot(rows, columns, i + 1, projection="3d")
        _ellipsoid(ax, 1e3 * std[i], axes[i])
        weak = 1e3 * std[i, 2] * axes[i, :, 2]
        ax.plot(*np.array([-weak, weak]).T, "o-", color=ORANGE, linewidth=2.2, markersize=4)
        loads = c.observability.loads if c.observability else None
        if loads:
            line = reach * np.array(loads[np.flatnonzero(c.determined)[i]].axis)
            ax.plot(*np.array([-line, line]).T, "--", color=INK, linewidth=1.2)
        sizes = " · ".join(f"{1e3 * s:.2g}" for s in std[i])
        ax.set_title(f"{support.name}: {sizes} mrad", pad=0)
        for axis, name in zip("xyz", "XYZ", strict=True):
            getattr(ax, f"set_{axis}lim")(-reach, reach)
            getattr(ax, f"{axis}axis").set_major_locator(MaxNLocator(3, symmetric=True))
            getattr(ax, f"set_{axis}label")(
                f"{name}, mrad", fontsize=7, labelpad=-4 if name != "Z" else -2
            )
        ax.tick_params(labelsize=6.5, pad=-3)
        ax.tick_params(axis="z", pad=1)
        ax.set_box_aspect((1, 1, 1), zoom=0.84)
        ax.view_init(elev=18, azim=-58)
    handles = [
        _key("-", BLUE, "standard uncertainty of the turn about each direction of the BCS"),
        _key("o-", ORANGE, "weakest direction"),
    ]
    if c.observability and c.observability.loads:
        handles.append(_key("--", INK, "line of its loads"))
    fig.legend(handles=handles, loc="outside upper left", ncols=3)
    return fig


def _key(style: str, colour: str, label: str) -> Line2D:
    marker = "o" if "o" in style else None
    line: Any = style.strip("o")
    return Line2D([], [], linestyle=line, marker=marker, color=colour, label=label)


def _ellipsoid(ax: Any, std: FloatArray, axes: FloatArray) -> None:
    u, v = np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13)
    ball = np.stack(
        [
            np.outer(np.cos(u), np.sin(v)),
            np.outer(np.sin(u), np.sin(v)),
            np.outer(np.ones_like(u), np.cos(v)),
        ]
    )
    shape = np.einsum("ab,b,buv->auv", axes, std, ball)
    ax.plot_wireframe(*shape, rcount=13, ccount=7, color=BLUE, linewidth=0.45, alpha=0.8)
