"""Logs of a rig whose forces are solved for: at rest or in contact, altered in one known way."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from tdfscal import simulation
from tdfscal.checks.calibrated_rig import Inspection
from tdfscal.errors import DataError
from tdfscal.model.calibrated import Calibrated, independent
from tdfscal.model.parameters import layout
from tdfscal.model.samples_in_motion import Samples
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, FloatArray, Rig, UncertainValue
from tests.words import in_words

N = 60
X = so3.exp(np.array([[0.02, 0.01, -0.03], [0.0, -0.02, 0.04], [-0.01, 0.03, 0.02]]))
ZERO = np.array([[1.0, -2.0, 3.0], [0.5, 1.5, -2.5], [2.0, -1.0, 0.0]])


def rig(n: int = 3) -> Rig:
    """Exact but for the angles; the barycentre off the middle, so that sensors differ in load."""
    made = simulation.make_rig(n)
    return replace(
        made,
        declared=DeclaredUncertainty(),
        zero=UncertainValue.exact(np.resize(ZERO, (n, 3))),
        mass=UncertainValue.exact(made.mass.value),
        barycentre=UncertainValue.exact(np.array([0.08, 0.05, 0.25])),
        gravity_tilt_std=0.0,
    )


GIVEN = independent(rig(), X, 1e-8 * np.eye(9))
WEIGHT = float(rig().mass.value) * rig().gravity


def samples(contact: FloatArray | None = None, n: int = 3) -> Samples:
    """Tilted and squeezed, with a contact wrench (force, and moment about the LCS' origin)."""
    rng, hinge = np.random.default_rng(3), rig(n).hinge
    position, force = np.empty((N, n, 3)), np.empty((N, n, 3))
    mounted, zero = np.resize(X, (n, 3, 3)), np.resize(ZERO, (n, 3))
    for k in range(N):
        turn = Rotation.from_rotvec(0.05 * rng.normal(size=3))
        arm = turn.apply(hinge)
        grasp = np.concatenate([np.concatenate([np.eye(3), so3.hat(a)]) for a in arm], axis=1)
        down = np.array([0, 0, -WEIGHT])
        load = np.concatenate([down, np.cross(turn.apply([0.08, 0.05, 0.25]), down)])
        if contact is not None:
            load += np.concatenate([turn.apply(contact[:3]), turn.apply(contact[3:])])
        inner = null_space(grasp) @ (100.0 * rng.normal(size=3 * n - 6))
        F = (np.linalg.pinv(grasp) @ -load + inner).reshape(n, 3)
        position[k] = arm + rng.normal(size=3)
        force[k] = np.einsum("nba,nb->na", mounted, F) + zero
    return Samples(0.1 * np.arange(float(N)), position, force)


def judge(seen: Samples, given: Calibrated = GIVEN) -> list[str]:
    inspection = Inspection(given)
    for piece in inspection.watch([seen.rows(slice(0, 20)), seen.rows(slice(20, None))]):
        assert piece.time.size
    return list(in_words(inspection.finish()))


def newtons(note: str) -> float:
    """The force that is told, of three digits."""
    (told,) = re.findall(r"(\S+) N and", note)
    return float(told)


def refused(seen: Samples, given: Calibrated = GIVEN) -> DataError:
    with pytest.raises(DataError) as error:
        judge(seen, given)
    return error.value


def read(factor: float | FloatArray, seen: Samples | None = None) -> Samples:
    """The readings less their zeros times a factor, and the zeros again."""
    seen = seen or samples()
    return Samples(seen.time, seen.position, (seen.force - ZERO) * factor + ZERO)


def test_a_log_at_rest_is_nothing_to_remark() -> None:
    assert judge(samples()) == []
    assert Inspection(GIVEN).finish() == []


@pytest.mark.parametrize(
    ("reading", "capacity", "named"),
    [(5001.0, 5000.0, True), (4999.0, 5000.0, False), (101 * WEIGHT, np.inf, True)],
)
def test_one_reading_that_no_contact_explains(reading: float, capacity: float, named: bool) -> None:
    """It is named with its sensor and its time, however short it lasts."""
    seen = samples()
    seen.force[37, 1, 0] = -reading
    full = np.full((3, 3), capacity)
    (*said,) = judge(seen, replace(GIVEN, rig=replace(GIVEN.rig, capacity=full)))
    assert [("ncp2" in text or "support_2" in text) and "3.70 s" in text for text in said] == (
        [True] if named else []
    )


@pytest.mark.parametrize(
    ("axis", "share", "said"),
    [(0, 0.19, False), (0, 0.21, True), (2, 0.19, False), (2, 0.21, True)],
)
def test_a_wrench_of_a_fifth_of_the_weight_is_said(axis: int, share: float, said: bool) -> None:
    """The median of its size over the log, force and moment about the LCS' origin."""
    contact = np.zeros(6)
    contact[axis], contact[3:] = share * WEIGHT, [3.0, 4.0, 12.0]
    notes = judge(samples(contact))
    assert len(notes) == said
    for note in notes:
        assert "N and 13 N·m" in note
        assert newtons(note) == pytest.approx(share * WEIGHT, rel=5e-3)
        assert f"{share:.2g} times the weight" in note


def test_an_uncertain_calibration_says_less() -> None:
    """A wrench within six standard uncertainties is not there; an uncertain mass widens too."""
    contact = np.array([0, 0, 0.3 * WEIGHT, 0, 0, 0])
    vague = replace(GIVEN, covariance=1e5**2 * 1e-8 * GIVEN.covariance)
    assert judge(samples(contact), vague)
    loose = GIVEN.covariance.copy()
    place = layout(3)["mass"].start
    loose[place, place] = (0.02 * float(GIVEN.state.mass)) ** 2
    assert judge(samples(contact), replace(GIVEN, covariance=loose)) == []
    loose[place, place] = (0.01 * float(GIVEN.state.mass)) ** 2  # a fifth and six of these: 0.26
    for share, said in ((0.25, 0), (0.27, 1)):
        notes = judge(samples(share / 0.3 * contact), replace(GIVEN, covariance=loose))
        assert len(notes) == said
    unknown = GIVEN.open.copy()
    unknown[place] = True
    assert judge(samples(contact), replace(GIVEN, open=unknown)) == []


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1e3, "in N where kN"),
        (-1e3, "in N where kN"),
        (1e-3, "in kN where N"),
        (101.0, "101 times"),
        (-101.0, "-101 times"),
        (-1.0, "wrong sign"),
        (-1.08, "wrong sign"),
        (-0.92, "wrong sign"),
    ],
)
def test_what_no_contact_explains_is_refused(factor: float, words: str) -> None:
    """A unit as a whole: the readings themselves, zeros included, are that many times as large."""
    seen = samples()
    scaled = Samples(seen.time, seen.position, seen.force * factor)
    error = refused(scaled if abs(factor) < 1 else read(factor))
    assert words in error.what
    assert error.where == "log forces"


