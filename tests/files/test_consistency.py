"""One number of a calibration file moved beyond rounding: refused at its place, and only then."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic_core import PydanticCustomError
from scipy import stats

from tdfscal.files.calibration.consistency import check
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parameters import parameters_document
from tdfscal.files.rig.reading import parse_rig
from tdfscal.model.calibrated import independent
from tdfscal.records import UncertainValue

from .sample_documents import RIG, SCALED_CONVENTION, calibration

Place = tuple[str | int, ...]


def place_of(check: Callable[..., object], *given: Any) -> Place:
    """Where a check finds a fault."""
    with pytest.raises(PydanticCustomError) as refused:
        check(*given)
    assert refused.value.context is not None
    assert refused.value.context["hint"]
    return tuple(refused.value.context["place"])


def whole() -> Calibration:
    """A file with the block of all parameters, made from closed forms."""
    loaded = parse_rig(RIG.encode(), "rig.yaml")
    content = calibration(dict(loaded.document))
    found = Calibration.model_validate(content)
    rng = np.random.default_rng(6)
    scale = 1e-3 * rng.normal(size=(3, 6))
    block = independent(
        loaded.rig,
        found.rotation,
        found.rotation_covariance,
        zero=UncertainValue(found.zero, np.array([[0.1, 0.2, 1 / 3]] * 3)),
        mass=UncertainValue(np.asarray(500.1), np.asarray(0.1)),
        barycentre=UncertainValue(np.array([0.01, -0.015, 0.25]), np.array([1e-5, 1e-4, 1e-3])),
        sensitivity=scale,
    )
    block = replace(block, covariance=block.covariance + 1e-12 * np.eye(len(block.covariance)))
    block.covariance[:9, :9] -= 1e-12 * np.eye(9)
    for support, (xx, yy, zz, yz, xz, xy) in zip(content["supports"], scale, strict=True):
        support["sensitivity"] = [[1 + xx, xy, xz], [xy, 1 + yy, yz], [xz, yz, 1 + zz]]
        support["zero_std"] = [np.hypot(s, 1e-6) for s in (0.1, 0.2, 1 / 3)]
    # The sensor without a y axis has no zero there.
    content["supports"][1]["zero"][1] = content["supports"][1]["zero_std"][1] = None
    content["convention"] = SCALED_CONVENTION
    content["parameters"] = parameters_document(block)
    content["terminal"]["mass"]["std"] = float(np.hypot(0.1, 1e-6))
    bary = content["terminal"]["barycenter"]
    bary["std"] = [float(np.hypot(s, 1e-6)) for s in bary["std"]]
    return Calibration.model_validate(content)


WHOLE = whole()


def altered(*place: str | int, by: float = 0.0, to: Any = None) -> Calibration:
    """The file with one number moved, or set, past the checks of its model."""

    def within(node: Any, rest: Place) -> Any:
        if not rest:
            return node + by if to is None else to
        head, *tail = rest
        if isinstance(head, str) and not isinstance(node, dict):
            changed = within(getattr(node, head), tuple(tail))
            return node.model_copy(update={head: changed})
        out = dict(node) if isinstance(node, dict) else list(node)
        out[head] = within(out[head], tuple(tail))  # type: ignore[index]
        return out if isinstance(node, dict) else tuple(out)

    changed: Calibration = within(WHOLE, place)
    return changed


REDUNDANT = [
    # number, by how much, the place that is named
    (("supports", 2, "zero", 1), 5e-9, ("supports", 2, "zero")),
    (("supports", 0, "zero_std", 2), 1e-5, ("supports", 0, "zero_std")),
    (("supports", 1, "sensitivity", 0, 0), 1e-7, ("supports", 1, "sensitivity")),
    (("supports", 2, "sensitivity", 1, 2), 1e-7, ("supports", 2, "sensitivity")),
    (("terminal", "mass", "value"), 1e-5, ("terminal", "mass", "value")),
    (("terminal", "mass", "std"), 1e-5, ("terminal", "mass", "std")),
    (("terminal", "barycenter", "value", 1), 1e-7, ("terminal", "barycenter", "value")),
    (("terminal", "barycenter", "std", 2), 1e-5, ("terminal", "barycenter", "std")),
    (("fit", "p_value"), 1e-7, ("fit", "p_value")),
    (("fit", "birge"), 1e-7, ("fit", "birge")),
    (("fit", "chi2"), 1e-3, ("fit", "p_value")),
    (("fit", "dof"), 1, ("fit", "p_value")),
    (("parameters", "value", 9), 1e-2, ("supports", 0, "zero")),
    (("budget", "angles", 2, "variance", "noise"), 1e-9, ("budget", "angles", 2, "variance")),
    (("supports", 2, "rpy_interval", "high", 0), 1e-4, ("supports", 2, "rpy_interval")),
]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("number", "by", "named"), REDUNDANT)
def test_a_number_that_moved_is_found_at_its_place(
    number: Place, by: float, named: Place, sign: int
) -> None:
    assert place_of(check, altered(*number, by=sign * by)) == named


@pytest.mark.parametrize(
    ("number", "by"),
    [
        (("supports", 2, "zero", 1), 1e-10),
        (("supports", 1, "rpy", 1), 1e-10),
        (("supports", 1, "quaternion_xyzw", 3), 1e-10),
        (("supports", 0, "zero_std", 2), 1e-8),
        (("supports", 1, "sensitivity", 0, 0), 1e-10),
        (("terminal", "mass", "value"), 1e-8),
        (("fit", "p_value"), 1e-11),
    ],
)
def test_rounding_is_no_edit(number: Place, by: float) -> None:
    check(altered(*number, by=by))


def test_an_open_zero_has_no_standard_uncertainty_to_compare() -> None:
    check(altered("supports", 0, "zero_std", 1, to=None))
    zero = altered("supports", 0, "zero_std", 1, to=0.5)
    assert place_of(check, zero) == ("supports", 0, "zero_std")


def test_an_axis_that_is_not_measured_has_no_zero_to_compare() -> None:
    assert WHOLE.supports[1].zero[1] is None
    there = altered("supports", 1, "zero", 1, to=0.7)
    assert place_of(check, there) == ("supports", 1, "zero")


def test_a_fit_without_degrees_of_freedom_states_no_p_value() -> None:
    fit = WHOLE.fit
    assert fit is not None
    none = fit.model_copy(update={"chi2": 0.0, "dof": 0, "p_value": 1.0, "birge": 1.0})
    check(WHOLE.model_copy(update={"fit": none}))
    p = stats.chi2.sf(150.0, 160)
    other = fit.model_copy(
        update={"chi2": 150.0, "dof": 160, "p_value": p, "birge": np.sqrt(150 / 160)}
    )
    check(WHOLE.model_copy(update={"fit": other}))
