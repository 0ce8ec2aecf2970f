import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tdfscal.commands.calibrate import calibrate
from tdfscal.errors import DataError, TdfscalError, UsageError
from tdfscal.files.calibration.document import (
    Calibration,
    dump_calibration,
    load_calibration,
    parse_calibration,
    save_calibration,
)
from tdfscal.files.rig.reading import load_rig
from tdfscal.files.saving import to_yaml
from tdfscal.files.writers.campaign import write_run
from tdfscal.simulation import Options, Recorder, SurveyOptions, reference_rig, run
from tests.cli.running import SAMPLES
from tests.files.edits import DROP, at, edited, kinds, nudged


@pytest.fixture(scope="module")
def made() -> dict[str, Any]:
    """What stands in a file that `calibrate` wrote."""
    written: dict[str, Any] = json.loads(dump_calibration(calibrate(SAMPLES / "csv"), "json"))
    return written


@pytest.fixture
def content(made: dict[str, Any]) -> dict[str, Any]:
    """The same as of another program, without a digest."""
    return edited(made, ("content_sha256", DROP), ("supports.0.zero_std.1", None))


@pytest.fixture
def found(content: dict[str, Any]) -> Calibration:
    return Calibration.model_validate(content)


@pytest.mark.parametrize("suffix", [".json", ".yaml", ".yml", ".JSON"])
def test_round_trip_to_the_bit(found: Calibration, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"calibration{suffix}"
    save_calibration(found, path)
    assert load_calibration(path) == found
    assert parse_calibration(path.read_bytes(), "-") == found
    text = path.read_text(encoding="utf-8")
    independent = json.loads(text) if suffix.lower() == ".json" else yaml.safe_load(text)
    assert np.array_equal(np.array(independent["covariance"]["matrix"]), found.rotation_covariance)
    for ours, theirs in zip(found.supports, independent["supports"], strict=True):
        assert np.array_equal(np.array(theirs["rotation"]), np.array(ours.rotation))
        assert theirs["zero_std"] == list(ours.zero_std)
    with pytest.raises(ValueError, match="read-only"):
        found.rotation[0] = 0.0


def indefinite(rows: list[list[float]]) -> list[list[float]]:
    value, vectors = np.linalg.eigh(np.array(rows))
    value[0] = -1e-9 * value[-1]
    worse = vectors @ np.diag(value) @ vectors.T
    symmetric: list[list[float]] = ((worse + worse.T) / 2).tolist()
    return symmetric


def smaller(rows: list[list[float]]) -> list[list[float]]:
    return [[value / 100 for value in row] for row in rows]


def shorter(values: list[Any]) -> list[Any]:
    return values[:-1]


def exact_for(count: int, **moves: Any) -> list[dict[str, Any]]:
    """A quantity taken as exact, with its effect on so many supports, and moves of parameters."""
    effect = [[1e-3, 0.0, 0.0]] * count
    return [{"name": "base level", "error": 1e-3, "unit": "rad", "effect": effect, **moves}]


REJECTING = {"code": "residuals-large", "severity": "rejects", "text": "3.1 > 2"}
MIRROR = np.diag([1.0, 1.0, -1.0])
BROKEN: list[tuple[str, Any, str, str]] = [
    # what is edited, its value, a word of the message, the place that it names
    ("parameters.value.0", 0.3, "turn from `supports[].rotation`", "parameters.value"),
    ("format", "tdfscal-calibration/2", "newer format", "format"),
    ("format", "tdfscal-rig/1", "not a calibration file", "format"),
    ("format", DROP, "not a calibration file", ""),
    ("fit", DROP, "lacks `estimator`, `fit`", ""),
    ("created", "2026-13-45T00:00:00Z", "is no instant", "created"),
    ("method", "tracker", "belongs to self-calibration", "estimator"),
    ("estimator", DROP, "estimator", ""),
    ("status", "rejected", "findings", "status"),
    ("findings", [REJECTING], "findings", "status"),
    ("convention", "F = X f", "sensitivity", "convention"),
    ("inputs.0.byts", 3, "`bytes`", "inputs[0].byts"),
    ("supports", lambda old: [old[1], old[0], old[2]], "must name ncp1, ncp2, ncp3,", "supports"),
    ("supports.0.zero_std", [0.1, 0.1], "zero_std", "supports[0]"),
    ("supports.1.quaternion_xyzw", DROP, "quaternion_xyzw", "supports[1]"),
    ("supports.0.rotation", lambda R: (R @ MIRROR).tolist(), "det", "supports[0].rotation"),
    ("supports.2.rotation.0.0", nudged(2e-9), "rotation", "supports[2].rotation"),
    ("supports.1.rpy.1", nudged(4e-9), "supports[1].rotation", "supports[1].rpy"),
    ("supports.1.quaternion_xyzw.3", nudged(4e-9), "supports[1].rotation", "quaternion_xyzw"),
    ("supports.0.rpy_std.2", nudged(1e-8), "covariance.matrix", "supports[0].rpy_std"),
    ("supports.0.rpy_interval.coverage", 95.0, "less than 1", "coverage"),
    ("supports.0.rpy_interval.low", [9.0, 9.0, 9.0], "above", "rpy_interval"),
    ("covariance", DROP, "lacks `covariance`", ""),
    ("covariance.parameters.0", "ncp1.ry", "must name ncp1.rx", "covariance.parameters"),
    ("covariance.definition", "d in the LCS", "definition", "covariance.definition"),
    ("covariance.matrix.0.1", nudged(1e-15), "symmetric", "covariance.matrix"),
    ("covariance.matrix", [[1.0]], "9 rows", "covariance.matrix"),
    ("covariance.matrix", indefinite, "semidefinite", "covariance.matrix"),
    # What stands twice, beyond rounding; of uncertainties that were made smaller both are named.
    ("covariance.matrix", smaller, "disagrees with covariance.matrix", "parameters.matrix"),
    ("supports.2.turn_std.0", nudged(1e-8), "covariance.matrix", "supports[2].turn_std"),
    ("supports.2.zero.1", nudged(-1e-8), "parameters.value", "supports[2].zero"),
    ("supports.1.zero_std.2", nudged(1e-5), "parameters.matrix", "supports[1].zero_std"),
    ("supports.1.sensitivity.0.0", nudged(-1e-7), "parameters.value", "supports[1].sensitivity"),
    ("terminal.mass.value", nudged(-1e-5), "parameters.value", "terminal.mass.value"),
    ("terminal.mass.std", nudged(-1e-5), "parameters.matrix", "terminal.mass.std"),
    ("terminal.barycenter.value.1", nudged(1e-7), "parameters.value", "barycenter.value"),
    ("terminal.barycenter.std.2", nudged(1e-6), "parameters.matrix", "barycenter.std"),
    ("parameters.value.9", nudged(1e-2), "parameters.value", "supports[0].zero"),
    ("postures.after", shorter, "rows", "postures.after"),
    ("dwells.force.1", shorter, "rows", "dwells.force[1]"),
    ("budget.sources", ["noise"], "must name noise,", "budget.angles[0].variance"),
    ("budget.angles.8", DROP, "must name ncp1.roll", "budget.angles"),
    ("budget.angles.3.angle", "yaw", "must name ncp1.roll", "budget.angles"),
    ("taken_as_exact", exact_for(4), "3 rows", "taken_as_exact[0].effect"),
    ("taken_as_exact", exact_for(3, common=[[1e-3]]), "rows", "taken_as_exact[0].common"),
    ("taken_as_exact", exact_for(3, apart=[[]]), "of one length", "taken_as_exact[0].apart"),
    ("rig.terminal.mass.value", -1.0, "greater than 0", "rig.terminal.mass"),
]


@pytest.mark.parametrize(("edit", "value", "word", "place"), BROKEN)
def test_altered_file_is_refused(
    content: dict[str, Any], tmp_path: Path, edit: str, value: Any, word: str, place: str
) -> None:
    broken = edited(content, (edit, value))
    path = tmp_path / "c.json"
    path.write_text(json.dumps(broken))
    with pytest.raises(TdfscalError) as refused:
        load_calibration(path)
    assert refused.value.exit_status == (2 if "its format is" in str(refused.value) else 3)
    assert refused.value.where is not None
    assert refused.value.where.startswith(str(path))
    assert place in refused.value.where
    assert word in str(refused.value)
    assert "\n" not in str(refused.value)


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
def test_rounding_is_no_edit(content: dict[str, Any], number: str, by: float) -> None:
    Calibration.model_validate(edited(content, (number, nudged(by))))


@pytest.mark.parametrize("place", ["supports.0.zero_std.1", "supports.1.zero.1"])
def test_what_is_null_is_compared_with_nothing(content: dict[str, Any], place: str) -> None:
    """A standard uncertainty that is open; the zero of an axis that is not measured."""
    Calibration.model_validate(edited(content, (place, None)))
    with pytest.raises(ValueError, match="disagrees with parameters"):
        Calibration.model_validate(edited(content, (place, 0.7)))


def test_nothing_infinite_gets_in(content: dict[str, Any]) -> None:
    """Any number; what the rig file does not know may be +∞."""
    for place in kinds(content):
        if not isinstance(at(content, place), float):
            continue
        unknown = place[0] == "rig" and {"std", "rpy_std", "time", "temperature"} & {*place}
        for value in (math.nan, -math.inf) if unknown else (math.nan, math.inf, -math.inf):
            wrong = edited(content, (".".join(map(str, place)), value))
            with pytest.raises(ValueError, match=r"finite|must be 0 or above"):
                Calibration.model_validate(wrong)
    with pytest.raises(DataError, match="finite"):
        parse_calibration(to_yaml(edited(content, ("fit.chi2", math.nan))).encode(), "c.yaml")


def test_other_suffix_and_missing_file(found: Calibration, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no calibration"):
        save_calibration(None, tmp_path / "calibration.yaml")  # type: ignore[arg-type]
    wrong: Any
    for wrong in (None, 3):
        for use in (load_calibration, load_rig, lambda path: save_calibration(found, path)):
            with pytest.raises(UsageError, match="names no file"):
                use(wrong)
    with pytest.raises(UsageError, match=r"\.json, \.yaml or \.yml"):
        save_calibration(found, tmp_path / "calibration.txt")
    with pytest.raises(UsageError, match="no such file"):
        load_calibration(tmp_path / "calibration.yaml")
    with pytest.raises(UsageError, match="cannot be written"):
        save_calibration(found, tmp_path / "no" / "calibration.yaml")
    assert list(tmp_path.iterdir()) == []


def other(value: Any) -> Any:
    """Another value of the same kind; none where there is none."""
    match value:
        case bool():
            return not value
        case float() | int():
            return 1.001 * value + 1e-3
        case str():
            return value + "x"
        case list() if len(value) > 1 and value != value[::-1]:
            return value[::-1]
    return DROP


def test_files_of_ours_tell_every_edit_that_matters(made: dict[str, Any]) -> None:
    """Each is refused as an edit, or the file reads to the same content."""
    whole = parse_calibration(json.dumps(made).encode(), "c.json")
    for place in kinds(made):
        text = json.dumps(edited(made, (".".join(map(str, place)), other(at(made, place)))))
        said = ""
        try:
            assert parse_calibration(text.encode(), "c.json") == whole, place
        except TdfscalError as error:
            said = str(error)
        assert not said or "content_sha256 does not match" in said or place == ("format",)


def test_the_digest_is_that_of_the_documented_recipe(found: Calibration) -> None:
    """By the json module alone; letters beyond ASCII, nulls of keys and in lists are there."""
    named = found.model_copy(update={"command": "tdfscal calibrate Prüfstand"})
    rest = json.loads(dump_calibration(named, "json"), object_hook=_without_null)
    stated = rest.pop("content_sha256")
    assert rest["supports"][0]["zero_std"][1] is None
    text = json.dumps(rest, sort_keys=True, ensure_ascii=False)
    assert hashlib.sha256(text.encode()).hexdigest() == stated


def _without_null(keys: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in keys.items() if value is not None}


def test_another_notation_is_no_edit(made: dict[str, Any]) -> None:
    """Order, layout, comments, the form, and numbers that some writers shorten."""
    whole = parse_calibration(json.dumps(made).encode(), "c.json")
    backwards = dict(reversed(made.items()))
    for text in (
        json.dumps(backwards, indent=3),
        yaml.safe_dump(made, allow_unicode=False) + "# a comment\n",
        json.dumps(made).replace(".0,", ","),
    ):
        assert parse_calibration(text.encode(), "c") == whole


def test_a_joint_file_states_the_contact_wrench_of_both_methods(tmp_path: Path) -> None:
    """A limit between the two: the self-calibration is rejected by it, both together conform."""
    options = Options(postures=12, rows="postures", recorder=Recorder(mean_sd=0.05))
    rng = np.random.default_rng(1)
    write_run(
        run(reference_rig(), "self", options, rng, SurveyOptions()), tmp_path / "c", format="csv"
    )
    path = tmp_path / "c" / "rig.yaml"
    rig = yaml.safe_load(path.read_text(encoding="utf-8"))
    found: dict[str, Calibration] = {}
    force = 1e3
    for _ in range(2):
        rig["acceptance"]["contact"] = {"force": force}
        path.write_text(yaml.safe_dump(rig), encoding="utf-8")
        found = {m: calibrate(path.parent, trials=0, method=m) for m in ("self", "joint")}
        stated = [c.conformity for c in found.values() if c.conformity is not None]
        force = float(np.sqrt(stated[0].force.expanded * stated[1].force.expanded))
    assert "contact-uncertain" in {finding.code for finding in found["self"].reasons}
    assert found["joint"].accepted
    assert len(found["joint"].inputs) == 5
    assert {file.integrity for file in found["joint"].inputs} == {"unverified"}  # all is plain text
    assert stated[1].force.expanded < force < stated[0].force.expanded
