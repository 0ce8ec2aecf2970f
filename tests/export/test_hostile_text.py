"""Hostile names through every field into every output: each parses and says the same string."""

import csv
import io
import json
import re
import xml.etree.ElementTree as ET
from typing import Any
from xml.dom import minidom

import pytest
import yaml

from tdfscal.errors import visible
from tdfscal.exports import FORMATS
from tdfscal.files.calibration.document import Calibration, dump_calibration, parse_calibration
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.text import render
from tests.reporting.pages import render_page
from tests.reporting.samples import changed, sample
from tests.reporting.test_page import read
from tests.words import found, texts

LINES = (
    *("a\u2028b", "a\uffffb", "\u202eevil\u202c", "-->", "]]>", "*/ int x; /*", "ends in \\"),
    *("=cmd|'/c calc'!A1", '"', "<script>alert(1)</script>", "&amp;&#x41;", "{{ 7*7 }}{% x %}"),
    *("%s {0} $(x) `x`", "# x: y", "key: [a, b", "[red]x[/red]"),
)  # fmt: skip
#: What a file's name or a command line may hold besides, a line of text may not.
WILD = (*LINES, "\x1b[31mred\x1b[0m", "a\nb", "a\r\n- b: 1", "tab\tb")
LINE, ANYTHING = " ".join(LINES), " ".join(WILD)


def poisoned(line: str = LINE, wild: str = ANYTHING) -> Calibration:
    """A calibration with the text in fields that take one, each marked by its place."""
    c: dict[str, Any] = json.loads(json.dumps(sample(touched=True).calibration.model_dump()))
    c["rig"] |= {"name": f"rig {line}"}
    c["status"] = "rejected"
    c["findings"] = [found(f"warning {line}"), found(f"reason {line}", "rejects")]
    c["command"] = f"command {wild}"
    c["inputs"][0]["path"] = f"folder/path {wild}"
    return Calibration.model_validate(c)


def squeezed(text: str) -> str:
    """Without the white space that a layout may change."""
    return "".join(text.split())


def no_controls(text: str) -> None:
    assert all(letter.isprintable() for letter in text.replace("\n", ""))


def test_files_of_ours_read_back() -> None:
    c = poisoned()
    files = [c.inputs[0].model_dump() | {"path": wild} for wild in WILD]
    c = changed(c, status="accepted", findings=tuple(map(found, LINES)), inputs=files)
    for form, parse in (("json", json.loads), ("yaml", yaml.safe_load)):
        text = dump_calibration(c, form)  # type: ignore[arg-type]
        document = parse(text)
        assert texts(document) == list(LINES)
        assert [entry["path"] for entry in document["inputs"]] == list(WILD)
        assert parse_calibration(text.encode(), "x") == c


def test_text_and_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")
    c = poisoned()
    text, page = render(calibration_report(c)), render_page(c)
    words = " ".join(read(page).words)
    no_controls(text)
    no_controls(words)
    for place in ("rig", "warning", "reason"):
        expected = squeezed(visible(f"{place} {LINE}"))
        assert expected in squeezed(text)
        # In a sentence `x` is set as code, which needs no quotes.
        assert expected.replace("`", "") in squeezed(words).replace("`", "")
    assert squeezed(visible(f"command {ANYTHING}")) in squeezed(words)
    assert "<script" not in page


def unescaped(text: str) -> str:
    """The string behind the escapes of a comment."""
    escape = r"\\(?:x[0-9a-f]{2}|u[0-9a-f]{4}|U[0-9a-f]{8}|[nrt])"
    return re.sub(escape, lambda m: m[0].encode().decode("unicode_escape"), text)


def test_exports() -> None:
    for line in LINES:
        c = poisoned(line)
        said = {form: written(c, "base") for form, written in FORMATS.items()}
        nodes = minidom.parseString(said["urdf"].encode()).childNodes
        comments = " ".join(node.data for node in nodes if node.nodeType == node.COMMENT_NODE)
        assert f"rig {line}" in unescaped(comments)
        # Where XML 1.0 lacks a letter, it stands escaped.
        name = "".join(visible(letter) if letter == "\uffff" else letter for letter in line)
        assert ET.fromstring(said["urdf"]).get("name") == "_".join(f"rig {name}".split())
        assert f"rig {line}" in unescaped(said["ros"].splitlines()[0])
        assert len(yaml.safe_load(said["ros"])) == 3
        rows = list(csv.DictReader(io.StringIO(said["csv"])))
        assert [row["sensor"] for row in rows] == list(c.support_names)
