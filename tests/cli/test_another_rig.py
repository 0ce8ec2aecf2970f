"""A calibration of another rig, and a part of a log that it has not seen."""

from pathlib import Path

import yaml

import tdfscal
from tests.cli.running import SAMPLES, Cli


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
