"""Hostile names through every field into every output: each parses and says the same string."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any
from xml.dom import minidom

import numpy as np
import pytest
import yaml

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


@cache
def content() -> dict[str, Any]:
    return sample(touched=True).calibration.model_dump()


@cache
def poisoned(line: str, wild: str) -> Calibration:
    """A calibration with the text in every field that takes one, each marked by its place."""
    c = json.loads(json.dumps(content()))
    c["rig"] |= {"name": f"rig {line}"}
    c["software"] = {"name": f"software {line}", "version": f"version {line}"}
    c["findings"] = [found(f"warning {line}")]
    c["observability"]["verdict"] = f"verdict {line}"
    c["fit"]["rejected"][0]["reason"] = f"rejected {line}"
    c["status"] = "rejected"
    c["findings"].append(found(f"reason {line}", "rejects"))
    old = c["budget"]["sources"][0]
    c["budget"]["sources"][0] = f"source {line}"
    for angle in c["budget"]["angles"]:
        angle["variance"][f"source {line}"] = angle["variance"].pop(old)
    c["command"] = f"command {wild}"
    c["inputs"][0]["path"] = f"folder/path {wild}"
    return Calibration.model_validate(c)


#: Each string stands once, in the place of a line or of a name.
CASES = list(zip(LINES, WILD[len(WILD) // 2 :], strict=False))
EACH = pytest.mark.parametrize(("line", "wild"), CASES, ids=[ascii(wild) for _, wild in CASES])


def squeezed(text: str) -> str:
    """Without the white space that a layout may change."""
    return "".join(text.split())


def said(line: str, wild: str, *, table: bool = True) -> Iterator[str]:
    """What every report must show."""
    for place in ("rig", "warning", "verdict", "rejected", "reason"):
        yield squeezed(visible(f"{place} {line}"))
    if table:
        yield squeezed(visible(f"path {wild}")).rsplit("/", 1)[-1]


def no_controls(text: str) -> None:
    assert all(letter.isprintable() for letter in text.replace("\n", ""))


def test_files_of_ours_read_back() -> None:
    c = poisoned(LINES[0], WILD[-1])
    files = [c.inputs[0].model_dump() | {"path": wild} for wild in WILD]
    c = changed(c, status="accepted", findings=tuple(map(found, LINES)), inputs=files)
    for form, parse in (("json", json.loads), ("yaml", yaml.safe_load)):
        text = dump_calibration(c, form)  # type: ignore[arg-type]
        document = parse(text)
        assert texts(document) == list(LINES)
        assert [entry["path"] for entry in document["inputs"]] == list(WILD)
        assert parse_calibration(text.encode(), "x") == c


@EACH
def test_text_and_page(line: str, wild: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")
    c = poisoned(line, wild)
    text = render(calibration_report(c))
    no_controls(text)
    page = render_page(c)
    words = " ".join(read(page).words)
    no_controls(words)
    for expected in said(line, wild):
        assert expected in squeezed(text)
    for expected in said(line, wild):  # in a sentence `x` is set as code, which needs no quotes
        assert expected.replace("`", "") in squeezed(words).replace("`", "")
    assert squeezed(visible(f"command {wild}")) in squeezed(words)
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


@EACH
def test_exports(line: str, wild: str) -> None:
    c = poisoned(line, wild)
    robot = FORMATS["urdf"](c, "base")
    assert f"rig {line}" in unescaped(comments(robot))
    assert ET.fromstring(robot).get("name") == "_".join(xml(f"rig {line}").split())
    assert f"rig {line}" in unescaped(FORMATS["ros"](c, "base").splitlines()[0])
    assert len(yaml.safe_load(FORMATS["ros"](c, "base"))) == 3
    rows = list(csv.DictReader(io.StringIO(FORMATS["csv"](c, "base"))))
    assert [row["sensor"] for row in rows] == list(c.support_names)


def xml(text: str) -> str:
    """The same where XML 1.0 holds every character, else with those escaped."""
    return "".join(
        visible(ch) if (ord(ch) < 32 and ch not in "\t\n") or ch in "\ufffe\uffff" else ch
        for ch in text
    )


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_c_headers_compile_and_name_the_rig(tmp_path: Path) -> None:
    flags = ["-std=c99", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function"]
    names = []
    for k, line in enumerate(LINES):
        text = FORMATS["c"](poisoned(line, "x"), "base")
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
    written = draft(
        text,
        RigSketch(
            hinge=np.zeros((3, 3)),
            spread=0.0,
            mass=500.0,
            barycentre=np.zeros(2),
            nominal_rpy=np.zeros((3, 3)),
            upright=(True,) * 3,
            reference=0,
        ),
        {"mass": "x", "hinge": "y", "nominal_rpy": "z"},
        log,
        [f"the unit is taken from {text}"],
    )
    document = yaml.safe_load(written)
    assert document["name"] == text
    assert [support["name"] for support in document["supports"]] == list(log["supports"])
    assert document["log"]["supports"] == log["supports"]
    assert document["log"]["time"]["field"] == f"time {text}"
    assert document["log"]["delay"] == {"value": 0.0, "std": 0.005}
    assert len(document) == 8
