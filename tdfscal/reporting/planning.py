"""A plan in words and numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdfscal.planning import Forecast, Plan
from tdfscal.records import ANGLES
from tdfscal.reporting.layout import Block, Report, Section, Table


def plan_report(plan: Plan) -> Report:
    """Lay out what to drive, and what to expect of it."""
    limits, request, expected = plan.request.limits, plan.request, plan.expected
    more = f", on top of {plan.given} postures recorded before" if plan.given else ""
    angles = tuple(
        (name, *("–" if np.isnan(v) else f"{1e3 * v:.3f}" for v in row))
        for name, row in zip(plan.rig.supports, expected.rpy_std, strict=True)
    )
    blocks: list[Block] = [
        Table(
            "Standard uncertainty to expect of the installation angles, mrad",
            ("sensor", *ANGLES),
            angles,
        )
    ]
    if expected.contact_force is not None and expected.contact_torque is not None:
        at = ", ".join(f"{v:g}" for v in request.at or plan.rig.acceptance.contact_rpy)
        rows = tuple(
            (name, *(f"{v:.3f}" for v in values))
            for name, values in (
                ("force, N", expected.contact_force),
                ("torque, N·m", expected.contact_torque),
            )
        )
        caption = f"… and of the contact wrench at roll, pitch, yaw {at} rad"
        blocks.append(Table(caption, ("", "x", "y", "z"), rows))
    reach = np.max(np.abs(plan.position - plan.position.mean(axis=0)), axis=(0, 1))
    blocks.append(
        f"{_comparison(plan)}. Travel used about the middle: ±{reach[0]:.3f}, ±{reach[1]:.3f}, "
        f"±{reach[2]:.3f} m along x, y, z; way of the slowest axis {plan.tour:.2f} m."
    )
    return Report(
        title=f"Plan for {plan.rig.name}: {len(plan)} postures{more}",
        subtitle=f"{_times(len(plan.returns))} the first again, tilt up to "
        f"{np.rad2deg(limits.tilt):g}°, squeeze up to {limits.squeeze:g} N, {request.noise:g} N "
        "noise per axis and posture",
        sections=(Section("What to expect", tuple(blocks)),),
    )


def _times(count: int) -> str:
    return "never" if count == 0 else "once" if count == 1 else f"{count} times"


def _comparison(plan: Plan) -> str:
    mean, random = (1e3 * f.mean for f in (plan.expected, plan.random))
    text = (
        f"Mean {mean:.3g} mrad; {len(plan)} random postures within the same limits "
        f"{random:.3g} mrad"
    )
    if plan.before is not None:
        text += f"; before the plan {1e3 * plan.before.mean:.3g} mrad"
    what = "contact wrench" if plan.request.objective == "wrench" else "angles"
    return f"{text}; for the {what} the plan is {plan.improvement:.2f} times better"


def plan_document(plan: Plan, path: str | None, seed: int) -> dict[str, Any]:
    """The same as plain JSON values, SI units."""
    limits, request = plan.request.limits, plan.request
    return {
        "format": "tdfscal-plan/1",
        "rig": plan.rig.name,
        "output": path,
        "seed": seed,
        "postures": len(plan),
        "returns": [int(k) + 1 for k in plan.returns],
        "given": plan.given,
        "objective": request.objective,
        "noise": request.noise,
        "limits": {
            "tilt": limits.tilt,
            "squeeze": limits.squeeze,
            "force": limits.force if np.isfinite(limits.force) else None,
            "stiffness": limits.stiffness,
        },
        "expected": _forecast(plan, plan.expected),
        "random": _forecast(plan, plan.random),
        "before": None if plan.before is None else _forecast(plan, plan.before),
        "improvement": plan.improvement,
        "tour": plan.tour,
        "position": plan.position.tolist(),
        "squeeze": plan.postures.squeeze.tolist(),
        "approach": plan.approach.tolist(),
    }


def _forecast(plan: Plan, of: Forecast) -> dict[str, Any]:
    document: dict[str, Any] = {
        "mean_std": of.mean,
        "supports": [
            {"name": name, "rpy_std": [None if np.isnan(v) else v for v in row]}
            for name, row in zip(plan.rig.supports, of.rpy_std.tolist(), strict=True)
        ],
    }
    if of.contact_force is not None and of.contact_torque is not None:
        document["contact"] = {
            "force_std": of.contact_force.tolist(),
            "torque_std": of.contact_torque.tolist(),
        }
    return document
