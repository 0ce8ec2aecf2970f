"""A log altered in one known way: refused or not, and the alteration is what is named."""

import copy
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import pytest
import yaml

from tdfscal import simulation
from tdfscal.checks.faulty_sensors import screen
from tdfscal.checks.log_against_rig import (
    bent,
    check_geometry,
    check_size,
    check_weight,
    turned,
    weight_share,
)
from tdfscal.checks.wiring import (
    bent_positions,
    exchanged_channels,
    exchanged_supports,
    rewired_forces,
    rewired_positions,
    rewired_sensors,
)
from tdfscal.commands.log_pass import drafted
from tdfscal.errors import DataError
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.findings import Finding
from tdfscal.model.parameters import nominal
from tdfscal.model.postures import postures
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.simulation import Options
from tests.words import in_words

ALL = np.ones((3, 3), dtype=np.bool_)
MADE = simulation.make_rig()
#: Three supports whose distances all differ, the middle of the hinges off the origin.
LOPSIDED = np.array([[0.7, 0.1, 0.02], [-0.3, 0.5, -0.03], [-0.2, -0.6, 0.05]])
RIG = replace(MADE, hinge=LOPSIDED)
RNG = np.random.default_rng(23)
TURNS = 0.05 * RNG.normal(size=(9, 3))
POSITION = np.asarray(
    np.einsum("kab,nb->kna", so3.exp(TURNS), RIG.hinge) + RNG.normal(size=(9, 1, 3))
)
DWELLS = simulation.simulate_dwells(MADE, Options(), np.random.default_rng(1), 1).dwells(0)
SEEN = postures(MADE, DWELLS)


def held_against(rig: Rig, position: FloatArray) -> None:
    """Without readings: what declared supports give is another test's."""
    check_geometry(rig, position, np.zeros_like(position))


def refused(rig: Rig, position: FloatArray) -> DataError:
    with pytest.raises(DataError) as error:
        held_against(rig, position)
    assert error.value.where == "log positions"
    assert error.value.exit_status == 3
    return error.value


def test_the_rigs_own_log_fits() -> None:
    held_against(RIG, POSITION)
    check_size(RIG, POSITION)
    assert turned(RIG, POSITION) == ()


@pytest.mark.parametrize(
    ("factor", "named", "absent"),
    [
        (1e3, ["mm where m", "um where mm"], ["cm"]),
        (1e-3, ["m where mm", "mm where um"], ["cm"]),
        (1e6, ["um where m "], ["cm"]),
        (1e2, ["cm where m "], ["inches"]),
        (0.1, ["cm where"], []),
        (1 / 0.0254, ["inches where m "], ["cm"]),
        (1.021, [], ["where"]),
        (0.979, [], ["where"]),
        (2.0, [], ["where"]),
    ],
)
def test_lengths_in_another_unit(factor: float, named: list[str], absent: list[str]) -> None:
    """A log in units of which a metre has `factor`: its numbers are that much larger."""
    error = refused(RIG, factor * POSITION)
    with pytest.raises(DataError):
        check_size(RIG, factor * POSITION)
    (told,) = re.findall(r"(\S+) times as far apart", error.what)
    assert float(told) == pytest.approx(factor, rel=5e-4)
    said = error.what.replace("is declared", "")
    assert all(words in said for words in named)
    assert not any(words in said for words in absent)


def test_shape_may_miss_by_what_is_declared_and_two_per_mill_of_the_radius() -> None:
    """Enlarged about the hinges' middle: the misfit is known in closed form."""
    arm = RIG.hinge - RIG.hinge.mean(axis=0)
    radius, size = np.linalg.norm(arm, axis=1).mean(), np.sqrt((arm**2).sum(axis=1).mean())
    exact = replace(RIG.declared, hinge=0.0, datum=0.0, positioner=0.0)
    declared = replace(RIG.declared, hinge=1e-4, datum=2e-4, positioner=2e-4)
    for stated, more in ((exact, 0.0), (declared, 6 * 3e-4)):
        rig, limit = replace(RIG, declared=stated), 2e-3 * radius + more
        position = np.einsum("kab,nb->kna", so3.exp(TURNS), RIG.hinge + 0.98 * limit / size * arm)
        held_against(rig, position)
        position = np.einsum("kab,nb->kna", so3.exp(TURNS), RIG.hinge + 1.02 * limit / size * arm)
        refused(rig, position)


