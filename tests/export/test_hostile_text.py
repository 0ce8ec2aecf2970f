"""Hostile names through every field into every output: each parses and says the same string."""

import csv
import io
import json
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any
from xml.dom import minidom

import numpy as np
import pytest
import yaml

from tdfscal.catalogue.numbers import typeset
from tdfscal.checks.rig_from_log import RigSketch
from tdfscal.errors import visible
from tdfscal.exports import FORMATS
from tdfscal.files.calibration.document import Calibration, dump_calibration, parse_calibration
from tdfscal.files.rig.draft import draft
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.text import render
from tests.reporting.pages import render_page
from tests.reporting.samples import changed, sample
from tests.reporting.test_page import read
from tests.words import found, texts

LINES = (
    *("a\u2028b", "a\x85b", "a\ufeffb", "a\uffffb", "\U0001f600", "\u202eevil\u202c", "---", "-->"),
    *("]]>", "*/ int x; /*", "ends in \\", "=cmd|'/c calc'!A1", "x,=1+1", "-1", "@SUM(A1)", '"'),
    *("<script>alert(1)</script>", "&amp;&#x41;", "{{ 7*7 }}{% x %}", "%s {0} $(x) `x`"),
    *("# x: y", "key: [a, b", "[red]x[/red]"),
)  # fmt: skip
#: What a file's name or a command line may hold besides, a line of text may not.
WILD = (*LINES, "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "a\nb", "a\r\n- b: 1", "\x07\b", "tab\tb")
#: All of them in one line of text, and in what may be anything.
LINE, ANYTHING = " ".join(LINES), " ".join(WILD)


def poisoned(line: str = LINE, wild: str = ANYTHING) -> Calibration:
    """A calibration with the text in every field that takes one, each marked by its place."""
    c: dict[str, Any] = json.loads(json.dumps(sample(touched=True).calibration.model_dump()))
    c["rig"] |= {"name": f"rig {line}"}
    c["software"] = {"name": f"software {line}", "version": f"version {line}"}
    c["observability"]["verdict"] = f"verdict {line}"
    c["fit"]["rejected"][0]["reason"] = f"rejected {line}"
    c["status"] = "rejected"
    c["findings"] = [found(f"warning {line}"), found(f"reason {line}", "rejects")]
    old = c["budget"]["sources"][0]
    c["budget"]["sources"][0] = f"source {line}"
    for angle in c["budget"]["angles"]:
        angle["variance"][f"source {line}"] = angle["variance"].pop(old)
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
        expected = visible(f"{place} {LINE}")
        assert squeezed(expected) in squeezed(text)
        # In a sentence `x` is set as code, which needs no quotes, and -1 as a number.
        assert squeezed(typeset(expected)).replace("`", "") in squeezed(words).replace("`", "")
    assert squeezed(visible(f"command {ANYTHING}")) in squeezed(words)
    assert "<script" not in page


def comments(text: str) -> str:
    """The comments of an XML document."""
    nodes = minidom.parseString(text.encode()).childNodes
    return " ".join(node.data for node in nodes if node.nodeType == node.COMMENT_NODE)


def unescaped(text: str) -> str:
    """The string behind the escapes of a comment."""
    return re.sub(
        r"\\(?:x[0-9a-f]{2}|u[0-9a-f]{4}|U[0-9a-f]{8}|[nrt])",
        lambda m: m[0].encode().decode("unicode_escape"),
        text,
    )


@pytest.mark.parametrize("line", LINES, ids=ascii)
def test_exports(line: str) -> None:
    c = poisoned(line)
    robot = FORMATS["urdf"](c, "base")
    assert f"rig {line}" in unescaped(comments(robot))
    # Where XML 1.0 lacks a letter, it stands escaped.
    name = "".join(visible(letter) if letter in "\ufffe\uffff" else letter for letter in line)
    assert ET.fromstring(robot).get("name") == "_".join(f"rig {name}".split())
    broadcasters = FORMATS["ros"](c, "base")
    assert f"rig {line}" in unescaped(broadcasters.splitlines()[0])
    assert len(yaml.safe_load(broadcasters)) == 3
    rows = list(csv.DictReader(io.StringIO(FORMATS["csv"](c, "base"))))
    assert [row["sensor"] for row in rows] == list(c.support_names)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_c_headers_compile_and_name_the_rig(tmp_path: Path) -> None:
    flags = ["-std=c99", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function"]
    names = []
    for k, line in enumerate(LINES):
        text = FORMATS["c"](poisoned(line), "base")
        assert f"rig {line}" in unescaped(text.splitlines()[1])
        no_controls(text)
        (tmp_path / f"{k}.c").write_text(text, encoding="utf-8")
        names.append(f"{k}.c")
    subprocess.run(["gcc", *flags, *names], cwd=tmp_path, check=True)


@pytest.mark.parametrize("text", WILD, ids=ascii)
def test_drafts_of_rig_files(text: str) -> None:
    fields = [f"{text} {axis}" for axis in "xyz"]
    log: dict[str, Any] = {
        "time": {"field": f"time {text}", "unit": "s"},
        "supports": {f"ncp {text} {i}": {"position": fields, "force": text} for i in range(3)},
    }
    nothing = np.zeros((3, 3))
    sketch = RigSketch(nothing, 0.0, 500.0, np.zeros(2), nothing, (True,) * 3, 0)
    notes = {"mass": "x", "hinge": "y", "nominal_rpy": "z"}
    document = yaml.safe_load(draft(text, sketch, notes, log, [f"the unit is taken from {text}"]))
    assert document["name"] == text
    assert [support["name"] for support in document["supports"]] == list(log["supports"])
    assert document["log"]["supports"] == log["supports"]
    assert document["log"]["time"]["field"] == f"time {text}"
    assert len(document) == 8
