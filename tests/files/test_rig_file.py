"""Parts of a rig file that contradict one another: refused at their place, and only then."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic_core import PydanticCustomError
from scipy.spatial.transform import Rotation

from tdfscal.errors import RigError, UsageError
from tdfscal.files.rig.model import check_hinges, check_inertia
from tdfscal.files.rig.reading import load_rig, parse_rig
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.records import CampaignInfo, DeclaredUncertainty, Drift, Instrument, SensorInfo
from tests.files.sample_documents import MINIMAL, RIG


def parse(text: str) -> object:
    return parse_rig(text.encode(), "rig.yaml")


def altered(old: str, new: str, text: str = RIG) -> str:
    assert text.count(old) == 1, old
    return text.replace(old, new)


def test_every_key_arrives(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(RIG)
    loaded = load_rig(tmp_path / "rig.yaml")
    rig, (log,), tracker = loaded.rig, loaded.log, loaded.tracker
    assert (float(rig.mass.value), float(rig.mass.std)) == (500.0, 0.2)
    assert rig.inertia is not None
    assert rig.inertia.std.tolist() == [[6.0] * 3] * 3
    assert rig.axes.tolist() == [[True] * 3, [True, False, True], [True] * 3]
    assert rig.campaign == CampaignInfo("2026-11-21", "A. Smith", "Hall 3", note="after service")
    assert rig.sensors == (SensorInfo(), SensorInfo("4711", "C-12", "2027-03-01"), SensorInfo())
    assert rig.drift == Drift(0.5 / 3600, 0.2, 0.01, 1e-4)
    assert rig.hinge.tolist() == [[0.6, 0, 0], [-0.3, 0.5, 0], [-0.3, -0.5, 0]]
    assert rig.zero.value.tolist() == [[0] * 3] * 3
    assert rig.zero.std.tolist() == [[0.5] * 3, [math.inf] * 3, [math.inf] * 3]
    assert rig.rpy_std.tolist() == [[math.inf] * 3, [0.1] * 3, [math.inf] * 3]
    assert rig.capacity.tolist() == [[3000, 3000, 5000], [math.inf] * 3, [math.inf] * 3]
    assert rig.declared == DeclaredUncertainty(
        positioner=1e-5, hinge=2e-5, compliance_lateral=1e-6, compliance_vertical=5e-7
    )
    gate = rig.acceptance
    assert (gate.angle_std, gate.identifiable, gate.birge_max) == (5e-3, 0.04, 1.5)
    assert (gate.contact_force, gate.contact_torque) == (5.0, 3.0)
    assert gate.contact_rpy == (0.0, 0.0, 0.1)
    assert log is not None
    assert (log.time.field, log.time.unit, log.time.source) == ("t", "ms", "log")
    assert (log.length_unit, log.force_unit) == ("mm", "kN")
    assert (log.force_on, log.decimal) == ("sensor", ",")
    assert log.delay is not None
    assert (log.delay.value, log.delay.std) == (0.002, 0.005)
    assert log.temperature == ("T1", "T2", "T3")
    fields = [log.support_fields(name) for name in rig.supports]
    moves = [("X1", "Y1", "Z1"), ("/ncp2/position.point",), ("X3", "Y3", "Z3")]
    assert [own.position for own in fields] == moves
    assert fields[1].force == ("/tdfs2/wrench.wrench.force",)
    assert tracker is not None
    assert tracker.instrument.record() == Instrument(1e-5, 5.0, 2.0)
    assert (tracker.drawing, tracker.misalignment, tracker.length_unit) == (1e-5, 2e-4, "mm")
    names = ("nominal.csv", "targets.csv", "servo.csv", "moves.csv")
    assert loaded.surveys == tuple(tmp_path / "tracker" / name for name in names)


def test_defaults_of_the_contract() -> None:
    loaded = parse_rig(MINIMAL.encode(), "rig.yaml")
    rig = loaded.rig
    assert (loaded.log, loaded.tracker, rig.inertia) == ((), None, None)
    assert rig.axes.all()
    assert (rig.drift, rig.serial, rig.campaign, rig.sensors) == (Drift(), None, CampaignInfo(), ())
    assert (rig.gravity, float(rig.mass.std), rig.declared) == (9.80665, 0.0, DeclaredUncertainty())
    assert np.all(np.isinf(rig.zero.std))
    assert np.all(np.isinf(rig.rpy_std))
    assert np.all(np.isinf(rig.capacity))
    assert not rig.nominal_rpy.any()
    assert (rig.acceptance.angle_std, rig.acceptance.identifiable) == (5e-3, 0.05)
    assert rig.acceptance.contact_force is None
    assert LogBlock().support_fields("a").position == ("a.x", "a.y", "a.z")
    assert LogBlock().support_fields("a").force == ("a.fx", "a.fy", "a.fz")


@pytest.mark.parametrize("word", ["unknown", ".inf", '"unknown"', "+.inf", ".Inf"])
def test_unknown_and_inf_say_the_same(word: str) -> None:
    text = altered("mass: {value: 500.0, std: 0.2}", f"mass: {{value: 500.0, std: {word}}}")
    assert parse_rig(text.encode(), "rig.yaml").rig.mass.std == math.inf
    text = altered("std: [0.5, 0.5, 0.5]}", f"std: [0.5, {word}, 0]}}")
    assert parse_rig(text.encode(), "rig.yaml").rig.zero.std[0].tolist() == [0.5, math.inf, 0.0]


def test_columns_by_number_need_no_quotes() -> None:
    """Those of a table without a header, as whole numbers in YAML; a truth value is no name."""
    columns = [[2, 3, 4], [5, 6, 7], [8, 9, 10]]
    block = {
        "time": {"field": 1},
        "temperature": 20,
        "supports": {
            n: {"position": c, "force": [9 + k for k in c]}
            for n, c in zip("abc", columns, strict=True)
        },
    }
    loaded = parse_rig((MINIMAL + f"log: {json.dumps(block)}\n").encode(), "rig.yaml")
    fields = [loaded.log[0].support_fields(name) for name in "abc"]
    assert loaded.log[0].time.field == "1"
    assert [own.position for own in fields] == [tuple(map(str, c)) for c in columns]
    assert fields[0].force == ("11", "12", "13")
    assert loaded.log[0].temperature == ("20",)
    with pytest.raises(RigError, match="must be text"):
        parse_rig((MINIMAL + "log: {time: {field: true}}\n").encode(), "rig.yaml")


MASS = "mass: {value: 500.0, std: 0.2}"
FAULTS = [
    # what is replaced, by what, the place, a word of the message
    (MASS, "mass: {value: 0, std: 1}", "terminal.mass", "greater than 0"),
    ("value: 500.0", "value: .nan", "terminal.mass", "finite"),
    ("value: 500.0", "value: heavy", "terminal.mass", "a number"),
    (MASS, "mass: 500", "terminal.mass", "std: 0 says exact"),
    (MASS, "mass: {value: [1, 2], std: 1}", "terminal.mass", "a number"),
    (MASS, "mass:", "terminal.mass", "standard uncertainty"),
    (MASS, "mass: {value: 500.0}", "terminal.mass", "lacks `std`"),
    (MASS, "mas: 500", "terminal.mas", "`mass`"),
    ("  mass: {value: 500.0, std: 0.2}\n", "", "terminal", "lacks `mass`"),
    ("500.0, std: 0.2", "500.0, std: -0.2", "terminal.mass.std", "0 or above"),
    ("500.0, std: 0.2", "500.0, std: .nan", "terminal.mass.std", "0 or above"),
    ("500.0, std: 0.2", "500.0, std: unknwon", "terminal.mass.std", "`unknown`"),
    ("500.0, std: 0.2", "500.0, std: 0,2", "terminal.mass.2", "a point"),
    ("value: [0.01, -0.015, 0.25]", "value: 0.25", "terminal.barycenter.value", "three"),
    ("value: [0.01, -0.015, 0.25]", "value: [10, -15, 250]", "terminal.barycenter", "in m"),
    ("[z, x]", "[z, z]", "supports[1].axes", "twice"),
    ("[z, x]", "[z, w]", "supports[1].axes", "x"),
    ("[T1, T2, T3]", "[T1, T2]", "log.temperature", "2 fields"),
    ("[T1, T2, T3]", "[T1, Fx1, T3]", "log.temperature", "already serves log.supports.ncp1"),
    ('"2026-11-21"', "21.11.2026", "campaign.date", "2026-11-21"),
    ("barycenter:", "barycentre:", "terminal.barycentre", "`barycenter`"),
    ("[40.0, 1.0, 0.0]", "[40.0, 2.0, 0.0]", "terminal.inertia", "symmetric"),
    ("[0.0, 0.0, 30.0]]", "[0.0, 0.0, -30.0]]", "terminal.inertia", "positive definite"),
    ("[0.0, 0.0, 30.0]]", "[0.0, 0.0, 300.0]]", "terminal.inertia", "no body"),
    ("tilt_std: 0.0", "tilt_std: -1e-3", "gravity.tilt_std", "greater than or equal"),
    ("name: ncp2", "name: ncp1", "supports[1].name", "taken by supports[0]"),
    ("name: ncp2", 'name: ""', "supports[1].name", "is no name"),
    ("name: ncp2", "name: NCP 2", "supports[1].name", "letters, digits"),
    ("name: ncp2", "name: 2", "supports[1].name", "in quotes"),
    ("rpy_std: .inf", "sensor: {serial: 4711}", "supports[1].sensor.serial", "by supports[0]"),
    ("hinge: [0.6, 0.0, 0.0]", "hinge: [-0.3, 0.5, 0]", "supports[1].hinge", "coincide"),
    ("hinge: [0.6, 0.0, 0.0]", "hinge: [-0.3, 0.1, 0]", "supports", "one line"),
    ("nominal_rpy: [0, 0, 0]", "nominal_rpy: [0, 0, 90]", "supports[0].nominal_rpy", "degrees"),
    ("rpy_std: 0.1", "rpy_std: 0", "supports[1].rpy_std", "above 0"),
    ("positioner: 1.0e-5", "posisioner: 1.0e-5", "uncertainty.posisioner", "`positioner`"),
    ("length_unit: mm\n  force", "length_unit: furlong\n  force", "log.length_unit", "'mm'"),
    ("force_unit: kN", "force_unit: daN", "log.force_unit", "`force_scale: 10`"),
    ("[X1, Y1, Z1]", "[X1, Y1]", "log.supports.ncp1.position", "three fields or one"),
    ("[X1, Y1, Z1]", "[X1, Y3, Z1]", "log.supports.ncp3.position", "already serves"),
    ("    ncp3: {position: [X3, Y3, Z3], force: [Fx3, Fy3, Fz3]}\n", "", "log.supports", "`ncp3`"),
    ("    ncp3: {position", "    npc3: {position", "log.supports.npc3", "`ncp3`"),
    ("position: [X3, Y3, Z3], ", "", "log.supports.ncp3", "lacks the position"),
    ("[X1, Y1, Z1]", "[X1, Y1, 3.5]", "log.supports.ncp1.position[2]", "must be text"),
    (
        "{range: 1.0e-5, range_ppm: 5.0, angle_arcsec: 2.0}",
        "{range: 0, range_ppm: 0, angle_arcsec: 0}",
        "tracker.instrument",
        "uncertainty",
    ),
    ("{force: 5.0, torque: 3.0, ", "{", "acceptance.contact", "neither force nor torque"),
    ("name: Rotor-hub rig", 'name: ""', "name", "empty"),
    # Their squares overflow, or are 0, where the noise is worked out.
    ("positioner: 1.0e-5", "positioner: 1e99", "uncertainty.positioner", "beyond any quantity"),
    ("positioner: 1.0e-5", "positioner: 1e-160", "uncertainty.positioner", "below any quantity"),
]


@pytest.mark.parametrize(("old", "new", "place", "word"), FAULTS)
def test_fault_is_named_with_its_place(old: str, new: str, place: str, word: str) -> None:
    text = altered(old, new)
    with pytest.raises(RigError) as refused:
        parse(text)
    fault = refused.value
    assert fault.exit_status == 2
    assert fault.where is not None
    file, line, named = fault.where.split(", ")
    assert file == "rig.yaml"
    assert named == place or named.startswith((f"{place}.", f"{place}["))
    assert 1 <= int(line.removeprefix("line ")) <= len(text.splitlines())
    assert word in str(fault)
    assert fault.hint
    assert "\n" not in str(fault)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        ("- a\n- b\n", "a list, not a rig file"),
        ("42\n", "a single value, not a rig file"),
        ("name: x\n", "no `format`"),
        ("formt: tdfscal-rig/1\n", "ename `formt` to `format`"),
        (altered("tdfscal-rig/1", "tdfscal-rig/2"), "newer format tdfscal-rig/2"),
        (altered("tdfscal-rig/1", "2"), "its format is `2`, not"),
        (altered("tdfscal-rig/1", "tdfscal-rig/x"), "its format is `tdfscal-rig/x`"),
        (altered("tdfscal-rig/1", "tdfscal-calibration/1"), "is not a rig file"),
        (altered("tdfscal-rig/1", "[1]"), "is not a rig file"),
    ],
)
def test_not_a_rig_file(text: str, word: str) -> None:
    with pytest.raises(RigError, match=re.escape(word)):
        parse(text)


def test_missing_rig_file_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such file") as refused:
        load_rig(tmp_path / "rig.yaml")
    assert refused.value.exit_status == 2
    with pytest.raises(UsageError, match="is a folder"):
        load_rig(tmp_path)
    with pytest.raises(UsageError, match="cannot be read"):
        load_rig("rig\0.yaml")


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_supports(count: int) -> None:
    head, _, rest = MINIMAL.partition("supports:\n")
    kept = "".join(rest.splitlines(keepends=True)[:count])
    with pytest.raises(RigError, match=r"supports: must have 3 entries or more"):
        parse(f"{head}supports:{'' if count else ' []'}\n{kept}")


Place = tuple[str | int, ...]


def place_of(check: Callable[..., object], *given: Any) -> Place:
    """Where a check finds a fault."""
    with pytest.raises(PydanticCustomError) as refused:
        check(*given)
    assert refused.value.context is not None
    return tuple(refused.value.context["place"])


def test_inertias_of_bodies() -> None:
    """Spheres, rods as good as without width, plates: at the bounds of what a body can have."""
    turn = Rotation.random(random_state=1).as_matrix()
    for principal in ([1.0, 1.0, 1.0], [1e-6, 1.0, 1.0], [1.0, 2.0, 3.0], [40.0, 50.0, 30.0]):
        for scale in (1e-3, 1.0, 1e5):
            matrix = scale * turn @ np.diag(principal) @ turn.T
            check_inertia((matrix + matrix.T) / 2)
    for principal in ([0.0, 1.0, 1.0], [-1e-3, 1.0, 1.0], [1.0, 2.0, 3.0 + 1e-6], [0.0, 0.0, 0.0]):
        for scale in (1e-3, 1.0, 1e5):
            with pytest.raises(PydanticCustomError):
                check_inertia(scale * np.diag(principal))


def test_hinges_that_coincide_or_stand_in_a_row() -> None:
    triangle = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    names = ["a", "b", "c", "d"]
    for size in (1e-2, 1.0, 1e2):
        for shift in (0.0, 7.0):
            check_hinges(names[:3], size * triangle + shift)
            four = np.concatenate([triangle, triangle[1:2] + np.array([0, 0, 5e-5])])
            found = place_of(check_hinges, names, size * four + shift)
            assert found == ("supports", 3, "hinge")
            four[3] += [0, 0, 5e-4]
            check_hinges(names, size * four + shift)
            row = triangle * [1, 5e-5, 1] + [[0, 0, 0], [0, 0, 0], [0.5, 0, 0]]
            assert place_of(check_hinges, names[:3], size * row + shift) == ("supports",)
            row[2, 1] = 1e-3
            check_hinges(names[:3], size * row + shift)


APART = """
log:
  - {files: "cnc*.csv", supports: {a: {position: pa}, b: {position: pb}, c: {position: pc}}}
  - {files: "daq*.csv", supports: {a: {force: fa}, b: {force: fb}, c: {force: fc}}}
"""


@pytest.mark.parametrize(
    ("old", "new", "place", "word"),
    [
        ("c: {force: fc}", "c: {force: fc, position: pc}", "log[1].supports.c.position", "already"),
        (", b: {force: fb}", "", "log", "lacks the force of `b`"),
        ('files: "daq*.csv", ', "", "log[1]", "lacks `files`"),
        ('files: "daq*.csv"', 'files: "daq*.csv", rows: postures', "log[1].rows", "no time"),
    ],
)
def test_recorders_give_each_quantity_once(old: str, new: str, place: str, word: str) -> None:
    assert APART.count(old) == 1
    with pytest.raises(RigError, match=re.escape(word)) as refused:
        parse_rig((MINIMAL + APART.replace(old, new)).encode(), "rig.yaml")
    assert str(refused.value.where).endswith(place)
