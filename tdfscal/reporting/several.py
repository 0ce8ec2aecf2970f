"""Several calibrations side by side and over time; two compared."""

from __future__ import annotations

from collections.abc import Sequence
from string import ascii_uppercase
from typing import Any

import numpy as np

from tdfscal.catalogue import cure, sentence
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import p_text, probability, with_std
from tdfscal.comparison.compatibility import Comparison, in_order_of, judged_together, rpy_std
from tdfscal.files.calibration.compared import compared
from tdfscal.files.calibration.document import Calibration, defects
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.numerics import so3
from tdfscal.reporting import layout
from tdfscal.reporting.headline import half_widths, within
from tdfscal.reporting.layout import Drawing, Facts, Report, Section, Table, by_angle, mrad
from tdfscal.reporting.traceability import Making, content_facts, making_of, measured_on
from tdfscal.significance import COVERAGE_FACTOR, DETECTION_POWER, INCOMPATIBLE

_K = f"k = {COVERAGE_FACTOR:g}"
_RULE = (
    "Two calibrations are compatible where neither the χ² of all differences together nor that of "
    "any sensor by itself is less probable than {limit}, so that of sound calibrations "
    f"{INCOMPATIBLE:.0%} at most are called incompatible. E_n, a difference divided by its "
    f"expanded uncertainty ({_K}), only shows where they differ: of many angles some exceed 1 by "
    "chance."
)
_DEPARTED = (
    "Validate the newest on a held-out log (tdfscal validate).",
    "Look for what was loosened, exchanged or mounted anew between the two; where nothing was, "
    "one of them understates its uncertainty.",
)


@record
class Several:
    """Calibrations in the order of measurement; letters stand for the files in tables.

    pairs : each later one minus the first. remarks : on the data that some have in common.
    """

    names: tuple[str, ...]
    letters: tuple[str, ...]
    content: tuple[Calibration, ...]
    pairs: tuple[Comparison, ...]
    remarks: tuple[Finding, ...] = ()

    @property
    def agrees(self) -> bool:
        """Every later one is a result of its own and of the same rig, compatible with the first."""
        return self.verdict == "COMPATIBLE"

    @property
    def verdict(self) -> str:
        """In words, at one level for all pairs with the first (Bonferroni)."""
        obstacles = [pair.obstacle for pair in self.pairs if pair.obstacle]
        rejected = not all(c.accepted for c in self.content)
        if any(found.rejects for found in obstacles):
            return "NOT COMPARABLE"
        if not all(pair.compatible for pair in self.pairs if np.isfinite(pair.p_value)):
            return "NOT COMPATIBLE"
        if obstacles:
            return "NOT VERIFIED" if rejected else "NOT SEPARATE RESULTS"
        return "COMPATIBLE"


def put_side_by_side(calibrations: Sequence[tuple[str, Calibration]]) -> Several:
    """Order by the date of measurement and compare.

    Raises DataError where there is one only, or where their supports differ.
    """
    ordered = sorted(calibrations, key=lambda pair: pair[1].measured.record().end)
    letters = tuple(letter(i) for i in range(len(ordered)))
    content = tuple(c for _, c in ordered)
    first, *later = zip(letters, content, strict=True)
    found = [compared(each, first) for each in later]
    remarks = list[Finding]()
    for _, said in found:
        remarks += (one for one in said if one not in remarks)
    names, pairs = tuple(name for name, _ in ordered), judged_together([pair for pair, _ in found])
    return Several(names, letters, content, pairs, tuple(remarks))


def letter(index: int) -> str:
    """A to Z, then A2 to Z2 and so on."""
    turn, place = divmod(index, 26)
    return ascii_uppercase[place] + (str(turn + 1) if turn else "")


def several_report(view: Several, making: Making, drawings: tuple[Drawing, ...] = ()) -> Report:
    """Lay out several calibrations: verdict, files, angles, differences, the rule, each origin."""
    each = list(zip(view.letters, view.names, view.content, strict=True))
    files = tuple((mark, f"{name}: {_described(c)}") for mark, name, c in each)
    rule = ("Decision rule", _RULE.format(limit=f"{view.pairs[0].limit:.2g}"))
    verdict = view.verdict
    keep = (_keep(view),) if verdict in ("COMPATIBLE", "NOT VERIFIED") else ()
    return Report(
        title=" and ".join(dict.fromkeys(c.rig.name for c in view.content)),
        subtitle=f"{len(view.names)} calibrations side by side, in the order of measurement",
        verdict=verdict,
        accepted=view.agrees,
        provisional=any(c.status == "provisional" for c in view.content),
        reasons=tuple(begun(_verdict(step), ".") for step in view.pairs if not step.verified),
        sections=(
            Section("Calibrations", (Facts(files),)),
            *layout.illustrated(drawings, {}),
            Section("Angles and differences", (_angles(view), _differences(view), *_en(view))),
            making.section(rule, title="Where this verdict comes from", page_only=False),
            *(
                making_of(c).section(*content_facts(c), title=f"Where {mark} comes from")
                for mark, _, c in each
            ),
        ),
        created=layout.utc(making.created),
        warnings=_warnings(view),
        advice=keep or _advice(view.pairs),
    )


