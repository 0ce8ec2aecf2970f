"""What whoever uses a calibration must know of it: said wherever one is read for use."""

from __future__ import annotations

import time

from tdfscal.files.calibration.consistency import UNCONFIRMED
from tdfscal.files.calibration.document import Calibration, recorded
from tdfscal.files.calibration.parts import instant, seconds
from tdfscal.findings import Finding, Value

#: Seconds by which clocks and time zones may differ.
_DAY = 86400.0
#: Lines of a draft that a sentence names.
_LINES_SAID = 2


def defects(name: str, c: Calibration) -> tuple[Finding, ...]:
    """All of a calibration that goes by `name`; nothing where it is sound."""
    return (*below_accepted(name, c), *doubtful(name, c))


def below_accepted(name: str, c: Calibration) -> tuple[Finding, ...]:
    """The gate rejected it, or it rests on lines of a draft."""
    if not c.accepted:
        why = "; ".join(reason.text for reason in c.reasons)
        return (Finding("rejected-in-use", (name,), values={"why": why}),)
    if c.status != "provisional":
        return ()
    lines = [line for entry in c.found(UNCONFIRMED) for line in entry.subject]
    said = {"lines": lines[:_LINES_SAID]}
    return (Finding("provisional-in-use", (name,), len(lines), values=said),)


def doubtful(name: str, c: Calibration) -> tuple[Finding, ...]:
    """It cannot tell whether it was edited; it was computed in the future, or before its data."""
    found = [Finding("calibration-unsealed", (name,))] if c.unsealed else []
    made, end = seconds(c.created), recorded(c).end
    wrong: dict[str, Value] = {"future": made > time.time() + _DAY, "late": end > made + _DAY}
    if any(wrong.values()):
        values = wrong | {"created": c.created, "end": instant(end)}
        found.append(Finding("calibration-misdated", (name,), values=values))
    return tuple(found)
