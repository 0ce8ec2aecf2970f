"""Findings, in words and of refusals, for tests of what is said."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import pytest

from tdfscal.catalogue import told
from tdfscal.errors import DataError
from tdfscal.files.calibration.parts import FindingResult
from tdfscal.findings import Finding


def in_words(findings: Iterable[Finding | FindingResult]) -> tuple[str, ...]:
    """What each says, with its cure."""
    return tuple(f.told if isinstance(f, FindingResult) else told(f) for f in findings)


def found(text: str, severity: str = "warns") -> dict[str, Any]:
    """One finding of a file."""
    code = "residuals-large" if severity == "rejects" else "campaign-remark"
    return {"code": code, "severity": severity, "text": text}


def texts(document: Mapping[str, Any]) -> list[str]:
    """What the findings of a document say."""
    return [finding["text"] for finding in document["findings"]]


def refusal(function: Callable[..., object], *given: Any, **named: Any) -> Finding:
    """What it is that a call refuses its data for."""
    with pytest.raises(DataError) as refused:
        function(*given, **named)
    assert refused.value.exit_status == 3
    return refused.value.finding
