"""A planned motion in words and numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdfscal.planning.moving_plan import MovingPlan
from tdfscal.records import ANGLES
from tdfscal.reporting.layout import Report, Section, Table


def moving_plan_report(plan: MovingPlan) -> Report:
    """Lay out what is driven, and what to expect of it."""
    request, limits = plan.request, plan.request.limits
    angles = tuple(
        (name, *(f"{1e3 * v:.3f}" for v in row))
        for name, row in zip(plan.rig.supports, plan.expected.rpy_std, strict=True)
    )
    used = extremes(plan)
    mean, random = (1e3 * f.rpy_std.mean() for f in (plan.expected, plan.random))
    way = ", ".join(f"±{v:.3f}" for v in used["travel"])
    blocks = (
        Table(
            "Standard uncertainty to expect of the installation angles, mrad",
            ("sensor", *ANGLES),
            angles,
        ),
        f"Mean {mean:.3g} mrad; random motions within the same limits {random:.3g} mrad: the plan "
        f"is {plan.improvement:.2f} times better.",
        f"Used of the limits: lean {np.rad2deg(used['tilt']):.2f}°, speed of a hinge "
        f"{1e3 * used['speed']:.1f} mm/s, way of a hinge {way} m along x, y, z, internal force "
        f"{used['squeeze']:.0f} N, force in all {used['force']:.0f} N.",
    )
    return Report(
        title=f"Motion for {plan.rig.name}: {request.duration:g} s without a stop",
        subtitle=f"tilt up to {np.rad2deg(limits.tilt):g}°, speed up to "
        f"{1e3 * request.speed:g} mm/s, squeeze up to {limits.squeeze:g} N, noise of "
        f"{request.noise:g} N in a force's mean over a second",
        sections=(Section("What to expect", blocks),),
    )


def extremes(plan: MovingPlan) -> dict[str, Any]:
    """What the motion uses of its limits: rad, m/s, m per axis, N."""
    time = plan.time
    course = plan.trajectory.at(time)
    home = plan.request.limits.home + plan.rig.hinge
    speed = np.linalg.norm(np.diff(course.place, axis=0), axis=2).max() / (time[1] - time[0])
    return {
        "tilt": float(np.arccos(np.clip(course.rotation[:, 2, 2], -1, 1)).max()),
        "speed": float(speed),
        "travel": np.abs(course.place - home).max(axis=(0, 1)).tolist(),
        "squeeze": float(np.linalg.norm(course.squeeze, axis=2).max()),
        "force": float(np.linalg.norm(course.carried + course.squeeze, axis=2).max()),
    }


def moving_plan_document(
    plan: MovingPlan, path: str | None, waypoints: str | None, seed: int
) -> dict[str, Any]:
    """The same as plain JSON values, SI units."""
    request, limits = plan.request, plan.request.limits
    lines = plan.trajectory.lines
    course = plan.trajectory.at(plan.waypoints)
    return {
        "format": "tdfscal-plan/1",
        "rig": plan.rig.name,
        "output": path,
        "waypoints_output": waypoints,
        "seed": seed,
        "duration": request.duration,
        "noise": request.noise,
        "limits": {
            "tilt": limits.tilt,
            "speed": request.speed,
            "squeeze": limits.squeeze,
            "force": limits.force if np.isfinite(limits.force) else None,
            "stiffness": limits.stiffness,
        },
        "used": extremes(plan),
        "expected": _expected(plan, plan.expected.rpy_std),
        "random": _expected(plan, plan.random.rpy_std),
        "improvement": plan.improvement,
        "frequency": (lines.line / request.duration).tolist(),
        "waypoints": {
            "time": plan.waypoints.tolist(),
            "position": plan.position(course).tolist(),
            "squeeze": course.squeeze.tolist(),
        },
    }


def _expected(plan: MovingPlan, std: Any) -> dict[str, Any]:
    return {
        "mean_std": float(std.mean()),
        "supports": [
            {"name": name, "rpy_std": row}
            for name, row in zip(plan.rig.supports, std.tolist(), strict=True)
        ],
    }
