"""Which turns the data determine, and which directions of a sensor are weak."""

from __future__ import annotations

from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tdfscal.estimation.observability import Observability
from tdfscal.files.calibration.document import Calibration
from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, beside, figure, logarithmic, projection

_COLUMNS = 3
#: Size of a sensor's place in lengths of the axes of the BCS; those are of round length.
_WIDE, _HIGH = 2.7, 3.1
_ROUND = (1, 1.5, 2, 3, 4, 5, 7, 10)
#: (2, 3): BCS directions as seen from azimuth −58° and elevation 18°, to the right and upwards.
_VIEW = projection(np.radians(-58.0), np.radians(18.0))
#: Axes closer than this to the load's line are called the load's own.
_ALONG = np.radians(20.0)
#: rad; a turn no better known than this is not known at all.
_OPEN = 1.0


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
    """All sensors side by side on one pair of axes, seen from one side; one scale for all."""
    std, axes = principal(c)
    n = len(std)
    columns = min(n, _COLUMNS) if n != 4 else 2
    fig = figure(0.6 + 2.35 * ceil(n / columns))
    ax = fig.subplots()
    scale = round_above(1e3 * float(std.max()))
    loads = c.observability.loads if c.observability else None
    rows = np.flatnonzero(c.determined)
    for i, support in enumerate(c.mounted):
        place = scale * np.array([_WIDE * (i % columns), -_HIGH * (i // columns)])
        _axes(ax, place, scale)
        wires = LineCollection(
            [place + line for line in _ellipsoid(1e3 * std[i], axes[i])],
            colors=ink.BLUE, linewidths=0.45, alpha=0.8,
        )  # fmt: skip
        ax.add_collection(wires)
        sizes = " · ".join(f"{1e3 * s:.2g}" for s in std[i])
        weak = 1e3 * std[i, 2] * axes[i, :, 2]
        ax.plot(*_seen(weak, place), "o-", color=ink.ORANGE, linewidth=2.2, markersize=4)
        if loads:
            line = 1.12 * scale * np.array(loads[rows[i]].axis)
            ax.plot(*_seen(line, place), "--", color=ink.BLACK, linewidth=1.2)
        ax.text(
            place[0], place[1] + 1.22 * scale, f"{support.name}\n{sizes} mrad", ha="center",
            va="bottom", fontsize=8,
        )  # fmt: skip
    ax.set_xlim(-0.5 * _WIDE * scale, (columns - 0.5) * _WIDE * scale)
    ax.set_ylim((1.8 - _HIGH * ceil(n / columns)) * scale, 1.8 * scale)
    said = f"X, Y, Z: axes of the BCS, {scale:g} mrad either way"
    ax.set(aspect="equal", xticks=[], yticks=[], xlabel=said)
    ax.spines[:].set_visible(False)
    said = "standard uncertainty of the turn about each direction of the BCS"
    keys = [
        Line2D([], [], color=ink.BLUE, label=said),
        Line2D([], [], color=ink.ORANGE, marker="o", label="weakest direction"),
        Line2D([], [], color=ink.BLACK, linestyle="--", label="line of its loads"),
    ]
    fig.legend(handles=keys if loads else keys[:2], loc="outside upper left", ncols=3)
    return fig


def round_above(value: float) -> float:
    """The smallest of `_ROUND` times a power of ten that is not below a positive value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(min(step * power for step in _ROUND if step * power >= value * (1 - 1e-9)))


def _seen(vector: FloatArray, place: FloatArray) -> FloatArray:
    """(2, 2), ends of a line from −vector to vector (3,) of the BCS, as seen about a place."""
    return np.asarray((place + np.array([-vector, vector]) @ _VIEW.T).T)


def _axes(ax: Axes, place: FloatArray, scale: float) -> None:
    """Thin axes of the BCS with their names."""
    for k, name in enumerate("XYZ"):
        vector = scale * np.eye(3)[k]
        ax.plot(*_seen(vector, place), color=ink.GREY, linewidth=0.7)
        x, y = place + 1.1 * _VIEW @ vector
        ax.text(x, y, name, fontsize=7, color=ink.GREY, ha="center", va="center")


def _ellipsoid(std: FloatArray, axes: FloatArray) -> list[FloatArray]:
    """Meridians and parallels (M, 2) of an ellipsoid, as seen."""
    u, v = np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13)
    circle = np.array([np.cos(u), np.sin(u), np.ones_like(u)])
    height = np.array([np.sin(v), np.sin(v), np.cos(v)])
    flat = np.einsum("xa,ab,b,bu,bv->uvx", _VIEW, axes, std, circle, height)
    return [*flat[::2], *np.swapaxes(flat, 0, 1)[2:-2:2]]


def determined(seen: Observability, limit: float) -> Drawing:
    """One bar per turn; limit : rad, `acceptance.identifiable`."""
    known = sum(angle.identified for angle in seen.angles)
    said = (
        f"{known} of {len(seen.angles)} turns are determined: their standard uncertainty is below "
        f"{1e3 * limit:.3g} mrad, and below half of what was stated before the log."
    )
    return Drawing(
        "determined", "What the data determine", said, lambda: _paint_determined(seen, limit)
    )


def _paint_determined(seen: Observability, limit: float) -> Figure:
    angles = seen.angles
    std = np.array([angle.std for angle in angles])
    shown = 1e3 * np.clip(np.nan_to_num(std, nan=_OPEN, posinf=_OPEN), 0.0, _OPEN)
    fig = figure(0.8 + 0.19 * len(angles))
    ax = fig.subplots()
    left = 0.5 * min(float(shown[shown > 0].min(initial=1e3 * limit)), 1e3 * limit)
    sensors = list(dict.fromkeys(angle.support for angle in angles))
    place = [k + 0.5 * sensors.index(angle.support) for k, angle in enumerate(angles)]
    for y, width, angle in zip(place, shown, angles, strict=True):
        look = {"facecolor": ink.BLUE, **ink.EDGE} if angle.identified else ink.REJECTED
        ax.barh(y, width - left, left=left, height=0.72, **look)
        beside(ax, words(angle.std), width, y, 4)
    ax.axvline(1e3 * limit, color=ink.BLACK, linewidth=1.2, linestyle="--")
    ax.annotate(
        f"limit {1e3 * limit:.3g} mrad", (1e3 * limit, 1.0), xycoords=("data", "axes fraction"),
        xytext=(3, 3), textcoords="offset points", fontsize=7.5,
    )  # fmt: skip
    logarithmic(ax, "x")
    ax.set_xlim(left, 4e3 * _OPEN)
    ax.set_yticks(place, [angle.name for angle in angles])
    ax.tick_params(axis="y", length=0)
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("standard uncertainty, mrad; hatched: not determined")
    return fig


def words(std: float) -> str:
    """A standard uncertainty in rad, as it is worth saying."""
    if not std < _OPEN:
        return "over 1 rad"
    return f"{1e3 * std:.0f} mrad" if std >= 0.1 else f"{1e3 * std:.2g} mrad"
