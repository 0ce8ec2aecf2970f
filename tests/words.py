"""Findings in words, for tests of what is said."""

from __future__ import annotations

from collections.abc import Iterable

from tdfscal.catalogue import told
from tdfscal.files.calibration.parts import FindingResult
from tdfscal.findings import Finding


def in_words(findings: Iterable[Finding | FindingResult]) -> tuple[str, ...]:
    """What each says, with its cure."""
    return tuple(f.told if isinstance(f, FindingResult) else told(f) for f in findings)
