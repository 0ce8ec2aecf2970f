"""How numbers are written: one law for text, pages and figures."""

import pytest

from tdfscal.catalogue.numbers import measured, p_text, typeset, with_std


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
