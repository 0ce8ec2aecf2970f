"""One number of a calibration file moved beyond rounding: refused at its place, and only then."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from scipy import stats

from tdfscal.files.calibration.document import Calibration

Place = tuple[str | int, ...]


def stated(kind: str) -> dict[str, Any]:
    """A file of 1.0 as of another program, without a digest."""
    path = Path(__file__).parent / "reference_1_0" / f"{kind}.json"
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    del content["content_sha256"]
    return content


#: With sensitivities and the block of all parameters.
WHOLE = stated("joint")


def altered(*changes: tuple[Place, Any]) -> dict[str, Any]:
    """The file with some of its values set."""
    content = copy.deepcopy(WHOLE)
    for (*path, last), value in changes:
        inner: Any = content
        for part in path:
            inner = inner[part]
        inner[last] = value
    return content


def moved(place: Place, by: float) -> dict[str, Any]:
    """The file with one number moved."""
    value: Any = WHOLE
    for part in place:
        value = value[part]
    return altered((place, value + by))


def refused(content: dict[str, Any]) -> tuple[Place, str]:
    """The place that is refused, and what is said of it."""
    with pytest.raises(ValidationError) as error:
        Calibration.model_validate(content)
    context = error.value.errors()[0]["ctx"]
    assert context["hint"]
    return tuple(context["place"]), context["said"]


REDUNDANT: list[tuple[Place, float, Place, str]] = [
    # number, by how much, the places that are named
    (("supports", 2, "zero", 1), 1e-8, ("supports", 2, "zero"), "parameters.value"),
    (("supports", 0, "zero_std", 2), 1e-5, ("supports", 0, "zero_std"), "parameters.matrix"),
    (
        ("supports", 1, "sensitivity", 0, 0),
        1e-7,
        ("supports", 1, "sensitivity"),
        "parameters.value",
    ),
    (
        ("supports", 2, "sensitivity", 1, 2),
        1e-7,
        ("supports", 2, "sensitivity"),
        "parameters.value",
    ),
    (("supports", 2, "turn_std", 0), 1e-8, ("supports", 2, "turn_std"), "covariance.matrix"),
    (
        ("supports", 2, "rpy_interval", "high", 0),
        1e-5,
        ("supports", 2, "rpy_interval"),
        "supports[2].rpy",
    ),
    (("terminal", "mass", "value"), 1e-5, ("terminal", "mass", "value"), "parameters.value"),
    (("terminal", "mass", "std"), 1e-5, ("terminal", "mass", "std"), "parameters.matrix"),
    (
        ("terminal", "barycenter", "value", 1),
        1e-7,
        ("terminal", "barycenter", "value"),
        "parameters.value",
    ),
    (
        ("terminal", "barycenter", "std", 2),
        1e-6,
        ("terminal", "barycenter", "std"),
        "parameters.matrix",
    ),
    (("fit", "p_value"), 1e-7, ("fit", "p_value"), "fit.chi2 and fit.dof"),
    (("fit", "birge"), 1e-7, ("fit", "birge"), "fit.chi2 and fit.dof"),
    (("fit", "chi2"), 1e-3, ("fit", "p_value"), "fit.chi2 and fit.dof"),
    (("fit", "dof"), 1, ("fit", "p_value"), "fit.chi2 and fit.dof"),
    (("parameters", "value", 9), 1e-2, ("supports", 0, "zero"), "parameters.value"),
    (
        ("budget", "angles", 2, "variance", "tracker"),
        1e-9,
        ("budget", "angles", 2, "variance"),
        "covariance.matrix",
    ),
]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("number", "by", "named", "source"), REDUNDANT)
def test_a_number_that_moved_is_found_at_its_place(
    number: Place, by: float, named: Place, source: str, sign: int
) -> None:
    assert refused(moved(number, sign * by)) == (named, f"disagrees with {source}")


def test_uncertainties_that_were_made_smaller_name_both_that_disagree() -> None:
    smaller = [[value / 100 for value in row] for row in WHOLE["covariance"]["matrix"]]
    place, said = refused(altered((("covariance", "matrix"), smaller)))
    assert (place, said) == (("parameters", "matrix"), "disagrees with covariance.matrix")
    support = WHOLE["supports"][0]
    ends = support["rpy_interval"]
    tight = {
        end: [rpy + (x - rpy) / 2 for rpy, x in zip(support["rpy"], ends[end], strict=True)]
        for end in ("low", "high")
    }
    place, said = refused(altered((("supports", 0, "rpy_interval"), ends | tight)))
    assert (place, said) == (("supports", 0, "rpy_interval"), "disagrees with supports[0].rpy_std")


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
    Calibration.model_validate(moved(number, by))


@pytest.mark.parametrize(
    ("kind", "place"),
    [
        ("joint", ("postures", "moment_after")),
        ("joint", ("dwells", "end")),
        ("joint", ("dwells", "force", 1)),
        ("joint", ("methods", 0, "rpy")),
        ("motion", ("motion", "spectrum", "after")),
        ("motion", ("motion", "residual", "force_after")),
    ],
)
def test_a_column_that_is_shorter_than_its_table(kind: str, place: Place) -> None:
    content = stated(kind)
    inner: Any = content
    for part in place:
        inner = inner[part]
    inner.pop()
    assert refused(content)[0] == place


def test_what_is_null_is_compared_with_nothing() -> None:
    """A standard uncertainty that is open; the zero of an axis that is not measured."""
    for place in (("supports", 0, "zero_std", 1), ("supports", 1, "zero", 1)):
        Calibration.model_validate(altered((place, None)))
        assert refused(altered((place, 0.7)))[0] == place[:-1]


def test_a_fit_without_degrees_of_freedom_states_no_p_value() -> None:
    for chi2, dof, p, birge in (
        (0.0, 0, 1.0, 1.0),
        (150.0, 160, float(stats.chi2.sf(150.0, 160)), (150 / 160) ** 0.5),
    ):
        stated = {"chi2": chi2, "dof": dof, "p_value": p, "birge": birge}
        fit = altered((("fit",), WHOLE["fit"] | stated))
        read = Calibration.model_validate(fit).fit
        assert read is not None
        assert read.dof == dof
