"""What a wrong angle costs at the contact (Sect. 2.3, Fig. 4), and what a calibration is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from studies.frame import Cell, Study, Table
from tdfscal.commands.result import Calibration
from tdfscal.numerics import so3
from tdfscal.records import ANGLES, FloatArray, Rig
from tdfscal.reporting.figures import style
from tdfscal.reporting.figures.style import figure, legend_outside
from tdfscal.reporting.layout import Drawing

#: rad, "generally not exceeding 0.05 rad" (Sect. 2.3); N, standard deviation of internal forces.
SPAN, SQUEEZE = 0.05, 200.0
_POINTS = 101
_LINES = ((style.BLACK, "-", "o"), (style.ORANGE, "--", "s"), (style.BLUE, ":", "^"))


@dataclass(frozen=True, slots=True)
class Sweep:
    """Error of the contact wrench against each angle of each sensor, the terminal aligned.

    internal : N, standard deviation of the internal forces per orthonormal mode. off : (D,), rad,
    from the nominal mounting. force, torque : (n, 3, D), N and N·m about the LCS origin, lengths of
    ΔF_e[:3] and ΔF_e[3:]; with internal forces their quadratic mean. printed : the torque by the
    moment rows as Eq. 11 and 15 print them.
    """

    internal: float
    off: FloatArray
    force: FloatArray
    torque: FloatArray
    printed: FloatArray


def jacobian(rig: Rig, R: FloatArray, X: FloatArray, *, printed: bool = False) -> FloatArray:
    """J (..., 6, 3n) of Eq. 11: rows Rᵀ X_i and r̂_i Rᵀ X_i, or Rᵀ X_i r̂_i as it is printed.

    X : (..., n, 3, 3).
    """
    force, arm = R.T @ X, so3.hat(rig.hinge)
    blocks = np.concatenate([force, force @ arm if printed else arm @ force], axis=-2)
    blocks = np.moveaxis(blocks, -3, -2)  # (..., 6, n, 3)
    return np.asarray(blocks.reshape(*blocks.shape[:-2], 3 * rig.n))


def wrench_error(
    rig: Rig,
    assumed: FloatArray,
    true: FloatArray,
    internal: float = 0.0,
    *,
    printed: bool = False,
) -> FloatArray:
    """Error (..., 2) of contact force, N, and torque, N·m, of the aligned terminal.

    The sensors' forces balance the weight over the true mounting J′, the controller assumes J:
    F = −J′ᵀ(J′J′ᵀ)⁻¹ R_g G + U c and ΔF_e = (J − J′) F (Eq. 16–19), U the null space of J′ and
    c ~ N(0, internal²), whose mean square is summed in closed form.

    assumed, true : (..., n, 3, 3), mountings that broadcast.
    """
    R = np.eye(3)
    J, J_true = np.broadcast_arrays(
        jacobian(rig, R, assumed, printed=printed), jacobian(rig, R, true, printed=printed)
    )
    down = np.array([0.0, 0.0, -float(rig.mass.value) * rig.gravity])
    load = np.concatenate([down, np.cross(rig.barycentre.value, down)])  # R_g G
    across = np.swapaxes(J_true, -1, -2)
    each = np.broadcast_to(load, J_true.shape[:-1])[..., None]
    F = -across @ np.linalg.solve(J_true @ across, each)
    U = np.swapaxes(np.linalg.svd(J_true, full_matrices=True)[2][..., 6:, :], -1, -2)
    error, spread = ((J - J_true) @ forces for forces in (F, U))
    square = error[..., 0] ** 2 + internal**2 * np.sum(spread**2, axis=-1)
    size = np.sqrt(square.reshape(*square.shape[:-1], 2, 3).sum(axis=-1))
    return np.where(size > 1e-9, size, 0.0)  # of thousands of newtons: rounding


def sweep(rig: Rig, internal: float = 0.0, span: float = SPAN, points: int = _POINTS) -> Sweep:
    """Sweep roll, pitch and yaw of one sensor after the other by ±span about the nominal ones."""
    off = np.linspace(-span, span, points)
    angles = np.broadcast_to(rig.nominal_rpy, (rig.n, 3, points, rig.n, 3)).copy()
    for i in range(rig.n):
        for j in range(3):
            angles[i, j, :, i, j] += off
    nominal, true = so3.from_rpy(rig.nominal_rpy), so3.from_rpy(angles)
    error = wrench_error(rig, nominal, true, internal)
    printed = wrench_error(rig, nominal, true, internal, printed=True)
    return Sweep(internal, off, error[..., 0], error[..., 1], printed[..., 1])


def worth(rig: Rig, calibration: Calibration, internal: float = 0.0) -> tuple[FloatArray, ...]:
    """Contact wrench error (2,) with the nominal mounting where the calibrated one is true, and
    the standard uncertainty (2,) that the calibrated one leaves, N and N·m.
    """
    X, cov = calibration.rotation, calibration.rotation_covariance
    values, vectors = np.linalg.eigh(cov)
    steps = (vectors * np.sqrt(np.maximum(values, 0.0))).T.reshape(-1, rig.n, 3)
    before = wrench_error(rig, so3.from_rpy(rig.nominal_rpy), X, internal)
    each = wrench_error(rig, so3.exp(steps) @ X, X, internal)
    return before, np.sqrt(np.sum(each**2, axis=0))


def run(rig: Rig, given: Sequence[tuple[str, Calibration]] = ()) -> Study:
    """Fig. 4 of this rig, and what given calibrations leave of it."""
    sweeps = [sweep(rig), sweep(rig, SQUEEZE)]
    still = sweeps[0]
    rows: list[tuple[Cell, ...]] = [
        (name, ANGLES[j], *(float(v[i, j, -1]) for s in sweeps for v in (s.force, s.torque)),
         float(still.printed[i, j, -1]))
        for i, name in enumerate(rig.supports)
        for j in range(3)
    ]  # fmt: skip
    shown = Table(
        "fig-4",
        f"Contact wrench error of one angle that is {SPAN:g} rad off, terminal aligned",
        ("sensor", "angle", "force, N", "torque, N·m", f"force at {SQUEEZE:g} N, N",
         f"torque at {SQUEEZE:g} N, N·m", "torque by Eq. 11 as printed, N·m"),
        tuple(rows),
        left=2,
    )  # fmt: skip
    tables = [shown]
    if given:
        left: list[tuple[Cell, ...]] = []
        for name, calibration in given:
            for s in sweeps:
                before, after = worth(rig, calibration, s.internal)
                left.append((name, s.internal, *map(float, before), *map(float, after)))
        head = ("calibration", "internal force, N", "nominal angles: force, N", "torque, N·m",
                "calibrated: force (std), N", "torque (std), N·m")  # fmt: skip
        tables.append(Table("calibrations", "What given calibrations leave", head, tuple(left)))
    weight = float(rig.mass.value) * rig.gravity
    worst, yaw = float(still.force.max()), float(still.printed[:, 2, -1].max())
    return Study(
        "sensitivity",
        f"What a wrong angle costs: {rig.name}",
        f"one angle of one sensor swept by ±{SPAN:g} rad; smallest forces that carry the weight, "
        f"and internal forces of {SQUEEZE:g} N beside them",
        tuple(tables),
        chosen=(
            ("force at 0.05 rad", f"{worst:.4g} N (Fig. 4: above 80 N)",
             f"goes with the weight, {weight:.4g} N here; Table 1 is empty in the text at hand"),
        ),
        notes=(
            f"Torque of a yaw that is {SPAN:g} rad off: {yaw:.3g} N·m by the moment rows that "
            f"Eq. 11 and 15 print, Rᵀ X r̂, and {float(still.torque[:, 2, -1].max()):.2g} N·m by "
            "r̂ Rᵀ X, which Eq. 4 demands.",
        ),
        drawings=tuple(_drawing(rig.supports, s) for s in sweeps),
    )  # fmt: skip


def _drawing(supports: tuple[str, ...], s: Sweep) -> Drawing:
    i, j, _ = np.unravel_index(int(s.force.argmax()), s.force.shape)
    at = f"internal forces of {s.internal:g} N" if s.internal else "smallest forces"
    return Drawing(
        "fig-4-squeezed" if s.internal else "fig-4",
        f"What a wrong angle costs, {at}",
        f"{ANGLES[j].capitalize()} of {supports[i]} costs most, {s.force.max():.3g} N "
        f"at {s.off[-1]:g} rad.",
        partial(_paint, supports, s),
    )


def _paint(supports: tuple[str, ...], s: Sweep) -> Figure:
    n, both = len(supports), ((s.force, "force error, N"), (s.torque, "torque error, N·m"))
    fig = figure(0.5 + 2.0 * n)
    grid = fig.subplots(n, 2, sharex=True, sharey="col", squeeze=False)
    for i, name in enumerate(supports):
        for ax, (values, label) in zip(grid[i], both, strict=True):
            for j, (colour, line, marker) in enumerate(_LINES):
                # Curves that coincide still show their markers.
                ax.plot(
                    1e3 * s.off, values[i, j], color=colour, linestyle=line, marker=marker,
                    markersize=3.5, markevery=(3 * j, 12), label=ANGLES[j],
                )  # fmt: skip
            ax.set_ylabel(label)
            ax.set_title(name)
        for ax in grid[-1]:
            ax.set_xlabel("angle off, mrad")
    legend_outside(fig, grid[0, 0])
    return fig
