"""The catalogue holds every code of the source, and no other; every entry can be said."""

import ast
from pathlib import Path
from typing import get_args

from tdfscal.catalogue import CATALOGUE, document, sentence
from tdfscal.findings import Finding, Severity

PACKAGE = Path(__file__).parents[2] / "tdfscal"


def test_every_code_of_the_source_is_in_the_catalogue_and_no_other() -> None:
    """Those of misfits and changes are made of the cause's name."""
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
    made = {code for code in CATALOGUE if code.startswith(("misfit-", "change-"))}
    assert set(CATALOGUE) - made <= strings


def test_every_entry_can_be_said() -> None:
    for code, entry in CATALOGUE.items():
        assert entry.severity in get_args(Severity), code
        said = document(Finding(code, ("ncp1",), 1.0, "m", 0.5, 1e-3, {"mrad": 1.0}))
        assert said["text"], code
        assert said["severity"] == entry.severity
        rejecting = document(Finding(code, ("ncp1",), 1.0, "m", 0.5, 1e-3, {"mrad": 1.0}, True))
        assert rejecting["severity"] == "rejects"


def test_a_size_and_its_uncertainty_are_said_in_one_unit() -> None:
    turn = {"change": [2.1e-3, -4e-4, 1e-5], "change_95": [3.18e-4, 3.86e-4, 3.57e-4]}
    said = sentence(Finding("change-sensor-turned", ("ncp1",), 2.14e-3, "rad", values=turn))
    assert "(2.1, -0.4, 0.01) mrad" in said
    assert "± (0.318, 0.386, 0.357) mrad" in said
    known = Finding("positioner-axis-faulty", ("ncp1",), 4e-4, "m", values={"std": 2e-3})
    assert "0.4 mm ± 2 mm" in sentence(known)
