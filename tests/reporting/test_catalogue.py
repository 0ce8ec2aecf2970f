"""The catalogue holds every code of the source, and no other."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tdfscal.catalogue import CATALOGUE, document, severity
from tdfscal.findings import Finding

PACKAGE = Path(__file__).parents[2] / "tdfscal"


def strings() -> set[str]:
    """Every text constant of the source outside the catalogue."""
    found: set[str] = set()
    for path in PACKAGE.rglob("*.py"):
        if "catalogue" in path.parts:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.add(node.value)
    return found


def codes() -> set[str]:
    """Codes that findings are made with, where they stand as a constant."""
    found: set[str] = set()
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if "from tdfscal.findings import" not in text:  # another record of that name
            continue
        for node in ast.walk(ast.parse(text)):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Name)
                and node.func.id == "Finding"
                and node.args
                and isinstance(node.args[0], ast.Constant)
            ):
                found.add(str(node.args[0].value))
    return found


def test_every_code_of_the_source_is_in_the_catalogue() -> None:
    assert codes() <= set(CATALOGUE)


def test_every_code_of_the_catalogue_is_in_the_source() -> None:
    """Those of misfits are made of the cause's name."""
    listed = {code for code in CATALOGUE if not code.startswith("misfit-")}
    assert listed <= strings() | codes()


@pytest.mark.parametrize("code", CATALOGUE)
def test_every_entry_can_be_said(code: str) -> None:
    said = document(Finding(code, ("ncp1",), 1.0, "m", 0.5, 1e-3))
    assert said["text"]
    assert severity(Finding(code, rejects=True)) == "rejects"
