"""The spectrum of the residual force in motion, before and after the calibration."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.motion import MotionSpectrum
from tdfscal.reporting.figures.style import BLUE, ORANGE, Drawing, figure, legend_above, logarithmic


def draw(c: Calibration) -> Drawing | None:
    """Residual force over frequency, and the noise that the estimate weighed by."""
    if c.motion is None:
        return None
    spectrum = c.motion.spectrum
    return Drawing(
        "spectrum",
        "Residual force in motion, over frequency",
        f"In {c.motion.seconds:.0f} s of motion the calibration takes the slow residual down to "
        "the sensors' noise; the estimate weighs every frequency by the noise that it has there.",
        lambda: _paint(spectrum, len(c.supports)),
    )


def _paint(spectrum: MotionSpectrum, n: int) -> Figure:
    """Draw square roots of spectral densities, of the three force components together."""
    fig = figure(3.2)
    ax = fig.subplots()
    f = np.array(spectrum.frequency)
    # Force noise of n sensors in three components, as the residual has it.
    noise = np.sqrt(3.0 * n) * np.array(spectrum.force_noise)
    ax.plot(f, spectrum.before, "s", markersize=4, color=ORANGE, markerfacecolor="white",
              label="before: nominal mounting, stated values")  # fmt: skip
    ax.plot(f, spectrum.after, "o", markersize=4, color=BLUE, label="after: calibrated")
    ax.plot(f, noise, "-", color=BLUE, linewidth=1, label="noise as estimated")
    logarithmic(ax, "xy")
    ax.set_xlabel("frequency, Hz")
    ax.set_ylabel("residual force, N/√Hz")
    legend_above(ax, 3)
    return fig
