"""What wrong angles cost, and what given calibrations are worth beside it (Fig. 4)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.reports.cells import Row
from studies.runs.sensitivity import Stake, Sweep
from tdfscal.records import ANGLES, FloatArray, Rig
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure
from tdfscal.reporting.layout import Report, Section, Table

Stakes = Mapping[str, list[Stake]]
"""Name of a calibration → its stakes, one per posture and internal force."""

#: Colour, line and marker of roll, pitch and yaw: each tells them apart on its own.
_LINES = ((ink.BLUE, "-", "o"), (ink.ORANGE, "--", "s"), (ink.GREEN, ":", "^"))
_PER_ROW = 4


def _posture(rpy: FloatArray) -> str:
    """The terminal's posture (3,), rad, in words."""
    if not np.any(rpy):
        return "aligned"
    return "roll, pitch, yaw " + ", ".join(f"{v:g}" for v in rpy) + " rad"


def _case(sweep: Sweep, apart: str = ", ") -> str:
    forces = f"internal forces of {sweep.internal:g} N" if sweep.internal else "no internal forces"
    return f"{_posture(sweep.rpy)}{apart}{forces}"


def report(rig: Rig, sweeps: list[Sweep], worth: Stakes) -> Report:
    """Lay out the largest error of each sweep, and what given calibrations are worth."""
    span = sweeps[0].deviation[-1]
    largest = (
        Table(
            f"Error of the contact wrench with one angle of one sensor off by ±{span:g} rad, "
            f"{_case(sweep)}",
            ("sensor", "angle", "force, N", "torque, N·m"),
            tuple(
                (name, ANGLES[j], f"{sweep.force[i, j].max():.2f}",
                 f"{sweep.torque[i, j].max():.2f}")
                for i, name in enumerate(rig.supports)
                for j in range(3)
            ),
            left=2,
        )
        for sweep in sweeps
    )  # fmt: skip
    left = (
        Table(
            f"{name}: error of the contact wrench that its angles take away, and the standard "
            "uncertainty that they leave",
            ("terminal", "internal, N", "N before", "after", "N·m before", "after",
             "dominant contribution"),
            tuple(_stake(rig, stake) for stake in found),
        )
        for name, found in worth.items()
    )  # fmt: skip
    return Report("Sensitivity", sections=(Section("Sensitivity", (*largest, *left)),))


def _stake(rig: Rig, stake: Stake) -> tuple[str, ...]:
    """Error without a calibration and with it, and the angle that matters most."""
    i, j = divmod(int(stake.force.argmax()), 3)
    return (
        _posture(stake.rpy),
        f"{stake.internal:g}",
        *(f"{side[k]:.2f}" for k in (0, 1) for side in (stake.before, stake.after)),
        f"{ANGLES[j]} of {rig.supports[i]}",
    )


def document(rig: Rig, sweeps: list[Sweep], worth: Stakes) -> dict[str, Any]:
    """The study as plain JSON values, SI units."""
    return {
        "rig": rig.name,
        "span": float(sweeps[0].deviation[-1]),
        "sweeps": [
            {
                "rpy": sweep.rpy.tolist(),
                "internal": sweep.internal,
                "supports": [
                    {
                        "name": name,
                        "force_error": sweep.force[i].max(axis=1).tolist(),
                        "torque_error": sweep.torque[i].max(axis=1).tolist(),
                    }
                    for i, name in enumerate(rig.supports)
                ],
            }
            for sweep in sweeps
        ],
        "calibrations": [
            {
                "name": name,
                "postures": [
                    {
                        "rpy": stake.rpy.tolist(),
                        "internal": stake.internal,
                        "uncalibrated": {"force": stake.before[0], "torque": stake.before[1]},
                        "calibrated_std": {"force": stake.after[0], "torque": stake.after[1]},
                    }
                    for stake in found
                ],
            }
            for name, found in worth.items()
        ],
    }


