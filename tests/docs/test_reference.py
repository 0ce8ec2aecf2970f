"""The reference names every key, command and option that there is, and nothing else."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from docs.generate import generated
from tdfscal.cli.app import COMMANDS, described, made
from tdfscal.dwells import DwellOptions
from tdfscal.errors import (
    DataError,
    NotConvergedError,
    NotIdentifiableError,
    RigError,
    UsageError,
)
from tdfscal.logs.common import clock
from tdfscal.logs.mcap.chunk import MAX_CHUNK
from tests.docs.pages import DOCS, key_paths, section, table, text

OF_THE_PROGRAM = {"--version", "--install-completion", "--show-completion", "--help"}


def schema(name: str) -> dict[str, Any]:
    path = DOCS.parent / "schemas" / f"{name}.schema.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    assert isinstance(content, dict)
    return content


def stated(name: str) -> dict[str, list[str]]:
    rows = table("reference", f"keys: {name}")
    keys = [row[0].strip("`") for row in rows]
    assert len(set(keys)) == len(keys)
    return dict(zip(keys, (row[1:] for row in rows), strict=True))


def test_keys_are_those_of_the_schema() -> None:
    published = key_paths(schema("rig"))
    # A quantity is one row.
    published = {k: v for k, v in published.items() if not k.endswith((".value", ".std"))}
    assert {key: row[0] == "●" for key, row in stated("rig").items()} == published


def defaults(node: dict[str, Any], root: dict[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    """Every scalar default of a schema, by its key's path."""
    for member in [node, *node.get("anyOf", ())]:
        here = root["$defs"][member["$ref"].rsplit("/", 1)[1]] if "$ref" in member else member
        for key, value in here.get("properties", {}).items():
            full = f"{path}.{key}".removeprefix(".")
            if isinstance(value.get("default"), (str, int, float)):
                yield full, value["default"]
            yield from defaults(value, root, full)


def test_defaults_are_those_of_the_schema() -> None:
    rig = schema("rig")
    published = dict(defaults(rig, rig, ""))
    assert len(published) >= 15
    for key, value in published.items():
        cell = stated("rig")[key][1]
        assert (cell if isinstance(value, str) else float(cell)) == value, key


def test_generated_tables_are_those_of_the_program() -> None:
    assert generated(text("reference")) == text("reference")
    for option in OF_THE_PROGRAM:
        assert f"`{option}`" in section("reference", "## Commands")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_says_the_same_in_python_and_in_the_help(name: str) -> None:
    """Its first sentence, and every parameter's help."""
    command = described(name)
    doc = str(command.function.__doc__)
    assert doc.startswith(COMMANDS[name][1])
    shown = {p.name: p.help for p in made(name).params}
    for p in command.parameters:
        assert shown[p.name] == p.option.sentence
        assert f"    {p.name} : {p.option.help}" in doc


def test_exit_statuses_are_those_of_the_errors() -> None:
    rows = re.findall(r"^\| (\d+) \| (.+?) \|", section("reference", "## Exit statuses"), re.M)
    meaning = {int(status): words for status, words in rows}
    assert {UsageError.exit_status, RigError.exit_status} == {2}
    assert "usage" in meaning[2]
    assert "rig file" in meaning[2]
    assert "data" in meaning[DataError.exit_status]
    assert NotIdentifiableError.exit_status == NotConvergedError.exit_status
    assert "determine" in meaning[NotIdentifiableError.exit_status]


def test_limits_of_logs() -> None:
    words = " ".join(section("reference", "## Log files").split())
    for said in (
        f"a chunk of more than {MAX_CHUNK >> 20} MiB",
        f"steps back by up to {clock.MAX_STEP_BACK:g} s",
        f"by more than {clock.MAX_SKEW:g} s are counted",
        f"Above {DwellOptions().max_bins:,} bins",
    ):
        assert said in words
    assert clock.MAX_DROPPED == 1 / 1000
    assert clock.GAP == 5
