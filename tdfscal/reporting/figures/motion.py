"""A log in motion: residual wrench over time, its spectrum, and the forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.log_time import clock_from
from tdfscal.files.calibration.motion import MotionSpectrum
from tdfscal.motioncal.contact import Stretch
from tdfscal.motioncal.streams import Slow
from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import (
    Drawing,
    figure,
    legend_above,
    legend_outside,
    logarithmic,
    tip,
)
from tdfscal.validation.in_motion import MovingValidation

_TITLE = "Residual contact wrench over the motion"
#: Means further apart than this, s, are of different stretches.
_GAP = 2.5
Stretches = Sequence[tuple[float, float, str]]
#: Instants of a line at most; more are not to be told apart.
_INSTANTS = 1500


def draw(c: Calibration) -> Drawing | None:
    """Of a calibration: the course that its file holds."""
    if c.motion is None or c.motion.residual is None:
        return None
    r = c.motion.residual
    before = np.stack([np.array(r.force_before), np.array(r.moment_before)], axis=1)
    after = np.stack([np.array(r.force_after), np.array(r.moment_after)], axis=1)
    left_out = [(s.begin, s.end, s.reason) for s in c.motion.rejected]
    return _drawing(np.array(r.time), before, after, left_out, "calibrated")


def validated(v: MovingValidation) -> Drawing:
    """Of a validation."""
    r = v.residual
    left_out = [(s.begin, s.end, s.reason) for s in v.rejected]
    return _drawing(r.time, r.before, r.after, left_out, "with this calibration")


def _drawing(
    time: FloatArray, before: FloatArray, after: FloatArray, left_out: Stretches, said: str
) -> Drawing:
    grey = "; what is shaded was left out" if left_out else ""
    rms = np.sqrt(np.mean(after[:, 0] ** 2))
    return Drawing(
        "residual-over-time",
        _TITLE,
        "Nothing should be left while nothing touches the terminal; the residual force is "
        f"{rms:.2g} N (rms of means over a second){grey}.",
        lambda: _paint_residual(time, before, after, left_out, said),
    )


def _paint_residual(
    time: FloatArray, before: FloatArray, after: FloatArray, left_out: Stretches, said: str
) -> Figure:
    """Draw lengths (N, 2) of force and moment at times (N,), s."""
    fig = figure(4.0)
    axes = fig.subplots(2, 1, sharex=True)
    cuts = np.flatnonzero(np.diff(time) > _GAP) + 1
    for k, (ax, label) in enumerate(zip(axes, ("force, N", "moment, N·m"), strict=True)):
        for value, colour, name in (
            (before, ink.ORANGE, "before: nominal mounting, stated zeros"),
            (after, ink.BLUE, f"after: {said}"),
        ):
            for part, rows in enumerate(np.split(np.arange(len(time)), cuts)):
                ax.plot(
                    time[rows], value[rows, k], color=colour, linewidth=1.0,
                    label=name if part == 0 else None,
                )  # fmt: skip
        for begin, end, reason in left_out:
            tip(ax.axvspan(begin, end, color=ink.PALE), f"{begin:.1f} to {end:.1f} s: {reason}")
        if min(before[:, k].min(), after[:, k].min()) > 0:
            logarithmic(ax)
        ax.set_ylabel(label)
    axes[-1].set_xlabel("time in the log, s")
    legend_above(axes[0], 2)
    return fig


def spectrum(c: Calibration) -> Drawing | None:
    """Residual force over frequency, and the noise that the estimate weighed by."""
    if c.motion is None:
        return None
    spectrum = c.motion.spectrum
    return Drawing(
        "spectrum",
        "Residual force in motion, over frequency",
        f"In {c.motion.seconds:.0f} s of motion the calibration takes the slow residual down to "
        "the sensors' noise; the estimate weighs every frequency by the noise that it has there.",
        lambda: _paint_spectrum(spectrum, len(c.supports)),
    )


def _paint_spectrum(spectrum: MotionSpectrum, n: int) -> Figure:
    """Draw square roots of spectral densities, of the three force components together."""
    fig = figure(3.2)
    ax = fig.subplots()
    f = np.array(spectrum.frequency)
    # Force noise of n sensors in three components, as the residual has it.
    noise = np.sqrt(3.0 * n) * np.array(spectrum.force_noise)
    ax.plot(f, spectrum.before, "s", markersize=4, color=ink.ORANGE, markerfacecolor="white",
              label="before: nominal mounting, stated values")  # fmt: skip
    ax.plot(f, spectrum.after, "o", markersize=4, color=ink.BLUE, label="after: calibrated")
    ax.plot(f, noise, "-", color=ink.BLUE, linewidth=1, label="noise as estimated")
    logarithmic(ax, "xy")
    ax.set_xlabel("frequency, Hz")
    ax.set_ylabel("residual force, N/√Hz")
    legend_above(ax, 3)
    return fig


def forces(slow: Slow, rejected: Sequence[Stretch]) -> Drawing:
    """A panel per axis of the sensors, a line per sensor."""
    said = f"{slow.time[-1] - slow.time[0]:.0f} s of the log are in motion"
    lost = sum(s.end - s.begin for s in rejected)
    said += f"; {lost:.0f} s in {len(rejected)} stretches (hatched) were left out." if lost else "."
    return Drawing("forces", "The log and its forces", said, lambda: _paint_forces(slow, rejected))


def _paint_forces(slow: Slow, rejected: Sequence[Stretch]) -> Figure:
    time = clock_from(float(slow.time[0]))
    fig = figure(3.4)
    every = max(1, len(slow.time) // _INSTANTS)
    x, force = slow.time[::every] - time.origin, slow.force[::every]
    panels = fig.subplots(3, 1, sharex=True)
    for k, ax in enumerate(panels):
        for s in rejected:
            begin, end = s.begin - time.origin, s.end - time.origin
            tip(ax.axvspan(begin, end, linewidth=0.4, **ink.REJECTED), s.reason)
        for i, name in enumerate(slow.supports):
            y = force[:, i, k]
            if not np.isfinite(y).any():
                continue
            (line,) = ax.plot(x, y, color=ink.LINES[i % len(ink.LINES)], linewidth=1.1, label=name)
            tip(line, f"{name} F{'xyz'[k]}: {np.nanmin(y):.1f} to {np.nanmax(y):.1f} N")
        ax.set_ylabel(f"F{'xyz'[k]}, N", color=ink.BLACK)
    panels[-1].set_xlabel(time.label)
    legend_outside(fig, panels[0])
    return fig
