"""The catalogue of findings: for each code its severity, its sentence, its cure.

`python docs/generate.py` prints it into the reference.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from tdfscal import errors
from tdfscal.catalogue.campaign import CAMPAIGN, SUSPECTS
from tdfscal.catalogue.entry import Entry
from tdfscal.catalogue.in_use import IN_USE
from tdfscal.catalogue.inputs import LOGS, SURVEY
from tdfscal.catalogue.refusals import REFUSALS
from tdfscal.findings import Finding, Severity, Value
from tdfscal.significance import HARMLESS_SHIFT

#: Of errors that are stated in words: a code per class.
_STATED = {
    kind.code: Entry("refuses", "{what}", "{hint}", (), "")
    for kind in vars(errors).values()
    if hasattr(kind, "code")
}
CATALOGUE: dict[str, Entry] = _STATED | SUSPECTS | CAMPAIGN | LOGS | SURVEY | IN_USE | REFUSALS


def severity(finding: Finding) -> Severity:
    """Return how grave a finding is; what is suspected and moves nothing is a note."""
    if finding.rejects:
        return "rejects"
    shift, usual = finding.values.get("shift"), CATALOGUE[finding.code].severity
    harmless = isinstance(shift, float) and shift < HARMLESS_SHIFT
    harmless &= "zero_shift" not in finding.values
    return "notes" if harmless and usual == "warns" else usual


def sentence(finding: Finding) -> str:
    """Return what a finding says."""
    return CATALOGUE[finding.code].words(finding)


def cure(finding: Finding) -> str:
    """Return what to do about a finding; empty where nothing is to do."""
    return CATALOGUE[finding.code].advice(finding)


def told(finding: Finding) -> str:
    """Return what a finding says, and what to do about it."""
    advice = cure(finding)
    return f"{sentence(finding)}: {advice}" if advice else sentence(finding)


def document(finding: Finding) -> dict[str, Any]:
    """Return a finding as plain JSON values, as files and `--json` have it."""
    return {
        "code": finding.code,
        "severity": severity(finding),
        "subject": list(finding.subject),
        "size": None if finding.size is None else float(finding.size),
        "unit": finding.unit or None,
        "p_value": finding.p_value,
        "harm": finding.harm,
        "text": sentence(finding),
        "cure": cure(finding) or None,
    }


def documents(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """Return findings as `document` has them, each once."""
    found: list[dict[str, Any]] = []
    for finding in findings:
        if (entry := document(finding)) not in found:
            found.append(entry)
    return found


def rigs_apart(found: Sequence[Finding], code: str, **values: Value) -> Finding:
    """Return all that tells two rigs apart as one finding."""
    differences = "; ".join(sentence(finding) for finding in found)
    values["exchanged"] = all(finding.code == "sensor-exchanged" for finding in found)
    values["framed"] = any(finding.values.get("framed") for finding in found)
    return Finding(code, values={**values, "differences": differences})


def _of_error(finding: Finding) -> tuple[str, str, str]:
    return sentence(finding), CATALOGUE[finding.code].where, cure(finding)


errors.put_into_words(_of_error)
