"""Several calibrations side by side and over time: rows, verdict, figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any

from tdfscal.comparison.compatibility import ANGLES, Comparison, History, compare
from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.summary import METHODS
from tdfscal.reporting.tables import Table

if TYPE_CHECKING:
    from tdfscal.reporting.figures.style import Drawing

_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


@dataclass(frozen=True, slots=True)
class Several:
    """What a reader of several calibrations needs; letters stand for the files in tables.

    days : since the first was created. agrees : every later one agrees with the first.
    """

    title: str
    names: tuple[str, ...]
    letters: tuple[str, ...]
    days: tuple[float, ...]
    history: History
    agrees: bool
    verdicts: tuple[str, ...]
    advice: tuple[str, ...]
    warnings: tuple[str, ...]
    files: Table
    angles: Table
    en: Table

    @property
    def word(self) -> str:
        """The verdict in capitals."""
        return "AGREEMENT" if self.agrees else "NO AGREEMENT"


def put_side_by_side(calibrations: Sequence[tuple[str, Calibration]]) -> Several:
    """Order by the time of creation, compare, and work out the rows.

    Raises DataError where there is one only, or where their supports differ.
    """
    ordered = sorted(calibrations, key=lambda pair: _instant(pair[1]))
    letters = tuple(letter(i) for i in range(len(ordered)))
    history = compare(
        [(names, c.rotations()) for names, (_, c) in zip(letters, ordered, strict=True)]
    )
    content = [c for _, c in ordered]
    agrees = all(step.verified for step in history.against_first)
    return Several(
        title=" and ".join(dict.fromkeys(c.rig.name for c in content)),
        names=tuple(name for name, _ in ordered),
        letters=letters,
        days=tuple((_instant(c) - _instant(content[0])).total_seconds() / 86400 for c in content),
        history=history,
        agrees=agrees,
        verdicts=tuple(step.verdict for step in history.against_first),
        advice=_advice(agrees),
        warnings=_warnings(letters, content),
        files=_files(letters, ordered),
        angles=_angles(letters, history),
        en=_en(history),
    )


def letter(index: int) -> str:
    """A to Z, then A2 to Z2 and so on."""
    turn, place = divmod(index, len(_LETTERS))
    return _LETTERS[place] + (str(turn + 1) if turn else "")


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
        "verdict": c.verdict,
        "chi2": c.chi2,
        "dof": c.dof,
        "p_value": c.p_value,
        "difference_rpy": c.rpy.tolist(),
        "difference_rpy_std": c.rpy_std.tolist(),
        "en": c.en.tolist(),
        "rotation_vector": c.rotation_vector.tolist(),
    }


def several_drawings(view: Several) -> tuple[Drawing, ...]:
    """Return the figures of several calibrations."""
    from tdfscal.reporting.figures import drift

    return (drift.draw(view.history, view.letters, view.days),)


def _instant(c: Calibration) -> datetime:
    return datetime.fromisoformat(c.created)


def _advice(agrees: bool) -> tuple[str, ...]:
    if agrees:
        return ("Keep the first calibration in use, or the one with the smallest uncertainty.",)
    return (
        "Validate the newest on a held-out log: tdfscal validate CALIBRATION LOG.",
        "Look for what was loosened, exchanged or mounted anew between the two; where nothing was, "
        "one of them states its uncertainty too small.",
    )


def _warnings(letters: Sequence[str], content: Sequence[Calibration]) -> tuple[str, ...]:
    found = [
        f"{name} was rejected by the quality gate"
        for name, c in zip(letters, content, strict=True)
        if c.status == "rejected"
    ]
    if len({c.rig.sha256 for c in content}) > 1:
        found.append("the rig files differ between these calibrations")
    logs = [frozenset(f.sha256 for f in c.inputs) for c in content]
    if any(a & b for i, a in enumerate(logs) for b in logs[i + 1 :]):
        found.append(
            "some share input files: they are not independent, and E_n is then only a guide"
        )
    return tuple(found)


def _files(letters: Sequence[str], ordered: Sequence[tuple[str, Calibration]]) -> Table:
    rows = tuple(
        (
            mark,
            name,
            c.created.replace("T", " ").replace("Z", ""),
            METHODS[c.method].split(",")[0],
            c.status,
            f"{1e3 * c.rpy_std.max():.2g}",
        )
        for mark, (name, c) in zip(letters, ordered, strict=True)
    )
    header = ("", "file", "created, UTC", "method", "status", "weakest, mrad")
    return Table("", header, rows, left=5)


def _angles(letters: Sequence[str], h: History) -> Table:
    rows = tuple(
        (
            name,
            ANGLES[j],
            *(
                f"{1e3 * h.rpy[f, i, j]:.3f} ± {2e3 * h.rpy_std[f, i, j]:.3f}"
                for f in range(len(letters))
            ),
        )
        for i, name in enumerate(h.supports)
        for j in range(3)
    )
    caption = "Angles in mrad with expanded uncertainty, k = 2"
    return Table(caption, ("sensor", "angle", *letters), rows, left=2)


def _en(h: History) -> Table:
    columns = [*h.against_first, *h.steps[1:]]
    rows = [
        (name, ANGLES[j], *(_marked(float(c.en[i, j])) for c in columns))
        for i, name in enumerate(h.supports)
        for j in range(3)
    ]
    rows.append(("all", "p(χ²)", *(_p(c.p_value) for c in columns)))
    header = ("sensor", "angle", *(f"{c.names[0]} − {c.names[1]}" for c in columns))
    return Table("E_n per angle; ! marks those above 1", header, tuple(rows), left=2)


def _marked(en: float) -> str:
    return f"! {en:.2f}" if en > 1 else f"{en:.2f}"


def _p(value: float) -> str:
    return f"{value:.2f}" if value >= 0.01 else f"{value:.0e}" if value > 0 else "0"
