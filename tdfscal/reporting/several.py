"""Calibrations compared and side by side: verdict, differences, which of them to keep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from tdfscal.catalogue import cure, sentence
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import coverage, p_text, rounded, with_std
from tdfscal.comparison.compatibility import Comparison, in_order_of, judged_together, rpy_std
from tdfscal.files.calibration.compared import Named, compared, defects
from tdfscal.files.calibration.document import Calibration
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.reporting import layout
from tdfscal.reporting.headline import within
from tdfscal.reporting.layout import Block, Drawing, Facts, Report, Section, Table, by_angle, mrad
from tdfscal.reporting.traceability import (
    Making,
    campaign,
    campaign_facts,
    certificates,
    content_facts,
    making_of,
    measured_on,
)
from tdfscal.significance import COVERAGE_FACTOR, DETECTION_POWER, INCOMPATIBLE

_U = f"k = {COVERAGE_FACTOR:g}"
_RULE = (
    "Two calibrations are compatible where neither the χ² of all differences together nor that of "
    "any sensor by itself is less probable than {limit}, so that of sound calibrations "
    f"{INCOMPATIBLE:.0%} at most are called incompatible. E_n, a difference divided by its "
    f"expanded uncertainty U ({_U}), only shows where they differ: of many angles some exceed 1 by "
    "chance. A change of one angle as large as in the column detectable would have been seen with "
    f"{DETECTION_POWER:.0%} probability. Both count as independent: what "
    "both state alike (gains, hinges, load) is in both uncertainties, so that fewer are called "
    "incompatible."
)
_DEPARTED = (
    "Validate the newest on a held-out log (tdfscal validate).",
    "Look for what was loosened, exchanged or mounted anew between the two; where nothing was, "
    "one of them understates its uncertainty.",
)


@record(eq=False)
class Several:
    """Calibrations by their names, and the first compared with each of the others.

    comparisons : always the later minus the earlier one. remarks : of each pair, on the data that
    both stand on, their rigs' papers.
    """

    named: tuple[Named, ...]
    comparisons: tuple[Comparison, ...]
    remarks: tuple[tuple[Finding, ...], ...]

    @classmethod
    def of(cls, named: Sequence[Named]) -> Self:
        """Compare the first of calibrations with each of the others.

        Raises DataError where their supports differ.
        """
        first, order = named[0], named[0][1].rotations()
        ordered = [sorted((first, other), key=by_date) for other in named[1:]]
        found = [compared(later, earlier, order) for earlier, later in ordered]
        pairs = judged_together([pair for pair, _ in found])
        return cls(tuple(named), pairs, tuple(remarks for _, remarks in found))

    @property
    def defects(self) -> tuple[Finding, ...]:
        """What must be known of each calibration by itself."""
        return tuple(found for name, c in self.named for found in defects(name, c))

    @property
    def verified(self) -> bool:
        """Every pair agrees, and nothing keeps it from being two results of one rig."""
        return all(pair.verified for pair in self.comparisons)

    @property
    def verdict(self) -> str:
        """In words, at one level for all pairs (Bonferroni)."""
        obstacles = [pair.obstacle for pair in self.comparisons if pair.obstacle]
        rejected = not all(c.accepted for _, c in self.named)
        if any(found.rejects for found in obstacles):
            return "NOT COMPARABLE"
        if not all(pair.compatible for pair in self.comparisons if np.isfinite(pair.p_value)):
            return "NOT COMPATIBLE"
        if obstacles:
            return "NOT VERIFIED" if rejected else "NOT SEPARATE RESULTS"
        return "COMPATIBLE"


def by_date(named: Named) -> float:
    """End of the data that a calibration stands on, s since 1970."""
    return named[1].measured.record().end


def several_report(view: Several, making: Making, drawings: tuple[Drawing, ...] = ()) -> Report:
    """Lay out verdict, files, angles, each pair's differences, the rule, where each comes from."""
    rule = ("Decision rule", _RULE.format(limit=f"{rounded(view.comparisons[0].limit)}"))
    said = tuple(begun(_verdict(pair), ".") for pair in view.comparisons)
    keep = (_keep(view),) if view.verdict in ("COMPATIBLE", "NOT VERIFIED") else ()
    files = Facts(tuple((name, _described(c)) for name, c in view.named))
    pairs = tuple(block for pair in view.comparisons for block in _pair(pair))
    return Report(
        title=" and ".join(dict.fromkeys(c.rig.name for _, c in view.named)),
        subtitle=f"{len(view.named)} calibrations side by side",
        verdict=view.verdict,
        accepted=view.verified,
        provisional=any(c.status == "provisional" for _, c in view.named),
        claim=" ".join(said) if view.verified else "",
        reasons=tuple(
            text for text, pair in zip(said, view.comparisons, strict=True) if not pair.verified
        ),
        summary=(files, *pairs),
        sections=(
            Section("Calibrations", (files,)),
            *layout.illustrated(drawings, {}),
            Section("Differences", pairs),
            Section("Angles", (_angles(view),)),
            making.section(rule, title="Where this verdict comes from", page_only=False),
            *(making_of(c).section(*content_facts(c), title=f"Where {name} comes from")
              for name, c in view.named),
            *(campaign(campaign_facts(c), c.rig.record(), f"Campaign and sensors of {name}")
              for name, c in view.named),
        ),
        warnings=_warnings(view),
        advice=(*certificates(view.defects), *(keep or _advice(view.comparisons))),
        created=layout.utc(making.created),
    )  # fmt: skip