def renamed(rig: Rig, order: Sequence[int]) -> str:
    """Words for supports that are taken in another order."""
    moved = [(rig.supports[i], rig.supports[j]) for i, j in enumerate(order) if i != j]
    return " and ".join(f"{name} taken from {other}" for name, other in moved)


def test_supports_exchanged_are_named() -> None:
    for order in list(permutations(range(3)))[1:]:
        error = refused(RIG, POSITION[:, list(np.argsort(order))])
        assert f"the positions of {renamed(RIG, order)}" in error.what


@pytest.mark.parametrize(
    ("axes", "signs", "words"),
    [
        ([0, 1, 2], [-1, 1, 1], "the opposite sign of X of every positioner"),
        ([1, 0, 2], [1, 1, 1], "the axes read as Y, X, Z"),
        ([0, 2, 1], [1, 1, 1], "the axes read as X, Z, Y"),
    ],
)
def test_mirrored_axes_are_named(axes: list[int], signs: list[int], words: str) -> None:
    altered = np.empty_like(POSITION)
    altered[..., axes] = POSITION * np.array(signs, dtype=np.float64)[np.argsort(np.argsort(axes))]
    # Reading the altered log's axes in that order and sign gives the log back.
    assert np.allclose(altered[..., axes] * np.array(signs), POSITION, atol=0)
    error = refused(RIG, altered)
    assert words in error.what


def test_one_mistake_in_the_positions_is_named_with_and_without_hinges() -> None:
    """Signs, units, exchanged channels; a coordinate may lie on either side of its zero.

    Two heights exchanged are nearly another tilt: only their variation tells.
    """
    for k, way in enumerate(list(bent_positions(RIG.supports))[::4]):
        right = POSITION - (POSITION[:, [k % 3]].mean(axis=0) if k % 2 else 0.0)
        wrong = replace(way, sign=1 / way.sign).signals(right)
        (found,), mended = bent(RIG.supports, wrong)
        assert found.values["fits"] == way.words
        assert mended is not None
        np.testing.assert_allclose(mended.signals(wrong), right, rtol=1e-12)
        if not re.fullmatch("Z of ncp. and Z of ncp. exchanged", way.words):
            assert way.words in refused(RIG, wrong).what
    assert bent(RIG.supports, POSITION) == ((), None)


def test_a_hinge_measured_wrongly_is_named_with_its_farthest_partner() -> None:
    moved = RIG.hinge.copy()
    moved[1] += 0.01 * (moved[1] - moved[2]) / np.linalg.norm(moved[1] - moved[2])
    error = refused(replace(RIG, hinge=moved), POSITION)
    assert "it would fit" not in error.what
    first, second = RIG.supports[1], RIG.supports[2]
    assert f"{first} to {second} is" in str(error.hint)
    length = np.linalg.norm(RIG.hinge[1] - RIG.hinge[2])
    assert f"is {length:.4f} m in the log and {length + 0.01:.4f} m in rig.yaml" in str(error.hint)


def test_a_terminal_on_its_head_is_refused() -> None:
    flip = np.diag([1.0, -1.0, -1.0])
    error = refused(RIG, POSITION @ flip)
    assert "its head" in error.what
    four = simulation.make_rig(4)
    position = np.einsum("kab,nb->kna", so3.exp(TURNS), four.hinge)
    held_against(four, position)
    assert "its head" in refused(four, position @ flip).what


@pytest.mark.parametrize(
    ("turn", "words"),
    [
        ([0, 0, 0.77], None),
        ([0, 0, 0.80], "46° about Z of the BCS in every"),
        ([0, 0, -1.5], "86° about -Z of the BCS in every"),
        ([0.9, 0, 0], "about X of the BCS"),
        ([0, -0.9, 0], "about -Y of the BCS"),
        ([0.6, 0.6, 0.0], "49° in every"),  # about no single axis
    ],
)
def test_a_terminal_far_from_the_axes_is_said(turn: list[float], words: str | None) -> None:
    steady = np.einsum("ab,kbc,nc->kna", so3.exp(turn), so3.exp(1e-3 * TURNS), RIG.hinge)
    note = " ".join(in_words(turned(RIG, steady)))
    if words is None:
        assert note == ""
    else:
        assert words in str(note)
        assert "upright" not in str(note)  # exchanged, the lopsided hinges would not fit


