"""How numbers are written: one law for text, pages and figures."""

import re
from collections.abc import Callable

import pytest

from tdfscal.catalogue.numbers import measured, p_text, typeset, with_std
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.html import render as as_page
from tdfscal.reporting.layout import Report
from tdfscal.reporting.several import Several, several_report
from tdfscal.reporting.text import render as as_text
from tdfscal.reporting.traceability import Making
from tdfscal.reporting.validation import validation_report
from tests.reporting.samples import sample, surveyed, with_load_cell
from tests.reporting.test_figures import KINDS, words
from tests.reporting.test_page import read
from tests.reporting.test_several import FEBRUARY, JANUARY, MARCH
from tests.reporting.test_validation_claim import validation as tared
from tests.reporting.test_validation_page import origin_of_check, validation

SEVERAL = Several.of([("j", JANUARY), ("f", FEBRUARY), ("m", MARCH)])
REPORTS: dict[str, Callable[[], Report]] = {
    "touched": lambda: calibration_report(sample(touched=True).calibration),
    "six supports": lambda: calibration_report(sample(n=6).calibration),
    "load cell": lambda: calibration_report(with_load_cell()),
    "tracker": lambda: calibration_report(surveyed()[0]),
    "joint": lambda: calibration_report(surveyed()[1]),
    "several": lambda: several_report(SEVERAL, Making("", ())),
    "valid": lambda: validation_report(validation(0.0), (), origin_of_check()),
    "touched since": lambda: validation_report(validation(60.0), (), origin_of_check()),
    "turned since": lambda: validation_report(tared(8e-3), ()),
}


def check(said: str, other_minus: str) -> None:
    """Two digits behind each ±, chances of two digits, no exponent, and one minus."""
    assert not re.search(rf"(?<![\w.)]){other_minus}\d+(\.\d+)?[\s,)]", said)
    without_digests = re.sub(r"\b[0-9a-f]{8}(?:[0-9a-f]{56})?\b", "", said)
    assert not re.search(r"\d[eE][-−+]?\d\d\b", without_digests)
    for number in re.findall(r"±\s?\(?(\d[\d.]*)", said):
        digits = number.replace(".", "").strip("0") if "." not in number else number
        assert len(digits.replace(".", "").lstrip("0")) <= 2, number
    for chance in re.findall(r"\bp = (\S*\d)", said):
        assert re.fullmatch(r"0\.(\d\d|0\d\d?|00\d\d?)", chance), chance


@pytest.mark.parametrize("kind", REPORTS)
def test_text_and_page_write_numbers_alike(kind: str) -> None:
    report = REPORTS[kind]()
    check(as_text(report), "−")
    page = re.sub(r"<code>.*?</code>", "", as_page(report))
    check(" ".join(read(page).words[1:]), "-")


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "tracker"])
def test_so_do_figures(kind: str) -> None:
    shown = [said for _, drawn, _ in words(kind).values() for said, _ in drawn]
    check(" \n ".join(shown), "-")
    assert any("−" in said for said in shown)


def test_values_and_uncertainties_end_at_the_same_place() -> None:
    assert with_std(-1.96912, 0.5104) == "-1.97 ± 0.51"
    assert with_std(12345.6, 1234.0, "+") == "+12300 ± 1200"
    assert with_std(-0.0001, 0.0996) == "0.00 ± 0.10"
    assert [p_text(p) for p in (0.9991, 0.5, 0.0648, 0.00126, 9e-4)] == [
        "p > 0.99", "p = 0.50", "p = 0.065", "p = 0.0013", "p < 0.001"
    ]  # fmt: skip


def test_what_is_no_number_keeps_its_hyphen() -> None:
    for said in ("2026-11-24", "RH-02", "`--at -0.1,0,2`", "campaign-3.yaml", "1 -1@x"):
        assert typeset(said) == said
    assert typeset("from -3 to (-0.5, 2)") == "from −3 to (−0.5, 2)"
    assert typeset(typeset("-3%"), "-") == "-3\u00a0%"


@pytest.mark.parametrize(
    ("size", "said"),
    [
        (0.3, "0.300"),
        (12.0, "12.0"),
        (1234.5, "1230"),
        (2e-7, "0.000000200"),
        (1e300, "1.00·10^300"),
    ],
)
def test_what_was_measured_keeps_its_zeros_and_has_no_exponent(size: float, said: str) -> None:
    assert measured(size, 3) == said