def _described(c: Calibration) -> str:
    status = c.status if c.status == "accepted" else c.status.upper()
    method = layout.METHODS[c.method].split(",")[0]
    return f"{method}{measured_on(c)}, {status}, each angle {within(c)} ({coverage(c.accepted)})"


def _keep(view: Several) -> str:
    """Which of calibrations that agree stays in use, and why; best those with nothing open."""
    sound = sorted((each for each in view.named if each[1].accepted), key=by_date)
    if not sound:
        return "Use none of them: calibrate again."
    named = [each for each in sound if each[1].status == "accepted"] or sound
    first, best = named[0], min(named, key=lambda each: each[1].half_widths.max())
    keep = f"Keep {first[0]} in use: no change beyond the uncertainties was seen since"
    if within(best[1]) == within(first[1]):
        return f"{keep}."
    return f"{keep}; {best[0]} knows the angles best, if a smaller ± is wanted."


def _warnings(view: Several) -> tuple[str, ...]:
    own = {"sha256", "campaign", "stated_limits"}
    rigs = [c.rig.model_dump(exclude=own) for _, c in view.named]
    said = [sentence(one) for found in (view.defects, *view.remarks) for one in found]
    if rigs.count(rigs[0]) < len(rigs):
        said.append("the rig files differ between these calibrations")
    return tuple(dict.fromkeys(said))


def _angles(view: Several) -> Table:
    order = view.named[0][1].rotations()
    each = [in_order_of(order, c.rotations()) for _, c in view.named]
    cells = [mrad_with(so3.to_rpy(one.rotation), rpy_std(one)) for one in each]
    header = ("sensor", "angle", *layout.short([name for name, _ in view.named]))
    caption = "Angles, mrad, 95 %"
    return Table(caption, header, by_angle(order.supports, *cells), left=2)


def mrad_with(value: Any, std: Any, sign: str = "") -> layout.Cell:
    """Cells of values (n, 3), rad, in mrad with half their 95 % intervals."""
    return lambda i, j: with_std(1e3 * value[i, j], 1e3 * INTERVAL_FACTOR * std[i, j], sign)


def _pair(c: Comparison) -> tuple[Block, ...]:
    """Differences with their uncertainties and E_n; of no two results the differences alone."""
    caption = f"{c.names[0]} minus {c.names[1]}, mrad"
    if not np.isfinite(c.p_value):
        rows = by_angle(c.supports, mrad(c.rpy, "+.2f"))
        return (Table(caption, ("sensor", "angle", "difference"), rows, left=2),)
    cells = (mrad_with(c.rpy, c.rpy_std, "+"), _marked(c.en), mrad(c.detectable, ".2f"))
    header = ("sensor", "angle", "difference", "E_n", "detectable")
    table = Table(f"{caption}, 95 %", header, by_angle(c.supports, *cells), left=2)
    return (
        table,
        f"All angles together: {layout.chi_squared(c.chi2, c.dof, c.p_value)}. The sensor that "
        f"differs most, by itself: {p_text(c.alone)}. Compatible where neither is below "
        f"{rounded(c.limit)}.",
    )


def _marked(en: Any) -> layout.Cell:
    return lambda i, j: f"{'! ' * bool(en[i, j] > 1)}{en[i, j]:.2f}"


def comparison_document(c: Comparison) -> dict[str, Any]:
    """Return one comparison as plain JSON values; angles in rad."""
    of, against = c.names
    return layout.document(
        c,
        "verified chi2 dof p_value sensor_p_value=alone p_limit=limit difference_rpy=rpy "
        "difference_rpy_std=rpy_std en detectable_rpy=detectable rotation_vector",
        of=of,
        against=against,
        verdict=_verdict(c),
    )


def _verdict(c: Comparison) -> str:
    """Return whether two calibrations agree, in words."""
    if c.obstacle is None:
        return sentence(c.finding)
    if not np.isfinite(c.p_value):  # there are no two results, and nothing agrees
        return sentence(c.obstacle)
    return f"{sentence(c.obstacle)} ({sentence(c.finding)})"


def _advice(pairs: Sequence[Comparison]) -> tuple[str, ...]:
    """What to do about all that keeps pairs from agreeing."""
    obstacles = [pair.obstacle for pair in pairs if pair.obstacle]
    departs = any(np.isfinite(pair.p_value) and not pair.compatible for pair in pairs)
    apart = any(found.rejects for found in obstacles)
    cures = dict.fromkeys(begun(cure(found), ".") for found in obstacles if cure(found))
    return (*cures, *(_DEPARTED if departs and not apart else ()))
