"""The rig in space: how its sensors are turned, which turns are known worst, which not at all."""

from __future__ import annotations

from math import ceil
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tdfscal.estimation.observability import Observability
from tdfscal.files.calibration.document import Calibration
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.angles import by_angle
from tdfscal.reporting.figures.style import Drawing, beside, figure, logarithmic

_ROUND = (1, 1.5, 2, 3, 4, 5, 7, 10)
_STEPS = (1, 2, 5)
#: The largest turn is drawn about this big, rad.
_SHOWN = np.radians(25.0)
#: Degrees from which the rig is seen.
_ELEVATION, _AZIMUTHS = 24, range(-80, -9, 5)
_NOMINAL: dict[str, Any] = {"linestyle": (0, (3, 2)), "linewidth": 0.9}
_TURNED: dict[str, Any] = {"linestyle": "-", "linewidth": 1.8}
_COLOURS = (ink.ORANGE, ink.GREEN, ink.BLUE)
_COLUMNS = 3
#: Size of a sensor's place in lengths of the axes of the BCS; those are of round length.
_WIDE, _HIGH = 2.7, 3.1
#: Axes closer than this to the load's line are called the load's own, rad.
_ALONG = np.radians(20.0)
#: rad; a turn no better known than this is not known at all.
_OPEN = 1.0


def projection(azimuth: float, elevation: float) -> FloatArray:
    """(2, 3): what is right and what is up of a space that is seen from there, degrees."""
    a, e = np.radians(azimuth), np.radians(elevation)
    up = [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]
    return np.array([[-np.sin(a), np.cos(a), 0.0], up])


#: From where the directions of the BCS are seen.
_VIEW = projection(-58, 18)


def _plane(height: float, said: str) -> tuple[Figure, Axes]:
    """A figure of what is seen, without ticks."""
    fig = figure(height)
    ax = fig.subplots()
    ax.set(aspect="equal", xticks=[], yticks=[], xlabel=said)
    ax.spines[:].set_visible(False)
    return fig, ax


def rig(c: Calibration) -> Drawing:
    """Hinges and barycentre, the terminal level, in LCS coordinates; sensor frames in the BCS."""
    nominal = so3.from_rpy(np.array([s.nominal_rpy for s in c.rig.supports]))
    turn = so3.log(c.rotation @ np.swapaxes(nominal, 1, 2))
    turn[~c.determined] = 0.0
    size = np.linalg.norm(turn, axis=1)
    i = int(size.argmax())
    factor = magnification(float(size.max()))
    shown = f"turns magnified {factor}×" if factor > 1 else "turns drawn as they are"
    return Drawing(
        "rig",
        "The rig and how its sensors are turned",
        f"{c.support_names[i]} is turned most against its nominal mounting, by "
        f"{1e3 * size[i]:.3g} mrad ({np.degrees(size[i]):.2g}°); {shown}.",
        lambda: _paint_rig(c, nominal, so3.exp(factor * turn) @ nominal, factor),
    )


def magnification(largest: float) -> int:
    """Return a round factor that shows the largest turn (rad) clearly; 1 where that is so."""
    wanted = _SHOWN / largest if largest > 0 else 1.0
    decade = int(10 ** np.floor(np.log10(max(wanted, 1.0))))
    return max([1, *(step * decade for step in _STEPS if step * decade <= wanted)])


def clear_view(points: FloatArray) -> int:
    """Return the azimuth in degrees from which no two points (N, 3) hide each other."""

    def gap(azimuth: int) -> float:
        seen = points @ projection(azimuth, _ELEVATION).T
        apart = np.linalg.norm(seen[:, None] - seen, axis=2)
        return float(apart[np.triu_indices(len(points), 1)].min())

    return max(_AZIMUTHS, key=gap)


def _paint_rig(c: Calibration, nominal: FloatArray, turned: FloatArray, factor: int) -> Figure:
    hinge = np.array([s.hinge for s in c.rig.supports])
    bary, middle = np.array(c.terminal.barycenter.value), hinge.mean(axis=0)
    length = 0.4 * float(np.linalg.norm(hinge - middle, axis=1).mean())
    scale = round_above(0.6 * length)
    view = projection(clear_view(np.vstack([hinge, bary])), _ELEVATION)
    fig, ax = _plane(3.4, f"X, Y: axes of the LCS from its origin, {scale:g} m")

    def line(*ends: FloatArray, **look: Any) -> None:
        ax.plot(*(view @ np.transpose(ends)), **look)

    def word(text: str, place: FloatArray, **look: Any) -> None:
        x, y = view @ place
        ax.text(x, y, text, **{"fontsize": 8, "ha": "center", "va": "center", **look})

    around = np.argsort(np.arctan2(*(hinge - middle)[:, 1::-1].T))
    ax.fill(*(view @ hinge[around].T), facecolor="#f2f2f2", edgecolor=ink.GREY, linewidth=1.0)
    for place in hinge:
        line(place, bary, color=ink.GREY, linewidth=0.6, linestyle=":")
    for name, axis in zip("XY", scale * np.eye(3), strict=False):
        line(0 * axis, axis, color=ink.GREY, linewidth=0.7)
        word(name, 1.2 * axis, fontsize=7, color=ink.GREY)
    foot = np.array([bary[0], bary[1], middle[2]])
    line(bary, foot, color=ink.BLACK, linewidth=1.0, linestyle="--")
    line(bary, color=ink.BLACK, marker="D", markersize=7, markerfacecolor="white")
    word("barycentre", bary + length * np.array([0.0, 0.0, 0.25]))
    for i, support in enumerate(c.supports):
        line(hinge[i], color=ink.BLACK, marker="o", markersize=6)
        word(support.name, hinge[i] + length * np.array([0.0, 0.0, 1.5]), fontweight="bold")
        for k, name in enumerate("xyz" if support.determined else ""):
            for frame, look in ((nominal, _NOMINAL), (turned, _TURNED)):
                end = hinge[i] + length * frame[i, :, k]
                line(hinge[i], end, color=_COLOURS[k], **look)
            word(name, hinge[i] + 1.15 * length * turned[i, :, k], color=_COLOURS[k])
    ax.margins(0.08)
    shown = f"calibrated, turn ×{factor}" if factor > 1 else "calibrated"
    handles = [
        Line2D([], [], marker="o", color=ink.BLACK, linestyle="", label="hinge (SHC)"),
        Line2D([], [], color=ink.BLACK, label="nominal axes", **_NOMINAL),
        Line2D([], [], color=ink.BLACK, label=f"axes {shown}", **_TURNED),
    ]
    fig.legend(handles=handles, loc="outside upper left", ncols=3)
    return fig


