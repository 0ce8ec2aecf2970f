"""A calibration of another rig, a part of a log that it has not seen, and readings cut off."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

import tdfscal
from tests.cli.running import SAMPLES, Cli, recorded


def test_compare_verifies_nothing_of_hinges_that_differ_by_3_mm(tmp_path: Path, cli: Cli) -> None:
    """Two rigs simulated from rig files that differ in one hinge alone, in the plane of all."""
    rig = yaml.safe_load((SAMPLES / "parquet" / "rig.yaml").read_text(encoding="utf-8"))
    rig.pop("log", None)
    made = []
    for shift in (0.0, 3e-3):  # out of it only the drawing's frame would lean
        rig["supports"][1]["hinge"][0] += shift
        stated = tmp_path / f"rig{shift}.yaml"
        stated.write_text(yaml.safe_dump(rig), encoding="utf-8")
        tdfscal.simulate(tmp_path / f"at{shift}", rig=stated, seed=3, postures=8, rate=20.0)
        made.append(tmp_path / f"at{shift}.yaml")
        tdfscal.calibrate(tmp_path / f"at{shift}", trials=0, output=made[-1])
    found = cli.json("compare", *made, "-q", ends=1)["findings"]
    assert "compared-other-rig" in {each["code"] for each in found}


def test_a_rig_that_contradicts_the_calibrated_one_is_an_error(campaign: Path, cli: Cli) -> None:
    own = campaign / "own.yaml"
    tdfscal.calibrate(campaign, trials=0, output=own)
    rig = yaml.safe_load((campaign / "rig.yaml").read_text(encoding="utf-8"))
    rig["supports"][1]["hinge"][0] += 3e-3
    (campaign / "rig.yaml").write_text(yaml.safe_dump(rig), encoding="utf-8")
    error = cli.json("validate", own, campaign, "-q", ends=2)["error"]
    assert (error["code"], "hinge of ncp2" in error["message"]) == ("rig-uncalibrated", True)


def test_only_a_part_that_was_not_seen_proves_a_calibration(campaign: Path, cli: Cli) -> None:
    """Ten of sixteen postures went in, the last of them cut: its other part was not seen."""
    own = campaign / "own.yaml"
    cli("calibrate", campaign, "--to", "+65", "--trials", 0, "-o", own, "-q", ends=0)
    for part, verdict, postures in (
        (["--from", "+65"], "still valid", 7),
        (["--to", "+65"], "not contradicted", 10),
        ([], "still valid", 6),
    ):
        said = cli.json("validate", own, campaign, *part, "-q", ends=0)
        assert (said["verdict"], said["postures"]) == (verdict, postures)


@pytest.mark.parametrize("share", [0.8, 0.7])
def test_readings_cut_off_at_no_stated_capacity(share: float, campaign: Path, cli: Cli) -> None:
    """Postures at the end of the range are left out by its name; where all stand there, refused."""
    own, log = campaign / "own.yaml", campaign / "log.parquet"
    tdfscal.calibrate(campaign, trials=0, output=own)
    table = pq.read_table(log)
    force = table["ncp2.fy"].to_numpy()
    limit = np.quantile(np.abs(force), share)
    pq.write_table(recorded(table, {"ncp2.fy": np.clip(force, -limit, limit)}), log)
    calibrate = ("calibrate", campaign, "--trials", 0, "-o", campaign / "no.yaml", "-q")
    if share < 0.8:
        for command in (calibrate, ("validate", own, campaign, "-q")):
            assert cli.json(*command, ends=3)["error"]["code"] == "axis-saturated"
    else:
        made, checked = cli.json(*calibrate, ends=1), cli.json("validate", own, campaign, ends=0)
        found = [each for each in made["fit"]["rejected"] if each["code"] == "posture-saturated"]
        (left,) = (f for f in checked["findings"] if f["code"] == "postures-left-out")
        assert len(found) == left["size"] == 4
    assert not (campaign / "no.yaml").exists()
