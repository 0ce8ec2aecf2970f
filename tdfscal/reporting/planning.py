"""A plan, of postures or of a motion, in words and numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdfscal.planning.moving_plan import MovingPlan
from tdfscal.planning.plan import Plan, contact_conforms, contact_expanded
from tdfscal.planning.predicted_information import Forecast
from tdfscal.records import ANGLES, FloatArray, Rig
from tdfscal.reporting.layout import Block, Report, Section, Table


def plan_report(plan: Plan) -> Report:
    """Lay out what to drive, and what to expect of it."""
    limits, request, expected = plan.request.limits, plan.request, plan.expected
    blocks: list[Block] = [_angles(plan.rig, expected.rpy_std)]
    if expected.contact_force is not None and expected.contact_torque is not None:
        at = ", ".join(f"{v:g}" for v in request.at or plan.rig.acceptance.contact_rpy)
        force, torque = (
            tuple(f"{v:.3f}" for v in std)
            for std in (expected.contact_force, expected.contact_torque)
        )
        caption = f"… and of the contact wrench at roll, pitch, yaw {at} rad"
        rows = (("force, N", *force), ("torque, N·m", *torque))
        blocks.append(Table(caption, ("", "x", "y", "z"), rows))
        if plan.rig.acceptance.states_contact:
            blocks.append(_contact(plan))
    before = "" if plan.before is None else f"; before the plan {1e3 * plan.before.mean:.3g} mrad"
    what = "contact wrench" if request.objective == "wrench" else "angles"
    reach = np.max(np.abs(plan.position - plan.position.mean(axis=0)), axis=(0, 1))
    blocks.append(
        f"Mean {1e3 * expected.mean:.3g} mrad; {len(plan)} random postures within the same limits "
        f"{1e3 * plan.random.mean:.3g} mrad{before}; for the {what} the plan is "
        f"{plan.improvement:.2f} times better. Travel used about the middle: ±{reach[0]:.3f}, "
        f"±{reach[1]:.3f}, ±{reach[2]:.3f} m along x, y, z; way of the slowest axis "
        f"{plan.tour:.2f} m."
    )
    more = f", on top of {plan.given} postures recorded before" if plan.given else ""
    again = {0: "never", 1: "once"}.get(len(plan.returns), f"{len(plan.returns)} times")
    return Report(
        title=f"Plan for {plan.rig.name}: {len(plan)} postures{more}",
        subtitle=f"{again} the first again, tilt up to {np.rad2deg(limits.tilt):g}°, squeeze up to "
        f"{limits.squeeze:g} N, {request.noise:g} N noise per axis and posture",
        sections=(Section("What to expect", tuple(blocks)),),
    )


def _contact(plan: Plan) -> str:
    """What the plan makes of the limits of the contact wrench."""
    stated, expanded = plan.rig.acceptance, contact_expanded(plan.expected)
    parts = [
        f"{name} {size:.3g} {unit} of {limit:g}"
        for name, unit, size, limit in zip(
            ("force", "torque"), ("N", "N·m"), expanded or (),
            (stated.contact_force, stated.contact_torque), strict=True,
        )
        if limit is not None
    ]  # fmt: skip
    enough = contact_conforms(plan.rig, plan.expected)
    end = "enough" if enough else "not enough: squeeze harder, or tare and weigh better"
    return f"Contact wrench, expanded uncertainty against its limit: {', '.join(parts)}: {end}."


def _angles(rig: Rig, std: FloatArray) -> Table:
    rows = tuple(
        (name, *("–" if np.isnan(v) else f"{1e3 * v:.3f}" for v in row))
        for name, row in zip(rig.supports, std, strict=True)
    )
    caption = "Standard uncertainty to expect of the installation angles, mrad"
    return Table(caption, ("sensor", *ANGLES), rows)


def plan_document(plan: Plan, path: str | None) -> dict[str, Any]:
    """The same as plain JSON values, SI units."""
    return {
        **_document(plan, path),
        "postures": len(plan),
        "returns": [int(k) + 1 for k in plan.returns],
        "given": plan.given,
        "objective": plan.request.objective,
        "before": None if plan.before is None else _forecast(plan.rig, plan.before),
        "tour": plan.tour,
        "position": plan.position.tolist(),
        "squeeze": plan.postures.squeeze.tolist(),
        "approach": plan.approach.tolist(),
    }


def _document(plan: Plan | MovingPlan, path: str | None) -> dict[str, Any]:
    """What plans of postures and of a motion have in common."""
    limits = plan.request.limits
    return {
        "format": "tdfscal-plan/1",
        "rig": plan.rig.name,
        "output": path,
        "noise": plan.request.noise,
        "limits": {
            "tilt": limits.tilt,
            "squeeze": limits.squeeze,
            "force": limits.force if np.isfinite(limits.force) else None,
            "stiffness": limits.stiffness,
        },
        "expected": _forecast(plan.rig, plan.expected),
        "random": _forecast(plan.rig, plan.random),
        "improvement": plan.improvement,
    }


def _forecast(rig: Rig, of: Forecast) -> dict[str, Any]:
    document: dict[str, Any] = {
        "mean_std": of.mean,
        "supports": [
            {"name": name, "rpy_std": [None if np.isnan(v) else v for v in row]}
            for name, row in zip(rig.supports, of.rpy_std.tolist(), strict=True)
        ],
    }
    if of.contact_force is not None and of.contact_torque is not None:
        document["contact"] = {
            "force_std": of.contact_force.tolist(),
            "torque_std": of.contact_torque.tolist(),
        }
    return document


def moving_plan_report(plan: MovingPlan) -> Report:
    """Lay out what is driven, and what to expect of it."""
    request, limits = plan.request, plan.request.limits
    used = extremes(plan)
    mean, random = (1e3 * f.mean for f in (plan.expected, plan.random))
    way = ", ".join(f"±{v:.3f}" for v in used["travel"])
    blocks = (
        _angles(plan.rig, plan.expected.rpy_std),
        f"Mean {mean:.3g} mrad; random ones within the same limits {random:.3g} mrad: the plan "
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
        "force": float(np.linalg.norm(course.force, axis=2).max()),
    }


def moving_plan_document(
    plan: MovingPlan, path: str | None, waypoints: str | None
) -> dict[str, Any]:
    """The same as plain JSON values, SI units."""
    request, course = plan.request, plan.trajectory.at(plan.waypoints)
    document = _document(plan, path)
    document["limits"]["speed"] = request.speed
    return document | {
        "waypoints_output": waypoints,
        "duration": request.duration,
        "used": extremes(plan),
        "frequency": (plan.trajectory.lines.line / request.duration).tolist(),
        "waypoints": {
            "time": plan.waypoints.tolist(),
            "position": course.position(request.limits).tolist(),
            "squeeze": course.squeeze.tolist(),
        },
    }
