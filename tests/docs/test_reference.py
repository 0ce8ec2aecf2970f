"""The reference names every key, command and option that there is, and nothing else."""

import re

import pytest

import tdfscal
import tdfscal.errors
from docs.generate import generated
from tdfscal.cli.app import COMMANDS, described, made, summary
from tests.docs.pages import section, text

OF_THE_PROGRAM = {"--version", "--install-completion", "--show-completion", "--help"}


def test_generated_tables_are_those_of_the_program() -> None:
    assert generated(text("reference")) == text("reference")
    for option in OF_THE_PROGRAM:
        assert f"`{option}`" in section("reference", "## Commands")


def test_python_s_pages_name_all_that_is_public() -> None:
    """api.md every name, of the errors by their module; python.md every function of a command."""
    listed = re.findall(r"auto(?:function|class):: (\w+)", text("api"))
    errors = {name for name in tdfscal.__all__ if name in dir(tdfscal.errors)}
    assert sorted(listed) == sorted(set(tdfscal.__all__) - errors - {"__version__"})
    assert "automodule:: tdfscal.errors" in text("api")
    functions = section("python", "## Functions")
    assert set(COMMANDS) <= set(re.findall(r"`(\w+)\(", functions))


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_says_the_same_in_python_and_in_the_help(name: str) -> None:
    """Its first sentence, and every parameter's help."""
    command = described(name)
    doc = str(getattr(tdfscal, name).__doc__)
    assert doc.startswith(summary(name))
    shown = {p.name: p.help for p in made(name).params}
    for p in command.parameters:
        assert shown[p.name] == p.option.sentence
        told = re.sub(r"--(?!json)(\w+)", r"`\1`", p.option.help)
        assert f"    {p.name} : {told}" in doc
    assert "stdout" not in doc