@pytest.mark.parametrize("order", [[1, 0, 2], [1, 2, 0], [1, 0, 2, 3]])
def test_exchanged_sensors_are_named(order: list[int]) -> None:
    n = len(order)
    given = independent(rig(n), np.resize(X, (n, 3, 3)), 1e-8 * np.eye(3 * n))
    seen = samples(n=n)
    assert judge(seen, given) == []
    (note,) = judge(Samples(seen.time, seen.position, seen.force[:, order]), given)
    names = given.rig.supports
    for i, j in enumerate(np.argsort(order)):
        assert (f"{names[i]} taken from {names[j]}" in note) == (i != j)


@pytest.mark.parametrize("scale", [0.5, 1.5, 1e3])
def test_positions_in_another_size_are_refused_at_once(scale: float) -> None:
    seen = samples()
    inspection = Inspection(GIVEN)
    wrong = Samples(seen.time, scale * seen.position, seen.force)
    with pytest.raises(DataError) as error:
        list(inspection.watch([wrong]))
    assert error.value.where == "log positions"
    # Fifteen samples are too few to judge a piece by; the end does.
    few = Inspection(GIVEN)
    list(few.watch([wrong.rows(slice(0, 15))]))
    with pytest.raises(DataError):
        few.finish()
    with pytest.raises(DataError):
        list(Inspection(GIVEN).watch([wrong.rows(slice(0, 16))]))
