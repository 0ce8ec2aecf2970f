"""Contrasts of two parts, by closed forms."""

import numpy as np
import pytest

from tdfscal.numerics.information import Information, contrast

AXES = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]


def known(std: list[float], mean: list[float]) -> Information:
    """Independent along the axes."""
    matrix = (AXES / np.square(std)) @ AXES.T
    return Information(matrix, matrix @ AXES @ np.array(mean))


def test_difference_over_its_variance_where_both_know_something() -> None:
    rest = known([1.0, 2.0, 1e-2], [0.0, 0.0, 0.0])
    part = known([2.0, 1.0, 1e6], [3.0, 1.0, 1e9])
    chi2, dof = contrast(rest, part).chi2()
    assert dof == 2
    assert chi2 == pytest.approx(3.0**2 / 5 + 1.0**2 / 5)


def test_what_a_part_adds_less_than_a_hundredth_to_what_is_stated_is_not_tested() -> None:
    stated = known([10.0, 10.0, 1.0], [0.0, 0.0, 0.0])
    rest = stated + known([0.1, 0.1, 50.0], [0.0, 0.0, 0.0])
    part = known([2.0, 2.0, 11.0], [2.0, 0.0, 400.0])
    assert contrast(rest, part).chi2()[0] > 1000
    departure = contrast(rest, part.beside(stated))
    chi2, dof = departure.chi2()
    assert dof == 2  # although the rest knows the first two 400 times as well as the part
    variance = 1 / (1 / 100 + 1 / 0.01) + 4
    assert chi2 == pytest.approx(4 / variance, rel=1e-3)
    assert departure.chi2(slice(0, 3))[1] == 2


def test_a_change_takes_its_own_share_of_the_misfit() -> None:
    rest, part = known([0.1] * 3, [0.0] * 3), known([0.1] * 3, [0.0] * 3)
    moved = Information(part.matrix, part.score + part.matrix @ np.array([1.0, 0.0, 0.0]))
    departure = contrast(rest, moved)
    assert departure.left(slice(0, 1))[0] == pytest.approx(0.0, abs=1e-9)
    assert departure.left(slice(1, 3))[0] == pytest.approx(1 / 0.02)
    size, covariance = departure.change(slice(0, 1))
    assert size == pytest.approx([1.0])
    assert covariance == pytest.approx(np.array([[0.02]]))
