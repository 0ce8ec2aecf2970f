"""The catalogue holds every code of the source, and no other; every entry can be said."""

import ast
from dataclasses import replace
from pathlib import Path
from typing import get_args

from tdfscal.catalogue import CATALOGUE, document, severity
from tdfscal.findings import Finding, Severity

PACKAGE = Path(__file__).parents[2] / "tdfscal"


def test_every_code_of_the_source_is_in_the_catalogue_and_no_other() -> None:
    """Those of changes are made of the cause's name."""
    strings, codes = set[str](), set[str]()
    for path in PACKAGE.rglob("*.py"):
        if "catalogue" in path.parts:
            continue
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            match node:
                case ast.Constant(value=str(said)):
                    strings.add(said)
                case ast.Call(func=ast.Name("Finding"), args=[ast.Constant(value=code), *_]) if (
                    "from tdfscal.findings import" in text  # and no record of that name
                ):
                    codes.add(str(code))
    assert codes <= set(CATALOGUE)
    made = {code for code in CATALOGUE if code.startswith("change-")}
    assert set(CATALOGUE) - made <= strings


def test_every_entry_can_be_said() -> None:
    for code, entry in CATALOGUE.items():
        assert entry.severity in get_args(Severity), code
        said = document(Finding(code, ("ncp1",), 1.0, "m", 0.5, 1e-3, {"mrad": 1.0}))
        assert said["text"], code
        assert said["severity"] == entry.severity
        rejecting = document(Finding(code, ("ncp1",), 1.0, "m", 0.5, 1e-3, {"mrad": 1.0}, True))
        assert rejecting["severity"] == "rejects"


def test_what_is_suspected_and_moves_next_to_nothing_is_a_note() -> None:
    for shift, grave in ((0.1, "notes"), (0.6, "warns")):
        doubt = Finding("force-noise-suspected", (), 0.1, "N", 1e-9, 1e-6, {"shift": shift})
        assert severity(doubt) == grave
        assert severity(replace(doubt, rejects=True)) == "rejects"
        beside = replace(doubt, values={**doubt.values, "zero": "x of ncp1", "zero_shift": 1.5})
        assert severity(beside) == "warns"