def tables(rig: Rig, sweeps: list[Sweep], worth: Stakes) -> dict[str, Iterable[Row]]:
    """The sweeps, and what each angle's uncertainty costs by itself."""
    found: dict[str, Iterable[Row]] = {"sensitivity.csv": _swept(rig, sweeps)}
    return found | ({"calibrations.csv": _worth(rig, worth)} if worth else {})


def _angles(rig: Rig, of: Sweep | Stake) -> Iterator[tuple[int, int, Row]]:
    """Every angle of every sensor, with the first columns of its rows."""
    roll, pitch, yaw = of.rpy.tolist()
    for i, support in enumerate(rig.supports):
        for j, angle in enumerate(ANGLES):
            yield i, j, {
                "posture_roll": roll, "posture_pitch": pitch, "posture_yaw": yaw,
                "internal_N": of.internal, "support": support, "angle": angle,
            }  # fmt: skip


def _swept(rig: Rig, sweeps: list[Sweep]) -> Iterator[Row]:
    for sweep in sweeps:
        for i, j, case in _angles(rig, sweep):
            for k, off in enumerate(sweep.deviation):
                yield {
                    **case,
                    "deviation_rad": float(off),
                    "force_error_N": float(sweep.force[i, j, k]),
                    "torque_error_Nm": float(sweep.torque[i, j, k]),
                }


def _worth(rig: Rig, worth: Stakes) -> Iterator[Row]:
    for name, found in worth.items():
        for stake in found:
            for i, j, case in _angles(rig, stake):
                yield {
                    "calibration": name,
                    **case,
                    "from_nominal_rad": float(stake.off[i, j]),
                    "std_rad": float(stake.std[i, j]),
                    "force_N": float(stake.force[i, j]),
                    "torque_Nm": float(stake.torque[i, j]),
                }


def drawings(rig: Rig, sweeps: list[Sweep], worth: Stakes) -> tuple[Drawing, ...]:
    """Fig. 4: force and torque error against each angle of each sensor."""
    del worth
    return tuple(_drawing(rig.supports, sweep) for sweep in sweeps)


def _drawing(supports: tuple[str, ...], sweep: Sweep) -> Drawing:
    i, j, _ = np.unravel_index(int(sweep.force.argmax()), sweep.force.shape)
    name = "sensitivity-tilted" if np.any(sweep.rpy) else "sensitivity-aligned"
    return Drawing(
        name + ("-squeezed" if sweep.internal > 0.0 else ""),
        f"What a wrong angle costs, {_case(sweep)}",
        f"{ANGLES[j]} of {supports[i]} costs most, {sweep.force.max():.3g} N at "
        f"{sweep.deviation[-1]:g} rad.",
        partial(_paint, supports, sweep),
    )


def _paint(supports: tuple[str, ...], sweep: Sweep) -> Figure:
    n = len(supports)
    columns = min(n, _PER_ROW)
    bands = -(-n // columns)
    fig = figure(0.5 + 3.9 * bands)
    grid = fig.subplots(2 * bands, columns, sharex=True, squeeze=False)
    for i in range(bands * columns):
        band, column = divmod(i, columns)
        if i >= n:
            grid[2 * band, column].set_axis_off()
            grid[2 * band + 1, column].set_axis_off()
            continue
        for q, (values, label) in enumerate(
            ((sweep.force, "force error, N"), (sweep.torque, "torque error, N·m"))
        ):
            ax = grid[2 * band + q, column]
            for j, (colour, line, marker) in enumerate(_LINES):
                # Curves that coincide still show their markers.
                ax.plot(
                    1e3 * sweep.deviation, values[i, j], color=colour, linestyle=line,
                    marker=marker, markersize=3.5, markevery=(3 * j, 12), label=ANGLES[j],
                )  # fmt: skip
            top = max(float(values.max()), 1e-9)
            ax.set_ylim(-0.03 * top, 1.05 * top)
            ax.set_xlabel("angle off, mrad")
            ax.tick_params(labelbottom=True)
            if column == 0:
                ax.set_ylabel(label)
            if q == 0:
                ax.set_title(supports[i])
    fig.legend(
        *grid[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3,
        title=f"terminal {_case(sweep, '; ')}", alignment="left",
    )  # fmt: skip
    return fig
