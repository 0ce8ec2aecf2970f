"""`simulate --scenario motion` and `calibrate --samples`, files in and file out."""

import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

import tdfscal
from tdfscal.commands.result import load_calibration
from tdfscal.errors import DataError, NotIdentifiableError
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.reporting.advice import advise
from tests.cli.running import Cli, recorded
from tests.reporting.samples import sketch


@pytest.fixture(scope="module")
def minute(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("motion") / "campaign"
    tdfscal.simulate(folder, scenario="motion", format="parquet", rate=100.0, seed=4)
    return folder


def test_a_log_without_a_stop_becomes_a_calibration(
    minute: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    sketch(monkeypatch)
    target = tmp_path / "result.yaml"
    seen = cli("calibrate", minute, "-o", target, "--html", tmp_path / "page.html", "-q", ends=0)
    truth = yaml.safe_load((minute / "truth.yaml").read_text(encoding="utf-8"))
    result = load_calibration(target)
    rpy = np.array([support["rpy"] for support in truth["supports"]])
    error = (result.rpy - rpy).ravel()
    assert np.sum((error / result.rpy_std.ravel()) ** 2) < 2 * chi2_quantile(1 - 1e-3, 9)
    assert result.motion is not None
    assert result.monte_carlo is not None
    assert result.monte_carlo.linear_interval_validated
    assert {quantity.name for quantity in result.taken_as_exact} >= {"base level"}
    moved = truth["scenario"]["options"]
    assert abs(result.motion.delay.value - moved["delay"]) < 4 * result.motion.delay.std
    assert abs(result.motion.friction.value - moved["friction"]) < 4 * result.motion.friction.std
    assert result.motion.seconds == pytest.approx(60.0, abs=0.5)
    residual = result.motion.residual
    assert (np.median(residual.after, axis=0) < 0.5 * np.median(residual.before, axis=0)).all()
    assert len(residual.time) == pytest.approx(60, abs=1)
    half = tdfscal.calibrate(minute, to=30.0, trials=0)
    assert half.observability is not None
    (forecast,) = half.observability.forecasts  # of what the whole minute has told
    assert forecast.amount == pytest.approx(result.motion.seconds, abs=0.2)
    assert forecast.worst_std == pytest.approx(result.rpy_std.max(), rel=0.25)
    assert half.rpy_std.max() > 1.35 * result.rpy_std.max()  # which 0.25 tells apart
    page = tmp_path / "validation.html"
    seen = cli("validate", target, minute, "--html", page, "-q", ends=0)
    assert "STILL VALID" not in seen.out
    assert "NOT CONTRADICTED" in seen.out
    assert (" ".join(seen.out.split()) + seen.err).count("went into this calibration") == 1
    assert page.read_text(encoding="utf-8").count("<svg") == 1
    check = tdfscal.validate(target, minute, samples="moving")
    assert set(check.to_dict()["motion"]) >= {"begin", "seconds", "rejected"}
    assert len(check.to_frame()) == len(result.motion.residual.time)
    with pytest.raises(DataError, match="no static dwell"):
        tdfscal.validate(target, minute, samples="static")


def test_a_sensor_that_turned_before_a_motion_is_named(minute: Path, tmp_path: Path) -> None:
    """By an update as by a history: the earlier angles do not make a contact of it."""
    known = tdfscal.calibrate(minute, trials=0)
    turned = shutil.copytree(minute, tmp_path / "turned")
    table = pq.read_table(turned / "log.parquet")
    names = [name for name in table.column_names if name.startswith("ncp2.f")]
    force = np.column_stack([table[name].to_numpy() for name in names])
    other = (force @ so3.exp(np.array([0.02, 0.0, 0.0]))).T
    table = recorded(table, dict(zip(names, other, strict=True)))
    pq.write_table(table, turned / "log.parquet")
    updated = tdfscal.update(known, turned, trials=0)
    (found,) = updated.reasons
    assert (found.code, found.subject) == ("campaigns-changed", ("ncp2",))
    assert found.size == pytest.approx(0.02, abs=1e-3)
    assert "by itself: turned" in (found.cure or "")  # what is known is a calibration already
    assert not updated.found("stretch-touched")
    # The angles are those of now: nothing that was known of the sensor holds them back.
    now, before = (np.array(c.to_dict()["supports"][1]["rotation"]) for c in (updated, known))
    assert np.linalg.norm(so3.log(now @ before.T)) == pytest.approx(0.02, abs=1e-3)


def test_supports_too_soft_to_squeeze_show_no_angle(tmp_path: Path) -> None:
    """Carriages that float carry constant vertical loads alone: exit 4, nothing written."""
    from dataclasses import replace

    from tdfscal.files.writers.campaign import write_run
    from tdfscal.simulation import MOVING, reference_rig, scenarios

    soft = replace(MOVING["approach"], stiffness=(1e4, 1e4, 150e6), rate=100.0)
    played = scenarios.run(reference_rig(), "approach", soft, np.random.default_rng(0))
    write_run(played, tmp_path / "soft", format="parquet")
    target = tmp_path / "result.yaml"
    with pytest.raises(NotIdentifiableError, match="does not determine"):
        tdfscal.calibrate(tmp_path / "soft", output=target)
    assert not target.exists()


def test_rests_and_moves_together_are_never_wider(tmp_path: Path) -> None:
    folder = tmp_path / "stops"
    tdfscal.simulate(folder, scenario="stops", format="parquet", rate=50.0, seed=2)
    dwells = tdfscal.calibrate(folder, trials=0)
    both = tdfscal.calibrate(folder, samples="all", trials=0)
    assert dwells.motion is None
    assert both.motion is not None
    assert both.motion.dwells >= 8
    assert np.all(both.rpy_std < 0.9 * dwells.rpy_std)
    truth = yaml.safe_load((folder / "truth.yaml").read_text(encoding="utf-8"))
    error = (both.rpy - np.array([support["rpy"] for support in truth["supports"]])).ravel()
    assert np.sum((error / both.rpy_std.ravel()) ** 2) < 2 * chi2_quantile(1 - 1e-3, 9)
    assert dwells.observability is not None
    assert dwells.observability.with_moves == pytest.approx(
        np.sqrt(np.mean(both.rpy_std**2)), rel=0.1
    )
    assert any("--samples all" in sentence for sentence in advise(dwells))


def test_an_approach_goes_on_from_what_is_known(minute: Path, tmp_path: Path) -> None:
    """On another rig, whose two stops fit two mountings: its moves tell, and all sensors turned."""
    tdfscal.simulate(tmp_path / "two", scenario="approach", format="parquet", rate=100.0, seed=3)
    updated = tdfscal.update(tdfscal.calibrate(minute, trials=0), tmp_path / "two", trials=0)
    assert {found.subject for found in updated.reasons if found.code == "campaigns-changed"}
    assert updated.motion is not None


def test_two_postures_are_said_to_be_too_few(tmp_path: Path) -> None:
    """At rest two mountings explain them; their moves stand for them, and say for how many."""
    tdfscal.simulate(tmp_path, postures=2, format="parquet", rate=50.0)
    moved = tdfscal.calibrate(tmp_path, trials=0)
    (few,) = moved.found("dwells-few")
    assert few.size == 2
    assert any(few.cure and few.cure in said.lower() for said in advise(moved))
    sample = Path(__file__).parents[2] / "sample_data" / "csv"
    with pytest.raises(NotIdentifiableError) as refused:
        tdfscal.calibrate(sample, to="+13", samples="static", trials=0)
    assert refused.value.finding.values["few"] == 2
