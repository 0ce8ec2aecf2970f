"""Several calibrations side by side and over time; two compared."""

from __future__ import annotations

from collections.abc import Sequence
from string import ascii_uppercase
from typing import Any

import numpy as np

from tdfscal.catalogue import cure, sentence
from tdfscal.catalogue.entry import begun
from tdfscal.comparison.compatibility import Comparison, in_order_of, judged_together, rpy_std
from tdfscal.files.calibration.compared import compared
from tdfscal.files.calibration.defects import defects
from tdfscal.files.calibration.document import Calibration, recorded
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import p_text, probability
from tdfscal.reporting import layout
from tdfscal.reporting.headline import half_widths, within
from tdfscal.reporting.layout import Drawing, Facts, Report, Section, Table, by_angle, mrad
from tdfscal.reporting.traceability import measured_on
from tdfscal.significance import COVERAGE_FACTOR, DETECTION_POWER, INCOMPATIBLE

#: Said where calibrations stand on the same recordings.
_NO_RESULTS = "NOT SEPARATE RESULTS"
_K = f"k = {COVERAGE_FACTOR:g}"


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
        return not self.departs and all(pair.obstacle is None for pair in self.pairs)

    @property
    def departs(self) -> bool:
        """One is not compatible with the first, at one level for all (Bonferroni)."""
        return not all(pair.compatible for pair in self.pairs if np.isfinite(pair.p_value))

    @property
    def apart(self) -> bool:
        """One is of another rig than the first."""
        return any(pair.obstacle and pair.obstacle.rejects for pair in self.pairs)

    @property
    def unverified(self) -> bool:
        """One was rejected, which alone keeps them from agreeing."""
        rejected = not all(c.accepted for c in self.content)
        return rejected and not self.apart and not self.departs


def put_side_by_side(calibrations: Sequence[tuple[str, Calibration]]) -> Several:
    """Order by the date of measurement and compare.

    Raises DataError where there is one only, or where their supports differ.
    """
    ordered = sorted(calibrations, key=lambda pair: recorded(pair[1]).end)
    letters = tuple(letter(i) for i in range(len(ordered)))
    content = tuple(c for _, c in ordered)
    first, *later = zip(letters, content, strict=True)
    found = [compared(each, first) for each in later]
    remarks = list[Finding]()
    for _, said in found:
        remarks += (one for one in said if one not in remarks)
    names, pairs = tuple(name for name, _ in ordered), judged_together([pair for pair, _ in found])
    return Several(names, letters, content, pairs, tuple(remarks))


def several_report(view: Several, drawings: tuple[Drawing, ...] = ()) -> Report:
    """Lay out several calibrations: verdict first, then the files, their angles, and E_n."""
    files = tuple(
        (
            mark,
            f"{name}: {layout.METHODS[c.method].split(',')[0]}{measured_on(c)}, "
            f"{c.status if c.status == 'accepted' else c.status.upper()}, each angle {within(c)} "
            "(95 %)",
        )
        for mark, name, c in zip(view.letters, view.names, view.content, strict=True)
    )
    return Report(
        title=" and ".join(dict.fromkeys(c.rig.name for c in view.content)),
        subtitle=f"{len(view.names)} calibrations side by side, in the order of measurement",
        verdict=_headline(view),
        accepted=view.agrees,
        provisional=any(c.status == "provisional" for c in view.content),
        reasons=tuple(_verdict(pair) for pair in view.pairs if not pair.verified),
        sections=(
            Section("Calibrations", (Facts(files),)),
            *layout.illustrated(drawings, {}),
            Section(
                "Angles and E_n",
                (_angles(view), _en(view)),
                f"E_n is the difference divided by its expanded uncertainty ({_K}); whether two "
                "calibrations are compatible, the χ² of all and of each sensor say.",
            ),
        ),
        warnings=_warnings(view),
        advice=(_keep(view),) if view.agrees or view.unverified else _advice(view.pairs),
    )


def _headline(view: Several) -> str:
    if view.apart:
        return "NOT COMPARABLE"
    if view.departs or view.agrees:
        return "NOT COMPATIBLE" if view.departs else "COMPATIBLE"
    return "NOT VERIFIED" if view.unverified else _NO_RESULTS


def letter(index: int) -> str:
    """A to Z, then A2 to Z2 and so on."""
    turn, place = divmod(index, 26)
    return ascii_uppercase[place] + (str(turn + 1) if turn else "")


def several_document(view: Several) -> dict[str, Any]:
    """Return the comparison as plain JSON values: names, verdicts, differences, E_n; rad."""
    names = dict(zip(view.letters, view.names, strict=True))
    return layout.document(
        view,
        "letters calibrations=names verified=agrees",
        against_first=[comparison_document(c, names) for c in view.pairs],
    )


