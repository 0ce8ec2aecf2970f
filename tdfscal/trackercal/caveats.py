"""What a survey's numbers cannot vouch for, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import FAR_FROM_NOMINAL
from tdfscal.trackercal.judged_registration import MEASURED_FILE, REFERENCE_FILE, SurveyFit
from tdfscal.trackercal.point_matching import relabellings
from tdfscal.trackercal.positioner_axes import AxisFault
from tdfscal.trackercal.variance_components import Components


def survey_warnings(
    rig: Rig,
    X: FloatArray,
    moves: SurveyFit,
    targets: Sequence[SurveyFit],
    axes: Sequence[AxisFault],
    components: Components,
) -> tuple[str, ...]:
    """Sentences for the calibration's warnings; X (n, 3, 3) sensor → BCS."""
    surveys = (moves, *targets)
    lines = [f"{r.name} is left out: {r.reason}" for s in surveys for r in s.rejected]
    lines += [f"{text}; the result is weighted by it" for text in components.understated]
    lines += map(str, axes)
    lines += _unchecked_targets(rig.supports, targets)
    turn = so3.log(X @ np.swapaxes(so3.from_rpy(rig.nominal_rpy), 1, 2))
    far = np.linalg.norm(turn, axis=1) > FAR_FROM_NOMINAL * np.linalg.norm(rig.rpy_std, axis=1)
    lines += [
        f"{rig.supports[i]} is turned by {np.linalg.norm(turn[i]):.3g} rad from its nominal "
        "mounting, far more than its rpy_std allows: check the names of its targets"
        for i in np.flatnonzero(far)
    ]
    lines += _swapped_supports(rig, moves, targets)
    sources = {name for s in surveys for name in (*s.noise.measured, *s.noise.reference)}
    if sources & {MEASURED_FILE, REFERENCE_FILE}:
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
        others = relabellings(t.points, t.sigma)
        if others:
            symmetric[name] = "-".join(t.points.reference.point[k] for k in others[0])
    if symmetric:
        lines.append(
            f"the targets of {', '.join(symmetric)} are symmetric: as "
            f"{next(iter(symmetric.values()))} they would fit too, so their distances do not check "
            "their names"
        )
    return lines


def _swapped_supports(rig: Rig, moves: SurveyFit, targets: Sequence[SurveyFit]) -> list[str]:
    """Targets sit beside the point that their NCP carries; swapped supports lie far from it."""
    if set(moves.points.groups) != set(rig.supports):
        return []
    driven = [moves.points.take(moves.points.indices(name)) for name in rig.supports]
    places = np.stack([points.measured.xyz.mean(axis=0) for points in driven])
    centres = np.stack([t.points.measured.xyz.mean(axis=0) for t in targets])
    gap = np.linalg.norm(centres[:, None] - places, axis=-1)
    nearest = gap.argmin(axis=1)
    return [
        f"the targets of {name} lie nearest to the moves of {rig.supports[k]}: check the group "
        "names"
        for i, (name, k) in enumerate(zip(rig.supports, nearest, strict=True))
        if k != i and gap[i, i] > 2 * gap[i, k]
    ]
