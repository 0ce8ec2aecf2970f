"""Several calibrations side by side and over time; two compared; one as found and as left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from string import ascii_uppercase
from typing import Any

import numpy as np

from tdfscal.catalogue import sentence
from tdfscal.comparison.compatibility import Comparison, History, compare, compare_pair
from tdfscal.files.calibration.document import Calibration
from tdfscal.findings import Finding
from tdfscal.reporting import layout
from tdfscal.reporting.layout import Drawing, Facts, Report, Section, Table, by_angle, mrad, utc
from tdfscal.reporting.traceability import UNSEALED
from tdfscal.significance import COVERAGE_FACTOR, DETECTION_POWER, INCOMPATIBLE

_K = f"k = {COVERAGE_FACTOR:g}"


@dataclass(frozen=True, slots=True)
class Several:
    """Calibrations in the order of measurement; letters stand for the files in tables."""

    names: tuple[str, ...]
    letters: tuple[str, ...]
    content: tuple[Calibration, ...]
    history: History

    @property
    def agrees(self) -> bool:
        """Every later one is compatible with the first, at one level for all (Bonferroni)."""
        pairs = self.history.against_first
        return min(pair.p_value for pair in pairs) * len(pairs) >= INCOMPATIBLE


def put_side_by_side(calibrations: Sequence[tuple[str, Calibration]]) -> Several:
    """Order by the date of measurement and compare.

    Raises DataError where there is one only, or where their supports differ.
    """
    ordered = sorted(calibrations, key=lambda pair: _instant(pair[1]))
    letters = tuple(letter(i) for i in range(len(ordered)))
    content = tuple(c for _, c in ordered)
    return Several(
        names=tuple(name for name, _ in ordered),
        letters=letters,
        content=content,
        history=compare([(a, c.rotations()) for a, c in zip(letters, content, strict=True)]),
    )


def several_report(view: Several, drawings: tuple[Drawing, ...] = ()) -> Report:
    """Lay out several calibrations: verdict first, then the files, their angles, and E_n."""
    files = tuple(
        (
            mark,
            f"{name}: {layout.METHODS[c.method].split(',')[0]}, {utc(c.created)}, {c.status}, "
            f"weakest angle {1e3 * c.rpy_std[c.determined].max():.2g} mrad",
        )
        for mark, name, c in zip(view.letters, view.names, view.content, strict=True)
    )
    return Report(
        title=" and ".join(dict.fromkeys(c.rig.name for c in view.content)),
        subtitle=f"{len(view.names)} calibrations side by side, oldest first",
        verdict="COMPATIBLE" if view.agrees else "NOT COMPATIBLE",
        accepted=view.agrees,
        reasons=tuple(_verdict(step) for step in view.history.against_first if not step.verified),
        sections=(
            Section("Calibrations", (Facts(files),)),
            *layout.illustrated(drawings, {}),
            Section(
                "Angles and E_n",
                (_angles(view.history, view.letters), _en(view.history)),
                f"E_n is the difference divided by its expanded uncertainty ({_K}); above 1 two "
                "calibrations are not compatible in that angle.",
            ),
        ),
        warnings=_warnings(view),
        advice=_ADVICE[view.agrees],
    )


def letter(index: int) -> str:
    """A to Z, then A2 to Z2 and so on."""
    turn, place = divmod(index, 26)
    return ascii_uppercase[place] + (str(turn + 1) if turn else "")


def several_document(view: Several) -> dict[str, Any]:
    """Return the comparison as plain JSON values: names, verdicts, drift, E_n; rad."""
    h = view.history
    names = dict(zip(view.letters, view.names, strict=True))
    return layout.document(
        h,
        "supports rpy rpy_std drift drift_std",
        calibrations=view.names,
        letters=view.letters,
        verified=view.agrees,
        against_first=[comparison_document(c, names) for c in h.against_first],
        steps=[comparison_document(c, names) for c in h.steps],
    )


def comparison_document(c: Comparison, names: dict[str, str]) -> dict[str, Any]:
    """Return one comparison as plain JSON values; angles in rad."""
    of, against = (names.get(name, name) for name in c.names)
    return layout.document(
        c,
        "verified chi2 dof p_value difference_rpy=rpy difference_rpy_std=rpy_std en "
        "detectable_rpy=detectable rotation_vector",
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


def _instant(c: Calibration) -> datetime:
    """When it was measured; a file of old says only when it was computed."""
    return datetime.fromisoformat(c.created if c.measured is None else c.measured.end)


_ADVICE = {
    True: ("Keep the first calibration in use, or the one with the smallest uncertainty.",),
    False: (
        "Validate the newest on a held-out log: tdfscal validate CALIBRATION LOG.",
        "Look for what was loosened, exchanged or mounted anew between the two; where nothing was, "
        "one of them understates its uncertainty.",
    ),
}


def _warnings(view: Several) -> tuple[str, ...]:
    found = [
        f"{name} was rejected by the quality gate"
        for name, c in zip(view.letters, view.content, strict=True)
        if c.status == "rejected"
    ]
    found += [
        f"{name} is {UNSEALED}"
        for name, c in zip(view.letters, view.content, strict=True)
        if c.unsealed
    ]
    if len({c.rig.sha256 for c in view.content}) > 1:
        found.append("the rig files differ between these calibrations")
    logs = [
        {f.sha256 for f in c.inputs} | {f.sha256 for part in c.campaigns for f in part.inputs}
        for c in view.content
    ]
    if any(a & b for i, a in enumerate(logs) for b in logs[i + 1 :]):
        found.append(
            "some share input files: they are not independent, and E_n is then only a guide"
        )
    return tuple(found)


def _angles(h: History, letters: Sequence[str]) -> Table:
    cells = [mrad_with(value, std) for value, std in zip(h.rpy, h.rpy_std, strict=True)]
    caption = f"Angles in mrad with expanded uncertainty, {_K}"
    return Table(caption, ("sensor", "angle", *letters), by_angle(h.supports, *cells), left=2)


def mrad_with(value: Any, std: Any) -> layout.Cell:
    """Cells of values (n, 3), rad, in mrad with their expanded uncertainty."""
    return lambda i, j: f"{1e3 * value[i, j]:.3f} ± {1e3 * COVERAGE_FACTOR * std[i, j]:.3f}"


def _en(h: History) -> Table:
    pairs = [*h.against_first, *h.steps[1:]]
    rows = by_angle(h.supports, *(_marked(pair.en) for pair in pairs))
    together = ("all", "p(χ²)", *(layout.probability(pair.p_value) for pair in pairs))
    header = ("sensor", "angle", *(f"{pair.names[0]} − {pair.names[1]}" for pair in pairs))
    return Table("E_n per angle; ! marks those above 1", header, (*rows, together), left=2)


def _marked(en: Any) -> layout.Cell:
    return lambda i, j: f"{'! ' if en[i, j] > 1 else ''}{en[i, j]:.2f}"


def comparison_report(c: Comparison, remarks: Sequence[Finding] = ()) -> Report:
    """Lay out differences, their uncertainties and E_n of one pair; of no two results the first."""
    columns = {"difference": mrad(c.rpy, "+.3f")}
    caption, together = f"{c.names[0]} minus {c.names[1]}, mrad", ""
    if np.isfinite(c.p_value):
        columns |= {
            "U": mrad(COVERAGE_FACTOR * c.rpy_std),
            "E_n": _marked(c.en),
            "detectable": mrad(c.detectable),
        }
        caption += f"; U with {_K}"
        together = (
            f"All together: {layout.chi_squared(c.chi2, c.dof, c.p_value)}. A change of one angle "
            f"as large as its last column would have been seen with {DETECTION_POWER:.0%} "
            "probability."
        )
    header, rows = ("sensor", "angle", *columns), by_angle(c.supports, *columns.values())
    said = (*([together] if together else ()), *(f"{sentence(remark)}." for remark in remarks))
    blocks = (Table(caption, header, rows, left=2), *said)
    return Report(
        title=layout.begun(_verdict(c)),
        accepted=c.verified,
        sections=(Section("Differences", blocks),),
    )


def as_found(c: Calibration, name: str, previous: Calibration) -> Section:
    """Each angle before and now, the change, and whether it is more than both uncertainties.

    Raises DataError where the two are of different sensors.
    """
    pair = compare_pair(("as left", c.rotations()), (name, previous.rotations()))
    old = [previous.support_names.index(support) for support in pair.supports]
    columns = {
        "as found": mrad(previous.rpy[old]),
        "as left": mrad(c.rpy),
        "change": mrad(pair.rpy, "+.3f"),
        f"U, {_K}": mrad(COVERAGE_FACTOR * pair.rpy_std),
        "E_n": lambda i, j: f"{pair.en[i, j]:.2f}",
    }
    said = layout.begun(_verdict(pair), ".")
    if c.history:  # what stands on an earlier one is not independent of it
        columns = dict(list(columns.items())[:3])
        said = "This calibration stands on earlier ones: its changes are not independent of them."
    rows = by_angle(pair.supports, *columns.values())
    both = np.repeat(c.determined & previous.determined[old], 3)
    shown = tuple(row for row, known in zip(rows, both, strict=True) if known)
    caption = (
        f"Angles, mrad; as found: {name}, measured {_instant(previous):%Y-%m-%d}; as left: "
        f"measured {_instant(c):%Y-%m-%d}"
    )
    table = Table(caption, ("sensor", "angle", *columns), shown, left=2)
    return Section("As found, as left", (table, said))