@pytest.mark.parametrize("step", [1, 2])
def test_names_in_a_circle_are_said_with_the_way_back(step: int) -> None:
    """A symmetric rig renamed in a circle fits, turned by 120°."""
    rig = simulation.make_rig()
    position = np.einsum("kab,nb->kna", so3.exp(TURNS), rig.hinge)
    order = [(i + step) % 3 for i in range(3)]
    circled = position[:, order]
    held_against(rig, circled)
    back = [order.index(i) for i in range(3)]
    (found,) = turned(rig, circled)
    assert found.rejects
    assert f"forces of {renamed(rig, back)}" in in_words([found])[0]


def test_a_rig_whose_hinges_tell_it_turned_is_not_rejected() -> None:
    """Half a millimetre of asymmetry is within the gross limit, and far beyond what is stated."""
    rig = simulation.make_rig()
    hinge = rig.hinge.copy()
    hinge[0, 0] += 5e-4
    rig = replace(rig, hinge=hinge)
    turn = so3.exp(np.array([0.0, 0.0, 2 * np.pi / 3]))
    (found,) = turned(rig, np.einsum("kab,bc,nc->kna", so3.exp(TURNS), turn, rig.hinge))
    assert not found.rejects


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("the opposite sign of Fy of ncp2", lambda f: f * [[1, 1, 1], [1, -1, 1], [1, 1, 1]]),
        ("the opposite sign of Fz of every sensor", lambda f: f * np.array([1, 1, -1])),
        ("the opposite sign of every axis of ncp3", lambda f: f * np.array([[1], [1], [-1]])),
        ("Fx and Fz of every sensor exchanged", lambda f: f[..., [2, 1, 0]]),
        ("the sensors of ncp1 taken from ncp2 and ncp2 taken from ncp1", lambda f: f[:, [1, 0, 2]]),
        ("Fx of ncp1 and Fz of ncp2 exchanged", lambda f: _channels(f)),
    ],
)
def test_rewirings_as_they_say(words: str, change: Callable[[FloatArray], FloatArray]) -> None:
    ways = (*rewired_sensors(MADE.supports), *exchanged_channels(MADE.supports, MADE.axes))
    (wiring,) = (way for way in ways if way.words == words)
    assert np.array_equal(wiring.signals(SEEN.force), change(SEEN.force))
    # Each entry of a covariance is that of two readings, and goes where these go.
    root = RNG.normal(size=(len(SEEN), 3, 3, 3))
    found = wiring.postures(replace(SEEN, force_cov=root @ np.swapaxes(root, 2, 3)))
    assert np.array_equal(found.force, change(SEEN.force))
    independent = np.zeros((len(SEEN), 3, 3, 3, 3))
    independent[:, range(3), :, range(3)] = np.moveaxis(root, 1, 0)
    noise = np.stack([change(independent[..., i, j]) for i in range(3) for j in range(3)], axis=-1)
    expected = noise @ np.swapaxes(noise, 2, 3)
    assert np.allclose(found.force_cov, expected, rtol=1e-12, atol=1e-15)


def _channels(force: FloatArray) -> FloatArray:
    out = force.copy()
    out[:, 0, 0], out[:, 1, 2] = force[:, 1, 2], force[:, 0, 0]
    return out


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.0, None),
        (1.19, None),
        (0.81, None),
        (1.22, "1.22 times"),
        (-1.0, "wrong sign"),
        (-1.15, "wrong sign"),
        (-1.3, "-1.3 times"),
        (1e3, "in N where kN"),
        (-1e3, "in N where kN"),
        (1e-3, "in kN where N"),
        (1 / 9.80665, "in kgf"),
        (0.02, "0.02 times"),
    ],
)
def test_forces_in_another_unit_or_sign(factor: float, words: str | None) -> None:
    rig = replace(MADE, mass=UncertainValue.exact(MADE.mass.value))
    state = replace(nominal(rig), zero=np.zeros((3, 3)))
    share = np.median(weight_share(state, rig.gravity, SEEN.force))
    scaled = replace(SEEN, force=factor / share * SEEN.force)
    if words is None:
        check_weight(rig, scaled, state)
        return
    with pytest.raises(DataError) as error:
        check_weight(rig, scaled, state)
    assert words in error.value.what
    assert error.value.where == "log forces"
    units = {"in N where kN", "in kN where N", "in kgf"} - {words}
    assert not any(unit in error.value.what for unit in units)