def comparison_document(c: Comparison, names: dict[str, str]) -> dict[str, Any]:
    """Return one comparison as plain JSON values; angles in rad."""
    of, against = (names.get(name, name) for name in c.names)
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
    cures = dict.fromkeys(f"{begun(cure(found))}." for found in obstacles)
    return (*cures, *(_DEPARTED if departs and not apart else ()))


_DEPARTED = (
    "Validate the newest on a held-out log (tdfscal validate).",
    "Look for what was loosened, exchanged or mounted anew between the two; where nothing was, "
    "one of them understates its uncertainty.",
)


def _keep(view: Several) -> str:
    """Which of calibrations that agree stays in use, and why; best those with nothing open."""
    sound = [pair for pair in zip(view.letters, view.content, strict=True) if pair[1].accepted]
    if not sound:
        return "Use none of them: calibrate again."
    named = [pair for pair in sound if pair[1].status == "accepted"] or sound
    first, best = named[0], min(named, key=lambda pair: half_widths(pair[1]).max())
    keep = f"Keep {first[0]} in use: no move since is seen, so that nothing need be loaded anew"
    if within(best[1]) == within(first[1]):
        return f"{keep}."
    return f"{keep}; {best[0]} where ± matters, for it knows the angles best."


def _warnings(view: Several) -> tuple[str, ...]:
    named = list(zip(view.letters, view.content, strict=True))
    found = [sentence(one) for name, c in named for one in defects(name, c)]
    rigs = [c.rig.model_dump(exclude={"sha256", "campaign", "stated_limits"}) for c in view.content]
    if any(rig != rigs[0] for rig in rigs):
        found.append("the rig files differ between these calibrations")
    found += map(sentence, view.remarks)
    return tuple(found)


def _angles(view: Several) -> Table:
    order = view.content[0].rotations()
    each = [in_order_of(order, c.rotations()) for c in view.content]
    cells = [mrad_with(so3.to_rpy(one.rotation), rpy_std(one)) for one in each]
    caption = f"Angles in mrad with expanded uncertainty, {_K}"
    rows = by_angle(order.supports, *cells)
    return Table(caption, ("sensor", "angle", *view.letters), rows, left=2)


def mrad_with(value: Any, std: Any) -> layout.Cell:
    """Cells of values (n, 3), rad, in mrad with their expanded uncertainty."""
    return lambda i, j: f"{1e3 * value[i, j]:.3f} ± {1e3 * COVERAGE_FACTOR * std[i, j]:.3f}"


def _en(view: Several) -> Table:
    pairs = view.pairs
    rows = by_angle(pairs[0].supports, *(_marked(pair.en) for pair in pairs))
    together = ("all", "p(χ²)", *(probability(pair.p_value) for pair in pairs))
    header = ("sensor", "angle", *(f"{pair.names[0]} − {pair.names[1]}" for pair in pairs))
    return Table("E_n per angle; ! marks those above 1", header, (*rows, together), left=2)


def _marked(en: Any) -> layout.Cell:
    def cell(i: int, j: int) -> str:
        return f"{'! ' if en[i, j] > 1 else ''}{en[i, j]:.2f}" if np.isfinite(en[i, j]) else "–"

    return cell


def comparison_report(c: Comparison, remarks: Sequence[Finding] = ()) -> Report:
    """Lay out differences, their uncertainties and E_n of one pair; of no two results the first."""
    columns = {"difference": mrad(c.rpy, "+.3f")}
    caption, together = f"{c.names[0]} minus {c.names[1]}, the later minus the earlier, mrad", ""
    if np.isfinite(c.p_value):
        columns |= {
            "U": mrad(COVERAGE_FACTOR * c.rpy_std),
            "E_n": _marked(c.en),
            "detectable": mrad(c.detectable),
        }
        caption += f"; U with {_K}"
        together = (
            f"All together: {layout.chi_squared(c.chi2, c.dof, c.p_value)}; the sensor that "
            f"differs most: {p_text(c.alone)}. Compatible where neither is below {c.limit:.2g}: of "
            f"sound calibrations {INCOMPATIBLE:.0%} at most are not. A change of one angle as "
            f"large as its last column would have been seen with {DETECTION_POWER:.0%} probability."
        )
    header, rows = ("sensor", "angle", *columns), by_angle(c.supports, *columns.values())
    said = (*([together] if together else ()), *(f"{sentence(remark)}." for remark in remarks))
    blocks = (Table(caption, header, rows, left=2), *said)
    return Report(
        title=begun(_verdict(c)),
        accepted=c.verified,
        sections=(Section("Differences", blocks),),
        advice=_advice([c]),
    )
