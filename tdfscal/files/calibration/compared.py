"""What to know of a calibration file in use; two compared by the recordings both stand on."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tdfscal.catalogue import rigs_apart
from tdfscal.checks.calibrated_rig import different_constants, other_papers, other_rig
from tdfscal.checks.shared_data import Readings, Recorded, relation
from tdfscal.comparison.compatibility import (
    Comparison,
    Nested,
    compare_pair,
    in_order_of,
    stated_alike,
)
from tdfscal.files.calibration.document import Calibration, overdue, unsealed
from tdfscal.files.calibration.evidence import CampaignResult
from tdfscal.files.calibration.parameters import UNCONFIRMED, unscaled
from tdfscal.files.calibration.parts import instant
from tdfscal.findings import Finding, Value
from tdfscal.records import Rig, Rotations

Named = tuple[str, Calibration]


def compared(
    first: Named, second: Named, order: Rotations | None = None
) -> tuple[Comparison, tuple[Finding, ...]]:
    """The first minus the second, by what they have in common; and what there is to say of that.

    Of no two results the differences stand alone, with what keeps them from being two; of two rigs
    nothing agrees, whatever the numbers say, and one that was rejected verifies nothing. order :
    whose sensors' order holds, by default the first's.

    Raises DataError where they are of different supports.
    """
    pair, said = _by_recordings(first, second, order)
    a, b = ((name, c.rig.record()) for name, c in (first, second))
    # Of constants stated otherwise, but for where the LCS lies.
    what = (found.values["what"] for found in different_constants(a[1], b[1])
            if found.code == "rig-constant" and found.values["what"] != "hinge")  # fmt: skip
    values: dict[str, Value] = {"whats": [str(one) for one in dict.fromkeys(what)]}
    said = (*said, *other_papers(a, b))
    if values["whats"]:
        said += (Finding("compared-stated-otherwise", (a[0], b[0]), values=values),)
    rejected = tuple(name for name, c in (first, second) if not c.accepted)
    if differences := other_rig(a[1], b[1]):
        found = rigs_apart(differences, "compared-other-rig")
        found = replace(found, subject=(second[0],), rejects=True)
    elif rejected:
        found = Finding("compared-rejected", rejected, values={"names": " and ".join(rejected)})
    else:
        return pair, said
    known = () if pair.obstacle is None else (pair.obstacle,)
    return replace(pair, obstacle=found), (*said, *known)


def _by_recordings(
    first: Named, second: Named, order: Rotations | None
) -> tuple[Comparison, tuple[Finding, ...]]:
    (a, A), (b, B) = first, second
    order = A.rotations() if order is None else order
    given = [(name, in_order_of(order, c.rotations())) for name, c in (first, second)]
    common = relation(*([f for one in files_of(c) for f in one] for c in (A, B)))
    if common == "apart":
        common = relation(*(readings_of(c, order.supports) for c in (A, B)))
    if common in ("first", "second"):
        return _nested(first, second, 1 if common == "first" else 0, given)
    known = [unscaled(c) for c in (A, B)]
    alike = all(one.rig.supports == order.supports for one in known)
    pair = compare_pair(given[0], given[1], common=stated_alike(*known) if alike else 0.0)
    if common == "apart":
        return pair, ()
    code = "compared-same-data" if common == "same" else "compared-overlapping"
    return _no_two_results(pair, Finding(code, (a, b), values={"first": a, "second": b})), ()


def _nested(
    first: Named, second: Named, whole: int, given: list[tuple[str, Rotations]]
) -> tuple[Comparison, tuple[Finding, ...]]:
    """Compare two calibrations of which one has all recordings of the other, and more."""
    (all_name, most), (part_name, part) = (first, second) if whole == 0 else (second, first)
    apart = most.measured.record().month - part.measured.record().month
    walk = most.rig.record().drift.angle ** 2 * abs(apart)
    scatter = max(1.0, 1.0 if most.fit is None else most.fit.birge)
    stated = [np.array(c.parameters and c.parameters.unscaled) for _, c in (first, second)]
    # By what is stated, times a ratio common to both; its own would pass for what the data added.
    if all(
        matrix.shape == one.covariance.shape for matrix, (_, one) in zip(stated, given, strict=True)
    ):
        given = [
            (name, in_order_of(known, replace(c.rotations(), covariance=scatter**2 * matrix)))
            for (_, known), (name, c), matrix in zip(given, (first, second), stated, strict=True)
        ]
    pair = compare_pair(given[0], given[1], Nested(whole, walk))
    undated = any(c.measured.source == "file" for c in (most, part))
    values: dict[str, Value] = {"whole": all_name, "part": part_name, "walked": walk > 0}
    values["undated"] = walk > 0 and undated
    if pair.dof == 0:
        found = Finding("compared-nothing-added", (all_name, part_name), values=values)
        return _no_two_results(pair, found), ()
    return pair, (Finding("compared-nested", (all_name, part_name), values=values),)


def _no_two_results(pair: Comparison, found: Finding) -> Comparison:
    """Leave of a comparison the differences: nothing is known of how large they may be."""
    unknown = np.full_like(pair.rpy, np.nan)
    return replace(
        pair,
        rpy_std=unknown,
        en=unknown,
        detectable=unknown,
        chi2=np.nan,
        dof=0,
        p_value=np.nan,
        obstacle=found,
    )


def campaigns_of(c: Calibration, name: str = "calibration") -> tuple[CampaignResult, ...]:
    """The campaigns that a calibration stands on; one that lists none is one itself, by `name`."""
    if c.campaigns:
        return c.campaigns
    # In motion the noise is estimated with the fit: its χ² tells nothing of what was stated.
    tested, span = c.fit if c.motion is None else None, None
    if c.motion is not None:
        span = c.motion.begin, c.motion.begin + c.motion.seconds
    elif c.dwells is not None and c.dwells.start:
        span = min(c.dwells.start), max(c.dwells.end)
    alone = CampaignResult.model_construct(
        name=name,
        **{key: getattr(c, key) for key in ("measured", "inputs", "terminal")},
        zero=tuple(support.zero for support in c.supports),
        zero_std=tuple(support.zero_std for support in c.supports),
        postures=c.fit.postures if c.fit else 0,
        chi2=tested.chi2 if tested else 0.0,
        dof=tested.dof if tested else 0,
        readings=c.dwells,
        span=span,
    )
    return (alone,)


def files_of(c: Calibration) -> list[tuple[Recorded, ...]]:
    """The files of each recording that a calibration stands on, its earlier campaigns' among them.

    Nominal points and servo positions are what was wanted, and no recording.
    """
    files = [Path(name).name for name in (c.rig.tracker.files if c.rig.tracker else ())]
    wanted, surveyed = files[::2], files[1::2]
    return [
        tuple(
            Recorded(f.path, f.sha256, None if Path(f.path).name in surveyed else one.span)
            for f in one.inputs
            if Path(f.path).name not in wanted
        )
        for one in campaigns_of(c)
    ]


def readings_of(c: Calibration, supports: Sequence[str]) -> list[Readings]:
    """Mean readings of each recording that a calibration stands on, empty where it tells none.

    supports : in whose order.
    """
    order, zeros = [c.support_names.index(name) for name in supports], np.zeros((len(supports), 3))
    nothing = Readings(np.zeros((0, *zeros.shape)), zeros)
    return [
        nothing
        if table is None or not table.force
        else Readings(np.array(table.force)[:, order], np.array(table.noise)[order])
        for table in (one.readings for one in campaigns_of(c))
    ]


def defects(name: str, c: Calibration, papers: Rig | None = None) -> tuple[Finding, ...]:
    """What whoever uses a calibration that goes by `name` must know; nothing where it is sound.

    papers : of the sensors now, where these are not those that were calibrated.
    """
    before = overdue(c.rig.record(), c.measured.end[:10], name)
    ended = {found.subject for found in before}
    now = overdue(papers or c.rig.record(), instant(time.time())[:10])
    since = (found for found in now if found.subject not in ended)
    return (*below_accepted(name, c), *unsealed(name, c), *before, *since)


def below_accepted(name: str, c: Calibration) -> tuple[Finding, ...]:
    """The gate rejected it, or it rests on lines of a draft, of which two are named."""
    if not c.accepted:
        why = "; ".join(reason.text for reason in c.reasons)
        return (Finding("rejected-in-use", (name,), values={"why": why}),)
    if c.status != "provisional":
        return ()
    lines = [line for entry in c.found(UNCONFIRMED) for line in entry.subject]
    said = {"lines": lines[:2]}
    return (Finding("provisional-in-use", (name,), len(lines), values=said),)