@pytest.mark.parametrize(("step", "unit"), [(1.0, 1e-3), (1e-2, 1e3)])
def test_a_unit_that_leaves_few_digits_is_no_dead_sensor(step: float, unit: float) -> None:
    """kN without decimals where N is declared stand still; N read as kN pass capacities."""
    rig = replace(MADE, capacity=np.full((3, 3), 5e3))
    arrays = {
        name: step * np.round(unit * getattr(DWELLS, name) / step)
        for name in ("force", "force_min", "force_max")
    }
    with pytest.raises(DataError, match="in kN where N" if unit < 1 else "in N where kN"):
        screen(rig, replace(DWELLS, **arrays))


_LINE = re.compile(r"`log\.supports\.([^`]*?)\.(position|force)(_scale)?: (\[[^`]*\])`")


@pytest.mark.parametrize("quantity", ["position", "force"])
@pytest.mark.parametrize("vectors", [False, True])
def test_what_is_told_to_write_makes_of_readings_what_the_wiring_makes_of_them(
    quantity: Literal["position", "force"], *, vectors: bool
) -> None:
    """The lines of every exchange and sign, pasted into a log in mm and kN with a scale stated."""
    value, names = np.random.default_rng(1).normal(size=(RIG.n, 3)), RIG.supports
    fields = [f"/{name}.{quantity}" for name in names]
    channels = {
        f"{field}.{a}": (i, k) for i, field in enumerate(fields) for k, a in enumerate("xyz")
    }
    own: dict[str, dict[str, Any]] = {
        name: {quantity: field if vectors else [f"{field}.{a}" for a in "xyz"]}
        for name, field in zip(names, fields, strict=True)
    }
    own[names[1]][f"{quantity}_scale"] = [1e-3, 2e-3, -1e-3] if quantity == "position" else 1e3
    log: dict[str, Any] = {"length_unit": "mm", "force_unit": "kN", "supports": own}
    loaded = LoadedRig(RIG, (LogBlock(**log),), None, Path("rig.yaml"), "", {})

    def read(log: LogBlock, name: str) -> list[float]:
        whose = list(getattr(log.support_fields(name), quantity))
        whose = whose if len(whose) == 3 else [f"{whose[0]}.{a}" for a in "xyz"]
        scale = log.scale(quantity, name)[0]
        return [s * value[channels[field]] for s, field in zip(scale, whose, strict=True)]

    asked = rewired_positions if quantity == "position" else partial(rewired_forces, measured=ALL)
    code = "hinges-off" if quantity == "position" else "forces-exchanged"
    for wiring in asked(names):
        written = loaded.written(Finding(code, values=wiring.written(names))).values["lines"]
        pasted = copy.deepcopy(log)
        for name, _, scale, text in _LINE.findall(" ".join(cast(list[str], written))):
            for whose in names if name == "<each>" else [name]:
                pasted["supports"][whose][f"{quantity}{scale}"] = yaml.safe_load(text)
        scale = [loaded.log[0].scale(quantity, name)[0] for name in names]
        made = [read(LogBlock(**pasted), name) for name in names]
        np.testing.assert_allclose(made, wiring.signals(value) * scale, rtol=1e-12)


@pytest.mark.parametrize("order", list(permutations(range(3)))[1:])
def test_sensors_exchanged_are_told_as_positions_too_and_warned_of_once_written(
    order: tuple[int, ...],
) -> None:
    """Both pair the same readings; afterwards the names of the fields say that one is."""
    (way,) = (
        each
        for each in exchanged_supports(RIG.supports, "the sensors")
        if (each.source[:, 0] // 3).tolist() == list(order)
    )
    fields = {n: {"position": f"NCP{i}", "force": f"F{i}"} for i, n in enumerate(RIG.supports)}

    def loaded(supports: dict[str, Any]) -> LoadedRig:
        return LoadedRig(RIG, (LogBlock(supports=supports),), None, Path("rig.yaml"), "", {})

    values = {**way.written(RIG.supports), "either": True}
    told = loaded(fields).written(Finding("forces-exchanged", values=values)).values
    pairs = []
    for key in ("lines", "others"):
        pasted = copy.deepcopy(fields)
        for name, what, _, text in _LINE.findall(" ".join(cast(list[str], told[key]))):
            pasted[name][what] = yaml.safe_load(text)[0].partition(".")[0]
        pairs.append({(own["position"], own["force"]) for own in pasted.values()})
        moved = [n for i, n in enumerate(RIG.supports) if order[i] != i]
        (found,) = drafted([loaded(pasted)])
        assert found.subject == tuple(moved)
    assert pairs[0] == pairs[1]
    assert not drafted([loaded(fields)])
