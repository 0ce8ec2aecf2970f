"""A plan as a CSV that a machine can run: postures, or a motion as a time table."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from tdfscal.catalogue.numbers import quantity
from tdfscal.errors import DataError
from tdfscal.files.outputs import protect
from tdfscal.files.saving import csv_comment
from tdfscal.frozen import record
from tdfscal.numerics import so3
from tdfscal.planning.candidates import Candidates
from tdfscal.planning.motion import MovingPlan
from tdfscal.planning.plan import Plan
from tdfscal.records import ANGLES, FloatArray

AXES = ("x", "y", "z")
#: How far beyond a posture its approach starts, m: more than any backlash.
OVERSHOOT = 1.0e-3
_TITLE = "# tdfscal plan for "


@record
class Driven:
    """The rows of a plan.

    time : (K,), s, of a motion; the number of the row where they are postures. averaged : they are.
    position : (K, n, 3), m, BCS. squeeze : (K, n, 3), N, BCS.
    """

    supports: tuple[str, ...]
    time: FloatArray
    averaged: bool
    position: FloatArray
    squeeze: FloatArray


def read_plan(path: Path) -> Driven | None:
    """Read a plan that `plan` wrote; None where a file is none. Raises DataError, UsageError."""
    protect([path])
    if path.suffix.lower() != ".csv" or not path.is_file():
        return None
    with path.open(encoding="utf-8", errors="replace") as file:
        if not file.readline().startswith(_TITLE):
            return None
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    names = [name[:-2] for name in (rows or [[]])[0] if name.endswith(".x")]
    places, squeezes = (
        [f"{name}.{word}{axis}" for name in names for axis in AXES] for word in ("", "squeeze_")
    )
    try:
        columns = {name: [float(row[k] or 0) for row in rows[1:]] for k, name in enumerate(rows[0])}
        position, squeeze = (
            np.array([columns[name] for name in group]).T.reshape(-1, len(names), 3)
            for group in (places, squeezes)
        )
    except (IndexError, KeyError, ValueError) as error:
        raise DataError(
            "the plan is not as it was written", where=str(path), hint="make it anew by plan"
        ) from error
    if not len(position):
        raise DataError("the plan has no rows", where=str(path), hint="make it anew by plan")
    time = np.array(columns.get("t", range(len(position))), dtype=np.float64)
    return Driven(tuple(names), time, "t" not in columns, position, squeeze)


def plan_csv(plan: Plan, command: str) -> str:
    """One row per posture in the order to drive: hinge centres in m, squeezes in N, BCS."""
    how = [
        f"approach: side to come from. First drive every NCP to x, y and z {1e3 * OVERSHOOT:g} mm",
        "further to that side (+1: larger coordinates), all alike, then into the posture.",
        "Rest at each posture, without contact, until the forces have settled, then record.",
    ]
    noise = f"{plan.request.noise:g} N per axis and posture"
    rows = ([str(k + 1), f"{side:+d}"] for k, side in enumerate(plan.approach))
    notes = _notes(plan, "", command, how, noise)
    return _table(plan, notes, ["posture", "approach"], rows, plan.postures)


def time_table_csv(plan: MovingPlan, command: str) -> str:
    """One row per tenth of a second: hinge centres in m, squeezes in N, BCS."""
    how = [
        f"t: s, from rest to rest in {plan.request.duration:g} s; at home at both ends.",
        "Move without contact, and record all of it.",
    ]
    noise = f"a noise of {plan.request.noise:g} N in a force's mean over a second"
    notes = _notes(plan, ": time table of a motion", command, how, noise)
    rows = ([number(t, 6)] for t in plan.time)
    return _table(plan, notes, ["t"], rows, plan.motion.at(plan.time))


def number(value: float, digits: int) -> str:
    """Return a number with so many digits after the point."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"  # never −0.000


def _table(
    plan: Plan | MovingPlan,
    notes: Sequence[str],
    keys: Sequence[str],
    rows: Iterable[list[str]],
    driven: Candidates,
) -> str:
    """Notes, header and rows; what follows the keys' cells is (N, n, 3), m and N."""
    limits = plan.request.limits
    columns = [("", driven.position(limits), 9), ("squeeze_", driven.squeeze, 4)]
    if (displacement := driven.displacement(limits)) is not None:
        columns.append(("d", displacement, 9))
    sensors = plan.rig.supports
    header = [f"{s}.{word}{axis}" for word, _, _ in columns for s in sensors for axis in AXES]
    lines = [f"# {line}".rstrip() for line in notes]
    lines.append(",".join([*keys, *header]))
    for k, row in enumerate(rows):
        for _, values, digits in columns:
            row += [number(v, digits) for v in np.ravel(values[k])]
        lines.append(",".join(row))
    return "\n".join(lines) + "\n"


def _notes(
    plan: Plan | MovingPlan, what: str, command: str, how: Sequence[str], noise: str
) -> list[str]:
    """What it is, what its columns are, how to drive it, and what it is worth."""
    limits = plan.request.limits
    home = ", ".join(f"{v:.5g}" for v in limits.home)
    turn = ", ".join(f"{v:.4f}" for v in so3.to_rpy(limits.level))
    squeeze = [
        ".squeeze_x _y _z: internal force on the terminal to servo to, N, on top of the share",
        "of the weight; the positions are those of the undeformed terminal.",
    ]
    if limits.stiffness is not None:
        squeeze = [
            ".squeeze_x _y _z: internal force on the terminal, N, that the displacement .dx .dy",
            f".dz, m, makes with {quantity(limits.stiffness, 'N/m')}; the positions contain it.",
        ]
    expected = []
    for name, row in zip(plan.rig.supports, plan.expected.rpy_std, strict=True):
        angles = ", ".join(f"{a} {1e3 * std:.3g}" for a, std in zip(ANGLES, row, strict=True))
        known = not np.isnan(row).any()
        expected.append(
            f"expected {name}: {f'{angles} mrad' if known else 'undetermined, as it lacks axes'}"
        )
    return [
        f"{_TITLE[2:]}{csv_comment(plan.rig.name)}{what}",
        f"command: {csv_comment(command)}",
        "frame: BCS. .x .y .z: hinge centre (SHC) to command to the NCP's servo, m.",
        f"The terminal's LCS origin stands at ({home}) m at home, roll, pitch, yaw ({turn}) rad"
        f"{': the mean of what was recorded' if limits.recorded else ''}.",
        *squeeze,
        *how,
        f"expected: mean standard uncertainty of an angle {1e3 * plan.expected.mean:.3g} mrad, "
        f"with {noise}",
        *expected,
    ]
