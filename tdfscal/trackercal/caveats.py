"""What a survey's numbers cannot vouch for, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import FAR_FROM_NOMINAL
from tdfscal.trackercal.judged_registration import SurveyFit
from tdfscal.trackercal.point_matching import relabellings
from tdfscal.trackercal.positioner_axes import AxisTest
from tdfscal.trackercal.variance_components import Components


def survey_warnings(
    rig: Rig,
    X: FloatArray,
    moves: SurveyFit,
    targets: Sequence[SurveyFit],
    axes: Sequence[AxisTest],
    components: Components,
) -> tuple[str, ...]:
    """Sentences for the calibration's warnings; X (n, 3, 3) sensor → BCS."""
    lines = [
        f"{name} is left out: {reason}"
        for s in (moves, *targets)
        for name, reason in ((r.name, r.reason) for r in s.rejected)
    ]
    lines += [f"{text}; the result is weighted by it" for text in components.understated]
    lines += [str(fault) for test in axes for fault in test.faults]
    lines += _unchecked_targets(rig.supports, targets)
    for name, turn, std in zip(
        rig.supports,
        so3.log(X @ np.swapaxes(so3.from_rpy(rig.nominal_rpy), 1, 2)),
        rig.rpy_std,
        strict=True,
    ):
        if np.all(np.isfinite(std)) and np.linalg.norm(turn) > FAR_FROM_NOMINAL * np.linalg.norm(
            std
        ):
            lines.append(
                f"{name} is turned by {np.linalg.norm(turn):.3g} rad from its nominal mounting, "
                "far more than its rpy_std allows: check the names of its targets"
            )
    lines += _swapped_supports(rig, moves, targets)
    if any(
        "file" in name
        for s in (moves, *targets)
        for name in (*s.noise.measured, *s.noise.reference)
    ):
        lines.append(
            "uncertainties that the point files state stand in place of the instrument's, the "
            "drawing's and the positioners'"
        )
    return tuple(lines)


def _unchecked_targets(supports: Sequence[str], targets: Sequence[SurveyFit]) -> list[str]:
    lines = []
    flat = [name for name, t in zip(supports, targets, strict=True) if not t.fit.handed]
    if flat:
        lines.append(
            f"the targets of {', '.join(flat)} lie in one plane within their uncertainty: a "
            "mirrored frame would not be noticed"
        )
    symmetric = {}
    for name, t in zip(supports, targets, strict=True):
        others = relabellings(t.points.measured, t.points.reference, t.sigma)
        if others:
            symmetric[name] = "-".join(t.points.point[k] for k in others[0])
    if symmetric:
        lines.append(
            f"the targets of {', '.join(symmetric)} are symmetric: as "
            f"{next(iter(symmetric.values()))} they would fit too, so their distances do not check "
            "their names"
        )
    return lines


def _swapped_supports(rig: Rig, moves: SurveyFit, targets: Sequence[SurveyFit]) -> list[str]:
    """Targets sit beside the point that their NCP carries; swapped supports lie far from it."""
    places = [
        moves.points.measured[moves.group == moves.groups.index(name)].mean(axis=0)
        if name in moves.groups
        else None
        for name in rig.supports
    ]
    if any(place is None for place in places):
        return []
    centres = np.stack([t.points.measured.mean(axis=0) for t in targets])
    gap = np.linalg.norm(centres[:, None] - np.stack([p for p in places if p is not None]), axis=-1)
    nearest = gap.argmin(axis=1)
    return [
        f"the targets of {name} lie nearest to the moves of {rig.supports[k]}: check the group "
        "names"
        for i, (name, k) in enumerate(zip(rig.supports, nearest, strict=True))
        if k != i and gap[i, i] > 2 * gap[i, k]
    ]
