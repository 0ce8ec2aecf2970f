"""The HTML page: one file, nothing from outside, verdict first, nothing unescaped."""

import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import pytest

from tdfscal.catalogue.numbers import places, to_place
from tests.reporting.pages import render_page
from tests.reporting.samples import sample, sketch, with_load_cell

VOID = {"meta", "br", "link", "img"}


class Reader(HTMLParser):
    """Collects words, tags and attributes, and checks that tags close."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data.replace("\u00a0", " "))


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    reader.close()
    assert reader.open == []
    return reader


@pytest.fixture(scope="module")
def page() -> str:
    return render_page(sample(touched=True).calibration)


def test_nothing_comes_from_outside(page: str) -> None:
    reader = read(page)
    assert not {"script", "link", "iframe", "object", "img"} & set(reader.tags)
    for name, value in reader.attributes:
        if name in ("href", "xlink:href"):
            assert value.startswith(("#", "data:image/png"))
        assert name != "src"
        assert not name.startswith("on")
    assert "@import" not in page
    assert not re.search(r"url\((?!#)", page)


def test_each_svg_is_sound_and_its_identifiers_are_its_own(page: str) -> None:
    seen: set[str] = set()
    for svg in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        root = ET.fromstring(svg)
        own = {e.get("id", "") for e in root.iter()} - {""}
        assert own
        assert not own & seen
        seen |= own
        used = set(re.findall(r"url\(#([^)]+)\)", svg)) | set(re.findall(r'href="#([^"]+)"', svg))
        assert used <= own


@pytest.mark.parametrize("axes", ["z", pytest.param("", marks=pytest.mark.slow)])
def test_a_sensor_without_angles_spoils_no_page(axes: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sketch(monkeypatch)
    c = with_load_cell(axes)
    assert c.undetermined == ("support_4",)
    page = render_page(c)
    reader = read(page)
    assert reader.tags.count("svg") == 3
    said = " ".join(reader.words)
    assert not re.search(r"\b(inf|nan|None)\b", said)
    half = 1e3 * c.half_widths.max()
    known = f"within ± {to_place(half, places(half))} mrad (95 %)"
    assert f"each that is determined is known to {known}" in said
    assert re.search(r"support_4\s+undetermined", said)
