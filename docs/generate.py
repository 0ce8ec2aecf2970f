"""Write what the program says of itself into the reference: `python docs/generate.py`.

Between `<!-- generated: NAME -->` and `<!-- end -->` stands what the function of that name makes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from string import Formatter
from typing import Any

from tdfscal.catalogue import CATALOGUE
from tdfscal.cli.app import COMMANDS, described
from tdfscal.files.schema import schemas

PAGE = Path(__file__).with_name("reference.md")
_BLOCK = re.compile(r"(<!-- generated: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def commands() -> Iterator[str]:
    """Yield every command with a table of its options."""
    for name, (_, text) in COMMANDS.items():
        parameters = described(name).parameters
        given = "".join(f" {p.option.metavar}" for p in parameters if p.positional)
        options = [p for p in parameters if not p.positional]
        needed = "".join(f" {p.flags[-1]} {p.values}" for p in options if p.default is ...)
        yield f"\n### tdfscal {name}\n\n{text}\n\n    tdfscal {name}{given}{needed}\n"
        yield "\n| option | value | default | meaning |\n|---|---|---|---|\n"
        for p in options:
            names = ", ".join(f"`{flag}`" for flag in p.flags)
            value = "`{}`".format(p.values.replace("|", "`, `")) if p.values else ""
            default = p.default if isinstance(p.default, str | int | float) else ""
            shown = "" if isinstance(default, bool) else default
            yield f"| {names} | {value} | {shown} | {p.option.sentence} |\n"
    yield "\n"


def findings() -> Iterator[str]:
    """Yield the catalogue of findings as a table."""
    yield "\n| code | severity | says | cure |\n|---|---|---|---|\n"
    for code, entry in sorted(CATALOGUE.items()):
        says = entry.sentence + "".join(clause for _, clause in entry.clauses)
        cells = (f"`{code}`", entry.severity, _plain(says), _plain(entry.cure))
        yield f"| {' | '.join(cells)} |\n"
    yield "\n"


def rig() -> Iterator[str]:
    """Yield the keys of the rig file as a table, with units and defaults; a quantity is one row."""
    yield "\n| key | | default | unit | meaning |\n|---|---|---|---|---|\n"
    for path, needed, value in _keys("rig"):
        if path.endswith((".value", ".std")):
            continue
        unit, _, meaning = value["description"].partition(": ")
        if not meaning or (" " in unit and unit != "kg m²"):
            unit, meaning = "", value["description"]
        yield f"| `{path}` | {needed} | {_shown(value.get('default', {}))} | {unit} | {meaning} |\n"
    yield "\n"


def _shown(default: Any) -> str:
    """Return a default; nothing of a block's."""
    if isinstance(default, list):
        return ", ".join(map(_shown, default))
    if isinstance(default, dict):
        return ""
    return "none" if default is None else f"{default:g}" if isinstance(default, float) else default


def points() -> Iterator[str]:
    """Yield the keys of a point file in JSON as a table."""
    return _meanings("points")


def calibration() -> Iterator[str]:
    """Yield the keys of the calibration file as a table; those of its rig have one of their own."""
    return _meanings("calibration", "rig")


def _meanings(name: str, *closed: str) -> Iterator[str]:
    yield "\n| key | | meaning |\n|---|---|---|\n"
    for path, needed, value in _keys(name, *closed):
        yield f"| `{path}` | {needed} | {value['description']} |\n"
    yield "\n"


def _keys(name: str, *closed: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield every key of a schema as `a.b[].c`, whether its object requires it (●), and itself.

    closed : keys that are not entered. NAME stands for the free keys of a mapping.
    """
    schema = schemas()[f"{name}.schema.json"]

    def below(node: dict[str, Any], path: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
        either = node.get("anyOf", ())
        # Of a block or a list of such blocks, the block.
        blocks = [one["oneOf"][0] for one in either if "oneOf" in one]
        for member in [node, *either, *blocks]:
            here = schema["$defs"][member["$ref"].rsplit("/", 1)[1]] if "$ref" in member else member
            if isinstance(here.get("items"), dict):
                yield from below(here["items"], f"{path}[]")
            free = [here.get("additionalProperties"), *here.get("patternProperties", {}).values()]
            for each in free:
                if isinstance(each, dict):
                    yield from below(each, f"{path}.NAME")
            for key, value in here.get("properties", {}).items():
                full = f"{path}.{key}".removeprefix(".")
                yield full, "●" if key in here.get("required", ()) else "", value
                if full not in closed:
                    yield from below(value, full)

    return below(schema, "")


def _plain(template: str) -> str:
    """Return a template without the formats of its fields."""
    parts = []
    for text, name, spec, _ in Formatter().parse(template):
        parts.append(text)
        if name is not None:
            both = (spec or "").split("|")
            said = both[0].replace("~", f"‹{name}›") if len(both) > 1 else f"‹{name}›"
            parts.append(said)
    return "".join(parts).replace("|", "or")


def generated(page: str) -> str:
    """Return the page with every block made anew."""
    return _BLOCK.sub(lambda m: m[1] + "".join(globals()[m[2]]()) + m[3], page)


if __name__ == "__main__":
    PAGE.write_text(generated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
