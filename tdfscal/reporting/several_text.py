"""Several calibrations as plain text in 80 columns."""

from __future__ import annotations

from tdfscal.comparison.compatibility import ANGLES, Comparison
from tdfscal.reporting.several import Several
from tdfscal.reporting.text import table, wrapped

#: Columns of values that fit beside sensor and angle.
_ABREAST = 3


def render_several(view: Several) -> str:
    """Verdict first, then the files, their angles, and E_n of each pair."""
    lines = [f"{view.title}: {view.word}", ""]
    for verdict in view.verdicts:
        lines += wrapped(f"- {verdict}")
    lines.append("")
    for heading, items in (("Warnings", view.warnings), ("What next", view.advice)):
        if items:
            lines += [heading, *(line for item in items for line in wrapped(f"- {item}")), ""]
    lines += ["Calibrations, oldest first", *_files(view)]
    for part in (view.angles, view.en):
        fixed, columns = part.left, list(range(part.left, len(part.header)))
        lines += ["", part.caption]
        for first in range(0, len(columns), _ABREAST):
            chosen = [*range(fixed), *columns[first : first + _ABREAST]]
            rows = [[row[c] for c in chosen] for row in part.rows]
            lines += [*table([part.header[c] for c in chosen], rows, left=fixed), ""]
        lines.pop()
    return "\n".join(lines) + "\n"


def _files(view: Several) -> list[str]:
    lines = []
    for mark, name, created, method, status, weakest in view.files.rows:
        text = f"{mark}  {name}: {method}, {created}, {status}, weakest angle {weakest} mrad"
        lines += wrapped(text, "  ", "   ")
    return lines


def render_comparison(c: Comparison) -> str:
    """Differences, their uncertainties and E_n of one pair."""
    lines = [*wrapped(f"{c.verdict[0].upper()}{c.verdict[1:]}", "", ""), ""]
    rows = [
        [
            name if j == 0 else "",
            ANGLES[j],
            f"{1e3 * c.rpy[i, j]:+.3f}",
            f"{2e3 * c.rpy_std[i, j]:.3f}",
            f"{c.en[i, j]:.2f}" + (" !" if c.en[i, j] > 1 else "  "),
        ]
        for i, name in enumerate(c.supports)
        for j in range(3)
    ]
    lines += wrapped(f"{c.names[0]} minus {c.names[1]}, mrad; U with k = 2", "", "")
    lines += table(["sensor", "angle", "difference", "U", "E_n  "], rows, left=2)
    p = f"{c.p_value:.2f}" if c.p_value >= 0.01 else f"{c.p_value:.1g}"
    lines += ["", f"All together: χ² = {c.chi2:.4g} for {c.dof} degrees of freedom, p = {p}"]
    return "\n".join(lines) + "\n"
