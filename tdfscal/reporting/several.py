"""Several calibrations side by side and over time; two compared; one as found and as left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from string import ascii_uppercase
from typing import Any

import numpy as np

from tdfscal.comparison.compatibility import Comparison, History, compare, compare_pair
from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.layout import Drawing, Facts, Report, Section, Table, by_angle, illustrated
from tdfscal.reporting.phrases import METHODS, chi_squared, probability, utc, verdict
from tdfscal.significance import COVERAGE_FACTOR, DETECTION_POWER, INCOMPATIBLE


@dataclass(frozen=True, slots=True)
class Several:
    """Calibrations in the order of measurement; letters stand for the files in tables.

    days : since the first was measured.
    """

    names: tuple[str, ...]
    letters: tuple[str, ...]
    content: tuple[Calibration, ...]
    days: tuple[float, ...]
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
    first = _instant(content[0])
    return Several(
        names=tuple(name for name, _ in ordered),
        letters=letters,
        content=content,
        days=tuple((_instant(c) - first).total_seconds() / 86400 for c in content),
        history=compare([(a, c.rotations()) for a, c in zip(letters, content, strict=True)]),
    )


def several_report(view: Several, drawings: tuple[Drawing, ...] = ()) -> Report:
    """Lay out several calibrations: verdict first, then the files, their angles, and E_n."""
    return Report(
        title=" and ".join(dict.fromkeys(c.rig.name for c in view.content)),
        subtitle=f"{len(view.names)} calibrations side by side, oldest first",
        verdict="COMPATIBLE" if view.agrees else "NOT COMPATIBLE",
        accepted=view.agrees,
        reasons=tuple(verdict(step) for step in view.history.against_first if not step.verified),
        sections=(
            Section("Calibrations", (Facts(_files(view)),)),
            *illustrated(drawings, {}),
            Section(
                "Angles and E_n",
                (_angles(view), _en(view.history)),
                "E_n is the difference divided by its expanded uncertainty (k = 2); above 1 two "
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


def document(view: Several) -> dict[str, Any]:
    """Return the comparison as plain JSON values: names, verdicts, drift, E_n; rad."""
    h = view.history
    names = dict(zip(view.letters, view.names, strict=True))
    return {
        "calibrations": list(view.names),
        "letters": list(view.letters),
        "supports": list(h.supports),
        "verified": view.agrees,
        "rpy": h.rpy.tolist(),
        "rpy_std": h.rpy_std.tolist(),
        "drift": h.drift.tolist(),
        "drift_std": h.drift_std.tolist(),
        "against_first": [comparison_document(c, names) for c in h.against_first],
        "steps": [comparison_document(c, names) for c in h.steps],
    }


def comparison_document(c: Comparison, names: dict[str, str]) -> dict[str, Any]:
    """Return one comparison as plain JSON values; angles in rad."""
    return {
        "of": names.get(c.names[0], c.names[0]),
        "against": names.get(c.names[1], c.names[1]),
        "verified": c.verified,
        "verdict": verdict(c),
        "chi2": c.chi2,
        "dof": c.dof,
        "p_value": c.p_value,
        "difference_rpy": c.rpy.tolist(),
        "difference_rpy_std": c.rpy_std.tolist(),
        "en": c.en.tolist(),
        "detectable_rpy": c.detectable.tolist(),
        "rotation_vector": c.rotation_vector.tolist(),
    }


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


def _files(view: Several) -> tuple[tuple[str, str], ...]:
    return tuple(
        (
            mark,
            f"{name}: {METHODS[c.method].split(',')[0]}, {utc(c.created)}, {c.status}, weakest "
            f"angle {1e3 * c.rpy_std[c.determined].max():.2g} mrad",
        )
        for mark, name, c in zip(view.letters, view.names, view.content, strict=True)
    )


def _angles(view: Several) -> Table:
    values, expanded = 1e3 * view.history.rpy, 1e3 * COVERAGE_FACTOR * view.history.rpy_std
    rows = by_angle(
        view.history.supports,
        lambda i, j: (
            f"{value:.3f} ± {half:.3f}"
            for value, half in zip(values[:, i, j], expanded[:, i, j], strict=True)
        ),
    )
    caption = f"Angles in mrad with expanded uncertainty, k = {COVERAGE_FACTOR:g}"
    return Table(caption, ("sensor", "angle", *view.letters), rows, left=2)


def _en(h: History) -> Table:
    pairs = [*h.against_first, *h.steps[1:]]
    rows = by_angle(h.supports, lambda i, j: (_marked(float(pair.en[i, j])) for pair in pairs))
    together = ("all", "p(χ²)", *(probability(pair.p_value) for pair in pairs))
    header = ("sensor", "angle", *(f"{pair.names[0]} − {pair.names[1]}" for pair in pairs))
    return Table("E_n per angle; ! marks those above 1", header, (*rows, together), left=2)


def comparison_report(c: Comparison) -> Report:
    """Lay out differences, their uncertainties and E_n of one pair."""
    rows = by_angle(
        c.supports,
        lambda i, j: (
            f"{1e3 * c.rpy[i, j]:+.3f}",
            f"{1e3 * COVERAGE_FACTOR * c.rpy_std[i, j]:.3f}",
            f"{c.en[i, j]:.2f}" + (" !" if c.en[i, j] > 1 else "  "),
            f"{1e3 * c.detectable[i, j]:.3f}",
        ),
    )
    header = ("sensor", "angle", "difference", "U", "E_n  ", "detectable")
    caption = f"{c.names[0]} minus {c.names[1]}, mrad; U with k = {COVERAGE_FACTOR:g}"
    together = (
        f"All together: {chi_squared(c.chi2, c.dof, c.p_value)}. A change of one angle as large as "
        f"its last column would have been seen with {DETECTION_POWER:.0%} probability."
    )
    return Report(
        title=_capital(verdict(c)),
        accepted=c.verified,
        sections=(Section("Differences", (Table(caption, header, rows, left=2), together)),),
    )


def _capital(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}"


def _marked(en: float) -> str:
    return f"! {en:.2f}" if en > 1 else f"{en:.2f}"


def as_found(c: Calibration, name: str, previous: Calibration) -> Section:
    """Each angle before and now, the change, and whether it is more than both uncertainties.

    Raises DataError where the two are of different sensors.
    """
    pair = compare_pair(("as left", c.rotations()), (name, previous.rotations()))
    both = c.determined & previous.determined
    old = dict(zip(previous.support_names, 1e3 * previous.rpy, strict=True))
    expanded = 1e3 * COVERAGE_FACTOR * pair.rpy_std
    header = ("sensor", "angle", "as found", "as left", "change", f"U, k = {COVERAGE_FACTOR:g}",
              "E_n")  # fmt: skip
    rows = by_angle(
        pair.supports,
        lambda i, j: (
            f"{old[pair.supports[i]][j]:.3f}",
            f"{1e3 * c.rpy[i, j]:.3f}",
            f"{1e3 * pair.rpy[i, j]:+.3f}",
            f"{expanded[i, j]:.3f}",
            f"{pair.en[i, j]:.2f}",
        ),
    )
    rows = tuple(row for row, known in zip(rows, np.repeat(both, 3), strict=True) if known)
    said, columns = f"{_capital(verdict(pair))}.", len(header)
    if c.history:  # what stands on an earlier one is not independent of it
        columns -= 2
        said = "This calibration stands on earlier ones: its changes are not independent of them."
    shown = tuple(row[:columns] for row in rows)
    caption = (
        f"Angles, mrad; as found: {name}, measured {_day(previous)}; as left: measured {_day(c)}"
    )
    return Section("As found, as left", (Table(caption, header[:columns], shown, left=2), said))


def _day(c: Calibration) -> str:
    return utc(c.measured.end if c.measured is not None else c.created)[:10]
