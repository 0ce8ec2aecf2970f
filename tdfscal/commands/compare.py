"""`compare`: do calibrations agree within their uncertainties?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdfscal.catalogue import documents, rigs_apart
from tdfscal.checks.same_rig import other_rig
from tdfscal.commands import options
from tdfscal.commands.arguments import SILENT
from tdfscal.commands.calibration import Calibration, read_sources, sources_of
from tdfscal.commands.options import Option
from tdfscal.commands.result import Result, by_column
from tdfscal.comparison.compatibility import Comparison, Nested, compare_pair
from tdfscal.comparison.shared_data import Recorded, relation
from tdfscal.errors import UsageError
from tdfscal.findings import Finding, Value
from tdfscal.records import ANGLES, Measured, Rotations
from tdfscal.reporting.layout import Drawing
from tdfscal.reporting.several import comparison_document, comparison_report
from tdfscal.reporting.text import render


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class CompareResult(Result):
    """The first calibration against each of the others.

    pairs : one comparison each. rejected : names of those that the quality gate rejected.
    renamed : what is said of rigs whose names differ. remarks : of each pair, on the data that
    both stand on.
    """

    pairs: tuple[Comparison, ...]
    rejected: tuple[str, ...] = ()
    renamed: tuple[str, ...] = ()
    remarks: tuple[tuple[Finding, ...], ...] = ()

    @property
    def verified(self) -> bool:
        """Every pair agrees, and none of it was rejected."""
        return all(pair.verified for pair in self.pairs)

    @property
    def notes(self) -> tuple[str, ...]:
        """Rejected calibrations, and rigs of other names."""
        rejected = (f"{name} was rejected by the quality gate" for name in self.rejected)
        return (*rejected, *self.renamed)

    @property
    def exit_status(self) -> int:
        """1 unless all are accepted and compatible."""
        return 0 if self.verified and not self.rejected else 1

    @property
    def text(self) -> str:
        """Verdict, differences and E_n of each pair."""
        each = zip(self.pairs, self.remarks, strict=True)
        return "\n".join(render(comparison_report(pair, said)) for pair, said in each)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison, or all under `comparisons`, as plain JSON values."""
        each = [
            comparison_document(pair, {})
            | {"findings": documents((*filter(None, [pair.obstacle]), *said))}
            for pair, said in zip(self.pairs, self.remarks, strict=True)
        ]
        if len(each) == 1:
            return each[0]
        return {"verified": self.verified, "comparisons": each}

    def table(self) -> dict[str, list[Any]]:
        """One row per pair and angle: the difference, its standard uncertainty, E_n; rad."""
        rows = (
            (*pair.names, name, angle, pair.rpy[i, j], pair.rpy_std[i, j], pair.en[i, j])
            for pair in self.pairs
            for i, name in enumerate(pair.supports)
            for j, angle in enumerate(ANGLES)
        )
        return by_column("of against support angle difference std en", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return one figure per pair of two results: differences with expanded uncertainty."""
        from tdfscal.reporting.figures.angles import comparison

        return tuple(
            comparison(pair, k + 1)
            for k, pair in enumerate(self.pairs)
            if np.isfinite(pair.p_value)
        )


@options.command("compare last-month.yaml calibration.yaml")
def compare(
    *files: Annotated[
        options.Several,
        Option(
            "calibration files of one rig, two or more; the first is compared with each other",
            list[Path],
            "A B…",
        ),
    ],
    progress: options.Telling = SILENT,
) -> CompareResult:
    """Tell whether calibrations agree: differences, joint χ², E_n per angle, verdict.

    Raises
    ------
    UsageError
        There are fewer than two, or one cannot be read.
    DataError
        One is no calibration, or they are of different supports.
    """
    sources = sources_of(*files)
    if len(sources) < 2:
        raise UsageError("one calibration cannot be compared", hint="name two files or more")
    read = read_sources(sources)
    rejected = tuple(name for name, c in read if not c.accepted)
    first, rigs = read[0], [c.loaded_rig(name).rig for name, c in read]
    pairs, remarks = list[Comparison](), list[tuple[Finding, ...]]()
    for other, rig in zip(read[1:], rigs[1:], strict=True):
        pair, remark = _compared(first, other)
        found = _obstacle(pair, rejected, other_rig(rigs[0], rig))
        if pair.obstacle is not None and found is not pair.obstacle:
            remark = (*remark, pair.obstacle)
        pairs.append(replace(pair, verified=pair.verified and found is None, obstacle=found))
        remarks.append(remark)
    renamed = tuple(
        f"{first[0]} is of {rigs[0].name}, {name} of {rig.name}"
        for (name, _), rig in zip(read[1:], rigs[1:], strict=True)
        if rig.name != rigs[0].name
    )
    return CompareResult(tuple(pairs), rejected, renamed, tuple(remarks))


Named = tuple[str, Calibration]


def _compared(first: Named, second: Named) -> tuple[Comparison, tuple[Finding, ...]]:
    """Compare two calibrations by what they have in common; and what there is to say of that."""
    (a, A), (b, B) = first, second
    common = relation(_recordings(A), _recordings(B))
    if common in ("first", "second"):
        return _nested(first, second, 1 if common == "first" else 0)
    pair = compare_pair((a, A.rotations()), (b, B.rotations()))
    if common == "apart":
        return pair, ()
    code = "compared-same-data" if common == "same" else "compared-overlapping"
    return _no_two_results(pair, Finding(code, (a, b), values={"first": a, "second": b})), ()


def _nested(first: Named, second: Named, whole: int) -> tuple[Comparison, tuple[Finding, ...]]:
    """Compare two calibrations of which one has all recordings of the other, and more."""
    (all_name, most), (part_name, part) = (first, second) if whole == 0 else (second, first)
    walk = most.loaded_rig(all_name).rig.drift.angle ** 2 * abs(_month(most) - _month(part))
    scatter = max(1.0, 1.0 if most.fit is None else most.fit.birge)
    given = [(name, c.rotations()) for name, c in (first, second)]
    unscaled = [_before_scaling(c, scatter) for _, c in (first, second)]
    if None not in unscaled:  # or else their ratios would pass for what the data added
        given = [(n, u) for (n, _), u in zip(given, unscaled, strict=True) if u is not None]
    pair = compare_pair(given[0], given[1], Nested(whole, walk))
    values: dict[str, Value] = {"whole": all_name, "part": part_name, "walked": walk > 0}
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
        verified=False,
        obstacle=found,
    )


def _before_scaling(c: Calibration, scatter: float) -> Rotations | None:
    """Rotations with the covariance by what is stated, times a ratio common to both; or None."""
    if c.parameters is None or c.parameters.unscaled is None:
        return None
    covariance = np.array(c.parameters.unscaled)
    if covariance.shape != c.rotation_covariance.shape:
        return None
    return Rotations(c.support_names, c.rotation, scatter**2 * covariance)


def _recordings(c: Calibration) -> frozenset[Recorded]:
    """The recordings that a calibration stands on, its earlier campaigns' among them.

    Nominal points and servo positions are what was wanted, and no recording.
    """
    wanted, surveyed = set[str](), set[str]()
    if c.rig.tracker is not None:
        targets, moves = c.rig.tracker.targets, c.rig.tracker.moves
        wanted = {Path(targets.nominal).name, Path(moves.servo).name}
        surveyed = {Path(targets.measured).name, Path(moves.measured).name}
    span = None if c.campaigns else _span(c)
    inputs = [*c.inputs, *(entry for campaign in c.campaigns for entry in campaign.inputs)]
    named = ((Path(entry.path).name, entry.sha256) for entry in inputs)
    return frozenset(
        Recorded(digest, None if name in surveyed else span)
        for name, digest in named
        if name not in wanted
    )


def _span(c: Calibration) -> tuple[float, float] | None:
    """Begin and end of the part of a log that was used, s in the log's time."""
    if c.motion is not None:
        return c.motion.begin, c.motion.begin + c.motion.seconds
    if c.dwells is not None and len(c.dwells.start):
        return float(min(c.dwells.start)), float(max(c.dwells.end))
    return None


def _month(c: Calibration) -> float:
    """When the angles were as they are given, in months since 1970."""
    if c.measured is not None:
        return c.measured.record().month
    moment = datetime.fromisoformat(c.created).timestamp()
    return Measured(moment, moment, "file").month


def _obstacle(
    pair: Comparison, rejected: tuple[str, ...], differences: tuple[Finding, ...]
) -> Finding | None:
    """A calibration that was rejected, or of another rig, verifies nothing, whatever it says.

    Nor does one that stands on the same recordings.
    """
    if differences:
        found = rigs_apart(differences, "compared-other-rig")
        return replace(found, subject=pair.names[1:], rejects=True)
    blamed = tuple(name for name in pair.names if name in rejected)
    if not blamed:
        return pair.obstacle
    return Finding("compared-rejected", blamed, values={"names": " and ".join(blamed)})
