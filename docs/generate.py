"""Write the schemas, what the program says of itself into the reference, the front page's picture.

`python docs/generate.py`. Between `<!-- generated: NAME -->` and `<!-- end -->` stands what the
function of that name makes; `angles.png` shows the angles of the sample campaign.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from string import Formatter
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

import tdfscal
from tdfscal.catalogue import CATALOGUE
from tdfscal.cli.app import COMMANDS, PRINTED, described, summary
from tdfscal.commands.options import Described
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.field_types import Strict
from tdfscal.files.points.reading import PointFile
from tdfscal.files.rig.model import RigFile
from tdfscal.findings import Severity

HERE = Path(__file__).parent
PAGE = Path(__file__).with_name("reference.md")
#: Commands from which on an option is told once for all.
_SEVERAL = 3
#: Columns of a line of a schema, beside its key.
_WIDTH = 84
#: Words of a finding in the list of all.
_GLOSS = 7
_MODELS: dict[str, tuple[type[BaseModel], str]] = {
    "rig": (RigFile, "tdfscal rig file (rig.yaml)"),
    "calibration": (Calibration, "tdfscal calibration file, and what `calibrate --json` prints"),
    "points": (PointFile, "tdfscal point file"),
}
_BLOCK = re.compile(r"(<!-- generated: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


class _WithoutTitles(GenerateJsonSchema):
    """A field's generated title only repeats its key."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


def schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON Schema of each file format by its file name."""
    for part in Strict.__subclasses__():
        part.model_rebuild()  # pydantic before 2.14 writes no default of a block that is not built
    return {
        f"{name}.schema.json": {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "$id": f"urn:tdfscal:schema:{name}:1",
            **model.model_json_schema(schema_generator=_WithoutTitles),
            "title": title,
        }
        for name, (model, title) in _MODELS.items()
    }


def laid_out(value: Any, indent: str = "") -> str:
    """Return JSON with what is short on one line."""
    line = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(line) <= _WIDTH or not isinstance(value, dict | list):
        return line
    deeper = f"{indent}  "
    if isinstance(value, list):
        opened, inner, closed = "[", [laid_out(each, deeper) for each in value], "]"
    else:
        told = ((json.dumps(k, ensure_ascii=False), laid_out(v, deeper)) for k, v in value.items())
        opened, inner, closed = "{", [f"{key}: {each}" for key, each in told], "}"
    return f"{opened}\n{deeper}{f',{chr(10)}{deeper}'.join(inner)}\n{indent}{closed}"


def commands() -> Iterator[str]:
    """Yield the options that several commands share, then every command with its own."""
    named = {name: described(name).parameters for name in COMMANDS}
    told = Counter(_option(p) for each in named.values() for p in each if not p.positional)
    shared = sorted(line for line, times in told.items() if times >= _SEVERAL)
    yield "\nOptions of several commands:\n\n"
    printed = (f"- {_flags(each.param_decls)}: {each.help}\n" for each in PRINTED.values())
    yield from sorted([*shared, *printed])
    for name in COMMANDS:
        given = "".join(f" {p.metavar}" for p in named[name] if p.positional)
        options = [p for p in named[name] if not p.positional]
        needed = "".join(f" {p.names[-1]} {_values(p)}" for p in options if p.default is ...)
        yield f"\n### tdfscal {name}\n\n{summary(name)}\n\n    tdfscal {name}{given}{needed}\n\n"
        yield from (line for p in options if (line := _option(p)) not in shared)
        also = [f"`{p.names[0]}`" for p in options if _option(p) in shared]
        yield f"- also {', '.join(also)}\n" if also else ""
    yield "\n"


def _values(p: Described) -> str:
    """What an option takes, in a word; nothing where it is on or off."""
    return "|".join(p.words) or p.metavar or ("" if p.kind is bool else "N")


def _option(p: Described) -> str:
    value = f" `{_values(p)}`" if _values(p) else ""
    plain = isinstance(p.default, str | int | float) and not isinstance(p.default, bool)
    default = f" ({p.default})" if plain else ""
    return f"- {_flags(p.names)}{value}{default}: {p.sentence}\n"


def _flags(flags: Iterable[str]) -> str:
    return ", ".join(f"`{flag}`" for flag in flags)


def findings() -> Iterator[str]:
    """Yield the catalogue of findings by severity, each with the beginning of what it says."""
    for severity in get_args(Severity):
        yield f"\n**{severity}**\n\n"
        if severity == "refuses":  # the error itself says what, where, and what to do
            yield f"{', '.join(f'`{code}`' for code in sorted(_codes(severity)))}\n"
            continue
        for code, entry in sorted(CATALOGUE.items()):
            if entry.severity == severity:
                yield f"- `{code}`: {_beginning(_plain(entry.sentence))}\n"
    yield "\n"


def _codes(severity: Severity) -> Iterator[str]:
    return (code for code, entry in CATALOGUE.items() if entry.severity == severity)


def _beginning(text: str) -> str:
    text = text.rpartition("may as well mean that ")[2]
    words = re.split("[:;]| \\(|, (?:which|and|or|as if|by) ", text)[0].split()
    return " ".join(words[:_GLOSS]) + (" …" if len(words) > _GLOSS else "")


def rig() -> Iterator[str]:
    """Yield the keys of the rig file, with units and defaults; a quantity is one row."""
    yield "\n"
    for path, needed, value in _keys("rig"):
        if path.endswith((".value", ".std")):
            continue
        unit, _, meaning = value["description"].partition(": ")
        if not meaning or (" " in unit and unit != "kg m²"):
            unit, meaning = "", value["description"]
        default = _shown(value.get("default", {}))
        besides = ", ".join(filter(None, (unit, default and f"default {default}")))
        yield f"- `{path}`{needed}{f' ({besides})' if besides else ''}: {meaning}\n"
    yield "\n"


def _shown(default: Any) -> str:
    """Return a default; nothing of a block's, and of what is not there."""
    if isinstance(default, list):
        return ", ".join(map(_shown, default))
    if isinstance(default, dict) or default is None:
        return ""
    return f"{default:g}" if isinstance(default, float) else str(default)


