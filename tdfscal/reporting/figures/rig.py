"""The rig: hinges, barycentre, and the sensors' axes, nominal and turned."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from tdfscal.files.calibration.document import Calibration
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, projection

#: The largest turn is drawn about this big.
_SHOWN = np.radians(25.0)
_STEPS = (1, 2, 5)
_ELEVATION = 24
_AZIMUTHS = range(-80, -9, 5)
_NOMINAL: dict[str, Any] = {"linestyle": (0, (3, 2)), "linewidth": 0.9}
_TURNED: dict[str, Any] = {"linestyle": "-", "linewidth": 1.8}
_COLOURS = (ink.ORANGE, ink.GREEN, ink.BLUE)


def draw(c: Calibration) -> Drawing:
    """The terminal level, in LCS coordinates; sensor frames in the BCS."""
    nominal, turn = _turns(c)
    size = np.linalg.norm(turn, axis=1)
    i = int(size.argmax())
    factor = magnification(float(size.max()))
    shown = f"turns magnified {factor}×" if factor > 1 else "turns drawn as they are"
    return Drawing(
        "rig",
        "The rig and how its sensors are turned",
        f"{c.support_names[i]} is turned most against its nominal mounting, by "
        f"{1e3 * size[i]:.3g} mrad ({np.degrees(size[i]):.2g}°); {shown}.",
        lambda: _paint(c, nominal, so3.exp(factor * turn) @ nominal, factor),
    )


def magnification(largest: float) -> int:
    """Return a round factor that shows the largest turn (rad) clearly; 1 where that is so."""
    wanted = _SHOWN / largest if largest > 0 else 1.0
    decade = int(10 ** np.floor(np.log10(max(wanted, 1.0))))
    return max([1, *(step * decade for step in _STEPS if step * decade <= wanted)])


def clear_view(points: FloatArray) -> int:
    """Return the azimuth in degrees from which no two points (N, 3) hide each other."""

    def gap(azimuth: int) -> float:
        seen = points @ projection(np.radians(azimuth), np.radians(_ELEVATION)).T
        apart = np.linalg.norm(seen[:, None] - seen, axis=2)
        return float(apart[np.triu_indices(len(points), 1)].min())

    return max(_AZIMUTHS, key=gap)


def _turns(c: Calibration) -> tuple[FloatArray, FloatArray]:
    """Nominal mountings (n, 3, 3) and rotation vectors (n, 3), rad, BCS, to the calibrated ones.

    0 where a sensor's mounting is not determined.
    """
    nominal = so3.from_rpy(np.array([s.nominal_rpy for s in c.rig.supports]))
    turn = so3.log(c.rotation @ np.swapaxes(nominal, 1, 2))
    return nominal, np.where(c.determined[:, None], turn, 0.0)


def _paint(c: Calibration, nominal: FloatArray, turned: FloatArray, factor: int) -> Figure:
    hinge = np.array([s.hinge for s in c.rig.supports])
    bary = np.array(c.terminal.barycenter.value)
    middle = hinge.mean(axis=0)
    length = 0.4 * float(np.linalg.norm(hinge - middle, axis=1).mean())
    fig = figure(3.2, arranged=False)
    ax: Any = fig.add_axes((0.0, 0.04, 1.0, 0.98), projection="3d")
    around = np.argsort(np.arctan2(*(hinge - middle)[:, 1::-1].T))
    ax.plot(*hinge[np.append(around, around[0])].T, color=ink.GREY, linewidth=1.0)
    for h in hinge:
        ax.plot(*np.array([h, bary]).T, color=ink.GREY, linewidth=0.6, linestyle=":")
    ax.plot(*hinge.T, "o", color=ink.BLACK, markersize=6)
    foot = np.array([bary, [bary[0], bary[1], middle[2]]])
    ax.plot(*foot.T, color=ink.BLACK, linewidth=1.0, linestyle="--")
    ax.plot(*bary[:, None], "D", color=ink.BLACK, markersize=7, markerfacecolor="white")
    ax.text(*(bary + length * np.array([0.12, 0, 0.28])), "barycentre", fontsize=8)
    for i, support in enumerate(c.supports):
        over = hinge[i] + np.array([0.0, 0.0, 1.45 * length])
        ax.text(*over, support.name, fontsize=9, fontweight="bold", ha="center")
        for k, name in enumerate("xyz" if support.determined else ""):
            for frame, look in ((nominal, _NOMINAL), (turned, _TURNED)):
                ends = hinge[i] + length * np.outer([0.0, 1.0], frame[i, :, k])
                ax.plot(*ends.T, color=_COLOURS[k], **look)
            tip = hinge[i] + 1.14 * length * turned[i, :, k]
            ax.text(*tip, name, color=_COLOURS[k], fontsize=8, ha="center", va="center")
    ax.view_init(elev=_ELEVATION, azim=clear_view(np.vstack([hinge, bary])))
    _frame(ax, np.vstack([hinge, bary, hinge + np.array([0, 0, length])]), length)
    shown = f"calibrated, turn ×{factor}" if factor > 1 else "calibrated"
    handles = [
        Line2D([], [], marker="o", color=ink.BLACK, linestyle="", label="hinge (SHC)"),
        Line2D([], [], color=ink.BLACK, label="nominal axes", **_NOMINAL),
        Line2D([], [], color=ink.BLACK, label=f"axes {shown}", **_TURNED),
    ]
    fig.legend(handles=handles, loc="upper left", ncols=3)
    return fig


def _frame(ax: Any, points: FloatArray, margin: float) -> None:
    low, high = points.min(axis=0) - 0.6 * margin, points.max(axis=0) + 0.6 * margin
    for axis, a, b in zip("xyz", low, high, strict=True):
        getattr(ax, f"set_{axis}lim")(a, b)
        getattr(ax, f"{axis}axis").set_major_locator(MaxNLocator(5))
        getattr(ax, f"set_{axis}label")(f"{axis.upper()}, m", fontsize=8)
    ax.set_box_aspect(high - low, zoom=1.18)
    ax.tick_params(labelsize=7, pad=0)
