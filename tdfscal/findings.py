"""What the data show, as facts: a code and its numbers. `tdfscal.catalogue` has the words.

The mathematics returns findings; the gate, the advice, the exit status and `--json` act on their
codes. No sentence is made below `catalogue`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from tdfscal.frozen import field, record

Severity = Literal["refuses", "rejects", "warns", "notes"]
#: What a sentence may need besides.
Value = str | float | bool | Sequence[str] | Sequence[float] | None


@record
class Finding:
    """A fact about a campaign, its rig file, or a result.

    code : stable, in the catalogue. subject : what it is about: supports, channels, files, in the
    order of their weight. size, unit : SI; how much. p_value : that chance alone shows as much.
    harm : shift of the worst angle, rad. values : further numbers and names that its sentence
    gives. rejects : the quality gate rejects by it.
    """

    code: str
    subject: tuple[str, ...] = ()
    size: float | None = None
    unit: str = ""
    p_value: float | None = None
    harm: float | None = None
    values: Mapping[str, Value] = field(default_factory=dict)
    rejects: bool = False


def unfit(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return those for which thresholds are none for a machine: what rejects, or lacks noise."""
    return tuple(f for f in findings if f.rejects or f.code == "path-without-noise")


def rejecting(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return those by which the quality gate rejects."""
    return tuple(finding for finding in findings if finding.rejects)
