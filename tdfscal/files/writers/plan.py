"""A plan as a CSV that a machine can run."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tdfscal.files.escaping import csv_comment
from tdfscal.files.saving import write_text
from tdfscal.planning import Plan
from tdfscal.records import ANGLES

AXES = ("x", "y", "z")
#: How far beyond a posture its approach starts, m: more than any backlash.
OVERSHOOT = 1.0e-3


def save_plan(plan: Plan, path: Path, command: str, seed: int) -> None:
    """Write a plan, whole or not at all. Raises UsageError where that is not possible."""
    write_text(path, plan_csv(plan, command, seed))


def plan_csv(plan: Plan, command: str, seed: int) -> str:
    """One row per posture in the order to drive: hinge centres in m, squeezes in N, BCS."""
    names = plan.rig.supports
    groups = [""] if plan.displacement is None else ["", ".d"]
    header = ["posture", "approach", "returns"]
    header += [f"{name}.{axis}" for name in names for axis in AXES]
    header += [f"{name}.squeeze_{axis}" for name in names for axis in AXES]
    if len(groups) > 1:
        header += [f"{name}.d{axis}" for name in names for axis in AXES]
    lines = [f"# {line}".rstrip() for line in _notes(plan, command, seed)]
    lines.append(",".join(header))
    returns = set(plan.returns.tolist())
    for k in range(len(plan)):
        row = [str(k + 1), f"{plan.approach[k]:+d}", "1" if k in returns else ""]
        row += [number(v, 9) for v in np.ravel(plan.position[k])]
        row += [number(v, 4) for v in np.ravel(plan.postures.squeeze[k])]
        if plan.displacement is not None:
            row += [number(v, 9) for v in np.ravel(plan.displacement[k])]
        lines.append(",".join(row))
    return "\n".join(lines) + "\n"


def number(value: float, digits: int) -> str:
    """Return a number with so many digits after the point."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"  # never −0.000


def _notes(plan: Plan, command: str, seed: int) -> list[str]:
    limits, rig = plan.request.limits, plan.rig
    mean = 1e3 * plan.expected.mean
    home = ", ".join(f"{v:g}" for v in limits.home)
    lines = [
        f"tdfscal plan for {csv_comment(rig.name)}",
        f"command: {csv_comment(command)} (seed {seed})",
        "frame: BCS. .x .y .z: hinge centre (SHC) to command to the NCP's servo, m.",
        f"The terminal's LCS origin stands at ({home}) m at home, level.",
    ]
    if plan.displacement is None:
        lines += [
            ".squeeze_x _y _z: internal force on the terminal to servo to, N, on top of the share",
            "of the weight; the positions are those of the undeformed terminal.",
        ]
    else:
        lines += [
            ".squeeze_x _y _z: internal force on the terminal, N, that the displacement .dx .dy",
            f".dz, m, makes with {limits.stiffness:g} N/m; the positions contain it already.",
        ]
    lines += [
        f"approach: side to come from. First drive every NCP to x, y and z {1e3 * OVERSHOOT:g} mm",
        "further to that side (+1: larger coordinates), all alike, then into the posture.",
        "returns: 1 where the first posture comes again, to show drift.",
        "Rest at each posture, without contact, until the forces have settled, then record.",
        f"expected: mean standard uncertainty of an angle {mean:.3g} mrad, with "
        f"{plan.request.noise:g} N per axis and posture",
        *(
            f"expected {name}: "
            + (
                "undetermined, as it lacks axes"
                if np.isnan(row).any()
                else ", ".join(
                    f"{angle} {1e3 * std:.3g}" for angle, std in zip(ANGLES, row, strict=True)
                )
                + " mrad"
            )
            for name, row in zip(rig.supports, plan.expected.rpy_std, strict=True)
        ),
    ]
    return lines
