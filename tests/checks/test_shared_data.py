"""Two estimates of which one has the data of the other: what differs, and how far by chance."""

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

import tdfscal
from tdfscal.checks.shared_data import Readings, Recorded, Relation, readings, relation, repeated
from tdfscal.comparison.compatibility import Nested, combine, compare_pair
from tdfscal.dwells import find_dwells
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.records import FloatArray, Rotations, Series
from tdfscal.simulation import Options, Recorder, reference_rig, simulate_campaign
from tdfscal.simulation.campaign import record_means
from tdfscal.simulation.equilibrium import set_stage
from tests.cli.running import Cli
from tests.cli.test_life import edited

NAMES = ("ncp1", "ncp2", "ncp3")


def level(covariance: FloatArray, turn: float = 0.0) -> Rotations:
    """All sensors level; the second one's yaw is given."""
    rotation = np.tile(np.eye(3), (3, 1, 1))
    rotation[1, :2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    return Rotations(NAMES, rotation, covariance)


def test_the_difference_of_nested_estimates_in_closed_form() -> None:
    """5 mrad, then 3 with the further data: the change has √(25 − 9) = 4 mrad."""
    part, whole = level(25e-6 * np.eye(9), 4e-3), level(9e-6 * np.eye(9))
    pair = compare_pair(("part", part), ("whole", whole), Nested(1))
    assert pair.rpy_std == pytest.approx(np.full((3, 3), 4e-3), rel=1e-12)
    assert pair.en[1, 2] == pytest.approx(4 / 8, rel=1e-9)
    assert pair.chi2 == pytest.approx(1.0, rel=1e-9)
    assert pair.dof == 9
    turned = compare_pair(("whole", whole), ("part", part), Nested(0))
    assert turned.chi2 == pytest.approx(pair.chi2, rel=1e-9)
    # A turn before the further data is seen as by these alone: 1 / (1/9 − 1/25) mrad² besides 25.
    alone = level(1e-6 / (1 / 9 - 1 / 25) * np.eye(9))
    apart = compare_pair(("part", part), ("alone", alone))
    assert pair.detectable == pytest.approx(apart.detectable, rel=1e-9)


def test_a_joint_estimate_against_its_parts_tells_what_these_tell_of_each_other() -> None:
    """χ² of either part against both together is that of the parts: nothing else differs."""
    rng = np.random.default_rng(5)
    roots = rng.normal(size=(2, 9, 14))
    one, other = (
        level(1e-6 * root @ root.T / 14, turn) for root, turn in zip(roots, (0, 1e-3), strict=True)
    )
    both = combine(one, other).rotations
    for part, rest in ((one, other), (other, one)):
        apart = compare_pair(("part", part), ("rest", rest))
        nested = compare_pair(("part", part), ("both", both), Nested(1))
        assert nested.chi2 == pytest.approx(apart.chi2, rel=1e-3)
        assert nested.detectable == pytest.approx(apart.detectable, rel=1e-6)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("a", "b", "apart"),
        ("a", "ab", "first"),
        ("ab", "b", "second"),
        ("ab", "ab", "same"),
        ("ab", "bc", "overlapping"),
    ],
)
def test_what_two_have_in_common(first: str, second: str, expected: Relation) -> None:
    assert relation(*([Recorded(x, x) for x in each] for each in (first, second))) == expected


RIG = replace(reference_rig(), declared=replace(reference_rig().declared, force_noise=0.0))


@pytest.mark.parametrize("sd", [1.5, 1e-3])
def test_the_same_plan_driven_again_is_another_recording(sd: float) -> None:
    """Nothing but the sensors' noise differs: 240 ordered pairs of sixteen days."""
    options, rng = (
        Options(postures=12, recorder=Recorder(force_sd=(sd, sd))),
        np.random.default_rng(2),
    )
    stage = set_stage(RIG, options, rng, 1)
    days = [readings(RIG, record_means(RIG, options, stage, rng).dwells(0)) for _ in range(16)]
    assert not any(repeated(*pair).any() for pair in permutations(days, 2))
    for day in days:
        moved = day.force + 0.1 * day.noise * rng.standard_normal(day.force.shape)
        copy = replace(day, force=moved[::-1][:5])
        assert repeated(day, copy).all()
        copy.force[:, 0, 1] *= 1.1  # an edited channel: the other sensors still tell
        assert repeated(day, copy).all()