def _described(c: Calibration) -> str:
    status = c.status if c.status == "accepted" else c.status.upper()
    method = layout.METHODS[c.method].split(",")[0]
    return f"{method}{measured_on(c)}, {status}, each angle {within(c)} (95 %)"


def _keep(view: Several) -> str:
    """Which of calibrations that agree stays in use, and why; best those with nothing open."""
    sound = [pair for pair in zip(view.letters, view.content, strict=True) if pair[1].accepted]
    if not sound:
        return "Use none of them: calibrate again."
    named = [pair for pair in sound if pair[1].status == "accepted"] or sound
    first, best = named[0], min(named, key=lambda pair: half_widths(pair[1]).max())
    keep = f"Keep {first[0]} in use: no change beyond the uncertainties was seen since"
    if within(best[1]) == within(first[1]):
        return f"{keep}."
    return f"{keep}; {best[0]} knows the angles best, if a smaller ± is wanted."


def _warnings(view: Several) -> tuple[str, ...]:
    named = list(zip(view.letters, view.content, strict=True))
    found = [sentence(one) for name, c in named for one in defects(name, c)]
    own = {"sha256", "campaign", "stated_limits"}
    rigs = [c.rig.model_dump(exclude=own) for c in view.content]
    if any(rig != rigs[0] for rig in rigs):
        found.append("the rig files differ between these calibrations")
    return (*found, *map(sentence, view.remarks))


def _angles(view: Several) -> Table:
    order = view.content[0].rotations()
    each = [in_order_of(order, c.rotations()) for c in view.content]
    cells = [mrad_with(so3.to_rpy(one.rotation), rpy_std(one)) for one in each]
    caption = f"Angles in mrad with expanded uncertainty, {_K}"
    rows = by_angle(order.supports, *cells)
    return Table(caption, ("sensor", "angle", *view.letters), rows, left=2)


def mrad_with(value: Any, std: Any, sign: str = "") -> layout.Cell:
    """Cells of values (n, 3), rad, in mrad with their expanded uncertainty."""
    return lambda i, j: with_std(1e3 * value[i, j], 1e3 * COVERAGE_FACTOR * std[i, j], sign)


def _differences(view: Several) -> Table:
    """Each later one minus the first; of two that are no separate results without uncertainty."""
    cells = [
        mrad_with(pair.rpy, pair.rpy_std, "+")
        if np.isfinite(pair.p_value)
        else mrad(pair.rpy, "+.2f")
        for pair in view.pairs
    ]
    rows = by_angle(view.pairs[0].supports, *cells)
    caption = f"Differences in mrad with expanded uncertainty, {_K}"
    return Table(caption, ("sensor", "angle", *map(_minus, view.pairs)), rows, left=2)


def _minus(pair: Comparison) -> str:
    return " − ".join(pair.names)


def _en(view: Several) -> tuple[Table, ...]:
    """E_n of each later one against the first, where the two are separate results."""
    pairs = [pair for pair in view.pairs if np.isfinite(pair.p_value)]
    if not pairs:
        return ()
    rows = by_angle(pairs[0].supports, *(_marked(pair.en) for pair in pairs))
    together = ("all", "p(χ²)", *(probability(pair.p_value) for pair in pairs))
    header = ("sensor", "angle", *map(_minus, pairs))
    return (Table("E_n per angle; ! marks those above 1", header, (*rows, together), left=2),)


def _marked(en: Any) -> layout.Cell:
    def cell(i: int, j: int) -> str:
        return f"{'! ' if en[i, j] > 1 else ''}{en[i, j]:.2f}" if np.isfinite(en[i, j]) else "–"

    return cell


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


def comparison_report(c: Comparison, remarks: Sequence[Finding] = ()) -> Report:
    """Lay out differences, their uncertainties and E_n of one pair; of no two results the first."""
    columns = {"difference": mrad(c.rpy, "+.3f")}
    caption, rule = (
        f"{c.names[0]} minus {c.names[1]}, the later minus the earlier, mrad",
        list[str](),
    )
    if np.isfinite(c.p_value):
        columns |= {
            "U": mrad(COVERAGE_FACTOR * c.rpy_std),
            "E_n": _marked(c.en),
            "detectable": mrad(c.detectable),
        }
        caption += f"; U with {_K}"
        rule = [
            f"All angles together: {layout.chi_squared(c.chi2, c.dof, c.p_value)}. The sensor that "
            f"differs most, by itself: {p_text(c.alone)}.",
            f"Compatible where neither probability is below {c.limit:.2g}: of sound calibrations "
            f"{INCOMPATIBLE:.0%} at most are then called incompatible.",
            "A change of one angle as large as in the column detectable would have been seen with "
            f"{DETECTION_POWER:.0%} probability.",
        ]
    header, rows = ("sensor", "angle", *columns), by_angle(c.supports, *columns.values())
    said = (*([" ".join(rule)] if rule else ()), *(f"{sentence(one)}." for one in remarks))
    return Report(
        title=begun(_verdict(c)),
        accepted=c.verified,
        sections=(Section("Differences", (Table(caption, header, rows, left=2), *said)),),
        advice=_advice([c]),
    )
