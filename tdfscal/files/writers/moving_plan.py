"""A planned motion as CSV: a time table for a controller, and waypoints for a spline."""

from __future__ import annotations

import numpy as np

from tdfscal.files.escaping import csv_comment
from tdfscal.files.writers.plan import AXES, number
from tdfscal.planning.moving_plan import MovingPlan
from tdfscal.records import FloatArray


def time_table_csv(plan: MovingPlan, command: str, seed: int) -> str:
    """One row per tenth of a second: hinge centres in m, squeezes in N, BCS."""
    return _table(plan, plan.time, _notes(plan, "time table", command, seed))


def waypoints_csv(plan: MovingPlan, command: str, seed: int) -> str:
    """As few rows as a cubic spline needs, which is at rest at both ends."""
    notes = _notes(plan, "waypoints", command, seed)
    spline = "Between the rows runs a cubic spline through all of them, with no speed at both ends."
    return _table(plan, plan.waypoints, [*notes, spline])


def _table(plan: MovingPlan, time: FloatArray, notes: list[str]) -> str:
    names = plan.rig.supports
    course = plan.trajectory.at(time)
    displacement = plan.displacement(course)
    columns = [plan.position(course), course.squeeze]
    header = ["t", *(f"{name}.{axis}" for name in names for axis in AXES)]
    header += [f"{name}.squeeze_{axis}" for name in names for axis in AXES]
    digits = [9, 4]
    if displacement is not None:
        header += [f"{name}.d{axis}" for name in names for axis in AXES]
        columns.append(displacement)
        digits.append(9)
    lines = [f"# {line}".rstrip() for line in notes]
    lines.append(",".join(header))
    for k, t in enumerate(time):
        row = [number(t, 6)]
        for values, places in zip(columns, digits, strict=True):
            row += [number(v, places) for v in np.ravel(values[k])]
        lines.append(",".join(row))
    return "\n".join(lines) + "\n"


def _notes(plan: MovingPlan, what: str, command: str, seed: int) -> list[str]:
    request, limits = plan.request, plan.request.limits
    home = ", ".join(f"{v:g}" for v in limits.home)
    squeezes = (
        [
            ".squeeze_x _y _z: internal force on the terminal to servo to, N, on top of the share",
            "of the weight; the positions are those of the undeformed terminal.",
        ]
        if limits.stiffness is None
        else [
            ".squeeze_x _y _z: internal force on the terminal, N, that the displacement .dx .dy",
            f".dz, m, makes with {limits.stiffness:g} N/m; the positions contain it already.",
        ]
    )
    mean = 1e3 * plan.expected.rpy_std.mean()
    return [
        f"tdfscal plan for {csv_comment(plan.rig.name)}: {what} of a motion",
        f"command: {csv_comment(command)} (seed {seed})",
        f"t: s, from rest to rest in {request.duration:g} s.",
        "frame: BCS. .x .y .z: hinge centre (SHC) to command to the NCP's servo, m.",
        f"The terminal's LCS origin stands at ({home}) m at home, level, at the start and the end.",
        *squeezes,
        "Move without contact, and record all of it.",
        f"expected: mean standard uncertainty of an angle {mean:.3g} mrad, with a noise of "
        f"{request.noise:g} N in a force's mean over a second",
        *(
            f"expected {name}: "
            + ", ".join(
                f"{angle} {1e3 * std:.3g}"
                for angle, std in zip(("roll", "pitch", "yaw"), row, strict=True)
            )
            + " mrad"
            for name, row in zip(plan.rig.supports, plan.expected.rpy_std, strict=True)
        ),
    ]
