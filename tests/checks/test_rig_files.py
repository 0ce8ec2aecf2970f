"""Two rig files that differ in one thing: that thing is found, and nothing else."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.catalogue import cure, rigs_apart, sentence
from tdfscal.checks.calibrated_rig import (
    contradictions,
    different_constants,
    other_papers,
    other_rig,
)
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, FloatArray, Rig, SensorInfo, UncertainValue
from tdfscal.significance import CONTRADICTION

RIG = replace(
    simulation.make_rig(),
    declared=DeclaredUncertainty(hinge=3e-5),
    zero=UncertainValue(np.full((3, 3), 2.0), np.full((3, 3), 0.3)),
    mass=UncertainValue(np.asarray(500.0), np.asarray(0.4)),
    barycentre=UncertainValue(np.array([0.0, 0.0, 0.25]), np.full(3, 1e-3)),
    serial="A1",
)


def moved(values: FloatArray, place: Any, by: float) -> FloatArray:
    out = np.array(values, dtype=np.float64)
    out[place] += by
    return out


def shifted(quantity: str, by: float) -> Rig:
    """The rig with one number moved."""
    if quantity == "gravity":
        return replace(RIG, gravity=RIG.gravity + by)
    name = {"nominal mounting": "nominal_rpy"}.get(quantity, quantity)
    old: Any = getattr(RIG, name)
    place = {"hinge": (1, 2), "nominal_rpy": (1, 0), "zero": (1, 1), "mass": (), "barycentre": 0}
    new: Any = moved(getattr(old, "value", old), place[name], by)
    change: dict[str, Any] = {name: replace(old, value=new) if hasattr(old, "value") else new}
    return replace(RIG, **change)


#: Quantity and its standard uncertainty in each of the two files.
STDS = {"hinge": 3e-5, "zero": 0.3, "mass": 0.4, "barycentre": 1e-3}


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("quantity", "std"), STDS.items())
def test_differences_beyond_both_uncertainties(quantity: str, std: float, sign: int) -> None:
    limit = sign * CONTRADICTION * np.sqrt(2) * std
    assert contradictions(RIG, shifted(quantity, 0.99 * limit)) == ()
    (found,) = contradictions(RIG, shifted(quantity, 1.01 * limit))
    words = sentence(found)
    assert quantity in words
    assert (RIG.supports[1] in words) == (quantity in ("hinge", "zero"))


def test_a_rig_is_one_in_whichever_frame_its_terminal_is_drawn() -> None:
    """The angles are the sensors' in the BCS; hinges apart otherwise are another rig's."""
    drawn = RIG.hinge @ so3.exp(np.array([0.3, -0.2, 1.1])).T + [0.1, -0.2, 0.3]
    assert other_rig(RIG, replace(RIG, hinge=drawn)) == ()
    for code in ("rig-uncalibrated", "rigs-differ"):  # one rig file serves all campaigns
        for hinges, one in ((drawn, True), (drawn * 1.01, False)):
            found = different_constants(RIG, replace(RIG, hinge=hinges))
            assert ("own log" in cure(rigs_apart(found, code, first="a"))) == one
    way = (drawn[1] - drawn[0]) / np.linalg.norm(drawn[1] - drawn[0])
    limit = CONTRADICTION * 2.0 * STDS["hinge"]  # a distance of two places, in either file
    for by, differing in ((0.98 * limit, 0), (1.02 * limit, 1)):
        drawn[1] += by * way
        found = other_rig(RIG, replace(RIG, hinge=drawn))
        assert len([each for each in found if each.values["of"] == "ncp1 to ncp2"]) == differing
        drawn[1] -= by * way


@pytest.mark.parametrize("compared", [other_rig, contradictions, different_constants])
def test_an_exchanged_sensor_is_told_by_its_serial(compared: Callable[[Rig, Rig], Any]) -> None:
    def with_sensors(*serials: str | None) -> Rig:
        return replace(RIG, sensors=tuple(SensorInfo(serial, "F-1") for serial in serials))

    first = with_sensors("T-1", "T-2", None)
    (found,) = compared(first, with_sensors("T-1", "T-9", "T-3"))
    assert "ncp2" in sentence(found)
    assert "T-9 instead of T-2" in sentence(found)
    for code in ("rig-uncalibrated", "rigs-differ"):
        assert "calibrate anew" in cure(rigs_apart([found], code))
    for same in (first, with_sensors(None, "T-2", "T-3"), RIG):
        assert compared(first, same) == compared(same, first) == ()


def test_a_serial_that_one_of_two_states_is_named_with_who_does() -> None:
    """What both state, alike or not, is no open question; nor is a name that both share."""
    known = replace(RIG, serial="R-1", sensors=(*map(SensorInfo, ("T-1", "T-2", None)),))
    part = replace(known, serial=None, sensors=(*map(SensorInfo, ("T-9", None, "T-3")),))
    assert other_papers(("a", known), ("b", known)) == other_papers(("a", RIG), ("b", RIG)) == ()
    first, second = other_papers(("a", known), ("b", part))
    assert (first.subject, first.values["than"]) == (("a",), "b")
    assert first.values["whose"] == ["the rig", "the sensor of ncp2"]
    assert (second.subject, second.values["whose"]) == (("b",), ["the sensor of ncp3"])
    (renamed,) = other_papers(("a", RIG), ("b", replace(RIG, name="another")))
    assert (renamed.code, renamed.values["other"]) == ("rig-renamed", "another")


def test_other_supports_are_another_rig_at_once() -> None:
    renamed = replace(RIG, supports=("a", "b", "c"))
    four = simulation.make_rig(4)
    for other in (renamed, four):
        assert len(contradictions(RIG, other)) == 1
        assert len(different_constants(RIG, other)) == 1


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"serial": "B2"}, "serial"),
        ({"hinge": moved(RIG.hinge, (2, 0), 1e-8)}, "hinge"),
        ({"nominal_rpy": moved(RIG.nominal_rpy, (2, 0), 1e-8)}, "nominal mounting"),
        ({"rpy_std": np.full((3, 3), 0.1)}, "rpy_std"),
        ({"gravity": RIG.gravity + 1e-7}, "gravity"),
        ({"gravity_tilt_std": 1e-4}, "gravity.tilt_std"),
        # A compliance is some nanometres per newton.
        ({"declared": replace(RIG.declared, compliance_lateral=4e-10)}, "compliance.lateral"),
        ({"declared": replace(RIG.declared, datum=1e-6)}, "uncertainty.datum"),
        ({"declared": replace(RIG.declared, force_sensitivity=1e-6)}, "force_sensitivity"),
    ],
)
def test_constants_that_differ(change: dict[str, Any], word: str) -> None:
    other = replace(RIG, **change)
    for first, second in ((RIG, other), (other, RIG)):
        found = different_constants(first, second)
        assert found
        assert all(word in sentence(each) for each in found)
        assert len(found) == (3 if word == "rpy_std" else 1)


@pytest.mark.parametrize(
    "change",
    [
        {"serial": None},
        {"hinge": RIG.hinge * (1 + 1e-10)},
        {"gravity": RIG.gravity * (1 + 1e-10)},
        {"declared": replace(RIG.declared, force_noise=1.0, positioner=1.0, hinge_moment=1.0)},
        {"zero": UncertainValue.exact(np.ones((3, 3)))},
        {"mass": UncertainValue.exact(np.asarray(1.0))},
        {"barycentre": UncertainValue.exact(np.ones(3))},
    ],
)
def test_what_may_differ_between_campaigns(change: dict[str, Any]) -> None:
    assert different_constants(RIG, replace(RIG, **change)) == ()
    assert different_constants(replace(RIG, **change), RIG) == ()
