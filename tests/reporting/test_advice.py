"""The first advice is the cure: followed by its words alone, it ends in angles that are true."""

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from benchmarks.advice import cases, led
from tdfscal import calibrate
from tdfscal.errors import DataError
from tdfscal.numerics.distributions import chi2_sf

SEED = 7
#: That sound angles fail: d² over nine angles, one of a hundred thousand.
CHANCE = 1e-5
QUICK = ("hinge friction 0.5 N·m", "axis freezes at posture 9", "positions in mm and dead axis")


def _check(name: str) -> None:
    outcomes = led(cases()[name], SEED)
    last = outcomes[-1]
    assert outcomes[0].verdict != "accepted"
    assert last.verdict == "accepted", [outcome.advice for outcome in outcomes]
    assert chi2_sf(last.distance * last.angles, last.angles) > CHANCE


@pytest.mark.parametrize(
    "name", [QUICK[0], *(pytest.param(name, marks=pytest.mark.slow) for name in QUICK[1:])]
)
def test_the_first_advice_leads_to_true_angles(name: str) -> None:
    _check(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(cases().keys() - {*QUICK, "none"}))
def test_so_it_does_for_every_other_fault(name: str) -> None:
    if led(cases()[name], SEED)[0].verdict != "accepted":
        _check(name)


@pytest.mark.parametrize("channel", ["NCP1_ActPosY", "TDFS2_Fy", "TDFS1_Fx TDFS3_Fz", "1 2 1 2"])
def test_the_line_that_a_refusal_writes_mends_the_rig_file(
    channel: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """An axis of opposite sign, or two whole supports exchanged; in a log of lengths in mm."""
    folder = Path(__file__).parents[2] / "sample_data" / "csv"
    head, *rows = csv.reader((folder / "log.csv").read_text().splitlines())
    sign = [-1.0 if name in channel.split() else 1.0 for name in head]
    if channel[0] == "1":
        head = [re.sub("(NCP|TDFS)([12])_", lambda m: f"{m[1]}{3 - int(m[2])}_", h) for h in head]
    turned = [[s * float(cell) for s, cell in zip(sign, row, strict=True)] for row in rows]
    with (tmp_path / "log.csv").open("w", newline="") as file:
        csv.writer(file).writerows([head, *turned])
    rig: dict[str, Any] = yaml.safe_load((folder / "rig.yaml").read_text())
    del rig["tracker"]
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    with pytest.raises(DataError) as caught:
        calibrate(tmp_path, trials=0)
    lines = re.findall(r"`log.supports.(\w+).(\w+): (\[[-\w., ]+\])`", str(caught.value))
    assert len(lines) == len(channel.split())
    for name, key, factors in lines:
        rig["log"]["supports"][name][key] = yaml.safe_load(factors)
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    assert np.allclose(calibrate(tmp_path, trials=0).rpy, request.getfixturevalue("sample").rpy)
