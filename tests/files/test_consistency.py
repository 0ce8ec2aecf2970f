"""One number of a calibration file moved beyond rounding: refused at its place, and only then."""

from typing import Any

import pytest
from pydantic import ValidationError

from tdfscal.commands.calibrate import calibrate
from tdfscal.files.calibration.document import Calibration, file_content
from tests.cli.running import SAMPLES
from tests.files.edits import Place, edited, nudged, place_of


def stated() -> dict[str, Any]:
    """A file as of another program, without a digest; with sensitivities and all parameters."""
    content = file_content(calibrate(SAMPLES / "csv", trials=0))
    del content["content_sha256"]
    return content


WHOLE = stated()


def refused(content: dict[str, Any]) -> tuple[Place, str]:
    """The place that is refused, and what is said of it."""
    with pytest.raises(ValidationError) as error:
        Calibration.model_validate(content)
    fault = error.value.errors()[0]
    return (*fault["loc"], *fault["ctx"]["place"]), fault["ctx"]["said"]


REDUNDANT = [
    # number, by how much, what disagrees with it, the place that is named where it is another
    ("supports.2.zero.1", 1e-8, "parameters.value", "supports.2.zero"),
    ("supports.0.zero_std.2", 1e-5, "parameters.matrix", "supports.0.zero_std"),
    ("supports.1.sensitivity.0.0", 1e-7, "parameters.value", "supports.1.sensitivity"),
    ("supports.2.sensitivity.1.2", 1e-7, "parameters.value", "supports.2.sensitivity"),
    ("supports.2.turn_std.0", 1e-8, "covariance.matrix", "supports.2.turn_std"),
    ("terminal.mass.value", 1e-5, "parameters.value", "terminal.mass.value"),
    ("terminal.mass.std", 1e-5, "parameters.matrix", "terminal.mass.std"),
    ("terminal.barycenter.value.1", 1e-7, "parameters.value", "terminal.barycenter.value"),
    ("terminal.barycenter.std.2", 1e-6, "parameters.matrix", "terminal.barycenter.std"),
    ("parameters.value.9", 1e-2, "parameters.value", "supports.0.zero"),
]


@pytest.mark.parametrize(("number", "by", "source", "named"), REDUNDANT)
def test_a_moved_number_is_found(number: str, by: float, source: str, named: str) -> None:
    for step in (by, -by):
        said = refused(edited(WHOLE, (number, nudged(step))))
        assert said == (place_of(named), f"disagrees with {source}")


def test_uncertainties_that_were_made_smaller_name_both_that_disagree() -> None:
    smaller = [[value / 100 for value in row] for row in WHOLE["covariance"]["matrix"]]
    place, said = refused(edited(WHOLE, ("covariance.matrix", smaller)))
    assert (place, said) == (("parameters", "matrix"), "disagrees with covariance.matrix")


@pytest.mark.parametrize(
    ("number", "by"),
    [
        ("supports.2.zero.1", 1e-10),
        ("supports.1.rpy.1", 1e-10),
        ("supports.1.quaternion_xyzw.3", 1e-10),
        ("supports.0.zero_std.2", 1e-8),
        ("supports.1.sensitivity.0.0", 1e-10),
        ("terminal.mass.value", 1e-8),
    ],
)
def test_rounding_is_no_edit(number: str, by: float) -> None:
    Calibration.model_validate(edited(WHOLE, (number, nudged(by))))


@pytest.mark.parametrize("column", ["postures.after", "dwells.end", "dwells.force.1"])
def test_a_column_that_is_shorter_than_its_table(column: str) -> None:
    assert refused(edited(WHOLE, (column, lambda values: values[:-1])))[0] == place_of(column)


def test_what_is_null_is_compared_with_nothing() -> None:
    """A standard uncertainty that is open; the zero of an axis that is not measured."""
    for place in ("supports.0.zero_std.1", "supports.1.zero.1"):
        Calibration.model_validate(edited(WHOLE, (place, None)))
        assert refused(edited(WHOLE, (place, 0.7)))[0] == place_of(place)[:-1]