def weakest(c: Calibration) -> Drawing:
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
    return Drawing("observability", "Observability", said, lambda: _paint_weakest(c))


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


def _paint_weakest(c: Calibration) -> Figure:
    """All sensors side by side on one pair of axes, seen from one side; one scale for all."""
    std, axes = principal(c)
    n = len(std)
    columns = min(n, _COLUMNS) if n != 4 else 2
    scale = round_above(1e3 * float(std.max()))
    fig, ax = _plane(
        0.6 + 2.35 * ceil(n / columns), f"X, Y, Z: axes of the BCS, {scale:g} mrad either way"
    )
    loads = c.observability.loads if c.observability else None
    rows = np.flatnonzero(c.determined)
    for i, support in enumerate(c.mounted):
        place = scale * np.array([_WIDE * (i % columns), -_HIGH * (i // columns)])

        def both_ways(vector: FloatArray, *mark: str, at: FloatArray = place, **look: Any) -> None:
            ax.plot(*(at + np.array([-vector, vector]) @ _VIEW.T).T, *mark, **look)

        for name, axis in zip("XYZ", scale * np.eye(3), strict=True):
            both_ways(axis, color=ink.GREY, linewidth=0.7)
            x, y = place + 1.1 * _VIEW @ axis
            ax.text(x, y, name, fontsize=7, color=ink.GREY, ha="center", va="center")
        wires = [place + line for line in _ellipsoid(1e3 * std[i], axes[i])]
        ax.add_collection(LineCollection(wires, colors=ink.BLUE, linewidths=0.45, alpha=0.8))
        weak = 1e3 * std[i, 2] * axes[i, :, 2]
        both_ways(weak, "o-", color=ink.ORANGE, linewidth=2.2, markersize=4)
        if loads:
            line = 1.12 * scale * np.array(loads[rows[i]].axis)
            both_ways(line, "--", color=ink.BLACK, linewidth=1.2)
        sizes = " · ".join(f"{1e3 * s:.2g}" for s in std[i])
        x, y = place + np.array([0.0, 1.22 * scale])
        ax.text(x, y, f"{support.name}\n{sizes} mrad", ha="center", va="bottom", fontsize=8)
    ax.set_xlim(-0.5 * _WIDE * scale, (columns - 0.5) * _WIDE * scale)
    ax.set_ylim((1.8 - _HIGH * ceil(n / columns)) * scale, 1.8 * scale)
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
    std = np.array([angle.std for angle in seen.angles])
    shown = 1e3 * np.clip(np.nan_to_num(std, nan=_OPEN, posinf=_OPEN), 0.0, _OPEN)
    fig, (ax,), place = by_angle(list(dict.fromkeys(a.support for a in seen.angles)), row=0.21)
    left = 0.5 * min(float(shown[shown > 0].min(initial=1e3 * limit)), 1e3 * limit)
    for y, width, angle in zip(place, shown, seen.angles, strict=True):
        look = {"facecolor": ink.BLUE, **ink.EDGE} if angle.identified else ink.REJECTED
        ax.barh(y, width - left, left=left, height=0.72, **look)
        beside(ax, words(angle.std), width, y, 4)
    ax.axvline(1e3 * limit, color=ink.BLACK, linewidth=1.2, linestyle="--")
    ax.set_title(f"dashed: limit {1e3 * limit:.3g} mrad", fontsize=7.5, loc="right", pad=2)
    logarithmic(ax, "x")
    ax.set_xlim(left, 4e3 * _OPEN)
    ax.set_xlabel("standard uncertainty, mrad; hatched: not determined")
    return fig


def words(std: float) -> str:
    """A standard uncertainty in rad, as it is worth saying."""
    if not std < _OPEN:
        return "over 1 rad"
    return f"{1e3 * std:.0f} mrad" if std >= 0.1 else f"{1e3 * std:.2g} mrad"
