"""The reference names every key, command and option that there is, and nothing else."""

import re

import tdfscal
import tdfscal.errors
from docs.generate import generated
from tdfscal.cli.app import COMMANDS
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