def test_parts_cut_out_by_hand_are_known_by_their_readings() -> None:
    """Other begins and ends, another clock, fewer digits."""
    done = simulate_campaign(RIG, Options(postures=12), np.random.default_rng(6))

    def part(first: float, last: float, digits: int = 9) -> Readings:
        def cut(one: Series) -> Series:
            keep = (one.time >= first) & (one.time < last)
            return Series(one.time[keep] - 0.7 * first, one.value[keep])

        force = tuple(replace(s, value=s.value.round(digits)) for s in map(cut, done.log.force))
        position = tuple(map(cut, done.log.position))
        return readings(RIG, find_dwells([replace(done.log, position=position, force=force)]))

    whole = part(0.0, np.inf)
    begin, end = part(0.0, done.start[8] + 2.0), part(done.start[4] + 1.0, np.inf, digits=1)
    assert relation([whole], [begin]) == relation([end], [whole]) == "same"
    assert relation([begin], [end]) == "overlapping"
    apart = [part(0.0, done.end[5] + 0.5)], [part(done.end[5], np.inf)]
    assert relation(*apart) == "apart"
    coarse = part(0.0, np.inf, digits=-2)  # nothing moves: it would be the same on any day
    assert not repeated(coarse, coarse).any()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Calibrations of three months: alone, updated, pooled."""
    home = tmp_path_factory.mktemp("shared")
    simulate_to_folder(
        home / "rig",
        scenario="months",
        postures=8,
        months=5,
        seed=11,
        rows="postures",
        recorder=Recorder(mean_sd=0.0),
    )
    first, second, third = sorted(p for p in (home / "rig").iterdir() if p.is_dir())[:3]
    out = {name: home / f"{name}.yaml" for name in ("a", "b", "ab", "pooled", "bc", "recut")}
    out["edited"] = edited(first, home / "edited")
    log = out["edited"] / "log.csv"
    head, *rows = log.read_text().splitlines()
    short = (",".join(f"{float(cell):.6g}" for cell in row.split(",")) for row in rows[1:])
    log.write_text("\n".join([head, *short]) + "\n")
    tdfscal.calibrate(out["edited"], trials=0, output=out["recut"])
    tdfscal.calibrate(first, trials=0, output=out["a"])
    tdfscal.calibrate(second, trials=0, output=out["b"])
    tdfscal.update(out["a"], [second], trials=0, output=out["ab"])
    tdfscal.calibrate([first, second], trials=0, output=out["pooled"])
    tdfscal.calibrate([second, third], trials=0, output=out["bc"])
    return out


def codes(document: dict[str, list[dict[str, str]]]) -> list[str]:
    return [finding["code"] for finding in document["findings"]]


def test_an_edited_copy_is_known_again(made: dict[str, Path], tmp_path: Path, cli: Cli) -> None:
    """One posture less and six digits: no file of it is the same."""
    for whole in ("ab", "pooled"):
        done = cli.json("compare", made["recut"], made[whole], "-q")
        assert codes(*done["comparisons"]) == ["compared-nested"]
        line = ("update", made[whole], made["edited"], "-o", tmp_path / "u.yaml", "-q")
        assert "the same recording" in cli(*line, ends=2).err
        assert "log-used-before" in codes(cli.json("validate", made[whole], made["edited"], "-q"))
    refused = cli("monitor", made["pooled"], made["edited"], "-q", ends=2)
    assert "the same recording" in refused.err
    apart = cli.json("compare", made["recut"], made["bc"], "-q")
    assert codes(*apart["comparisons"]) == []


def test_a_log_before_the_calibration(made: dict[str, Path], tmp_path: Path, cli: Cli) -> None:
    said = cli.json("validate", made["b"], made["edited"], "-q", ends=0)
    assert said["verdict"] == "not contradicted"
    assert "log-before-calibration" in codes(said)
    applied = cli.json("apply", made["b"], made["edited"], "-o", tmp_path / "w.csv", "-q")
    assert "log-before-calibration" in codes(applied)


@pytest.mark.parametrize(
    ("pair", "code"),
    [(("ab", "pooled"), "compared-same-data"), (("ab", "bc"), "compared-overlapping")],
)
def test_the_same_data_are_no_second_result(
    made: dict[str, Path], pair: tuple[str, str], code: str, cli: Cli
) -> None:
    files = [made[name] for name in pair]
    (found,) = cli.json("compare", *files, "-q", ends=1)["comparisons"]
    assert (found["verified"], codes(found)) == (False, [code])
    assert found["p_value"] is None
    assert not any(value for row in found["en"] for value in row)
    assert "ompatible" not in cli("compare", *files, "-q").out