def points() -> Iterator[str]:
    """Yield the keys of a point file in JSON."""
    return _meanings("points")


def calibration() -> Iterator[str]:
    """Yield the keys of the calibration file; the schema says what those within a block mean."""
    return _meanings("calibration", "rig")


def _meanings(name: str, *closed: str) -> Iterator[str]:
    """Yield the keys at the top with their meanings, and the names one level below."""
    found = list(_keys(name, *closed))
    yield "\n"
    for path, needed, value in found:
        if "." in path:
            continue
        head = (f"{path}.", f"{path}[].")
        within = [one[len(path) :] for one, _, _ in found if one.startswith(head)]
        inside = [f"`{key}`" for key in within if key.removeprefix("[]").count(".") == 1]
        names = f"; {', '.join(dict.fromkeys(inside))}" if inside else ""
        yield f"- `{path}`{needed}: {value['description']}{names}\n"
    yield "\n"


def _keys(name: str, *closed: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield every key of a schema as `a.b[].c`, whether its object requires it (●), and itself.

    closed : keys that are not entered. NAME stands for the free keys of a mapping.
    """
    schema = schemas()[f"{name}.schema.json"]

    def below(node: dict[str, Any], path: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
        either = node.get("anyOf", ())
        # Of a block or a list of such blocks, the block.
        either = [one for one in either if one.get("items") not in either]
        for member in [node, *either]:
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


def picture(path: Path) -> None:
    """Draw the angles of the sample campaign into a PNG."""
    sample = HERE.parent / "sample_data" / "csv"
    tdfscal.calibrate(sample, trials=0).plot("angles").savefig(path, dpi=110)


if __name__ == "__main__":
    for file, schema in schemas().items():
        (HERE.parent / "schemas" / file).write_text(laid_out(schema) + "\n", "utf-8")
    picture(HERE / "angles.png")
    PAGE.write_text(generated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
