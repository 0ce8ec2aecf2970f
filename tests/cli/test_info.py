"""`tdfscal info`: on files never seen before, and its mapping pasted into a rig file."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from tdfscal.files.rig.reading import load_rig
from tdfscal.logs import read_log
from tests.cli.running import SAMPLES, Cli

LOGS = [SAMPLES / "csv/log.csv", SAMPLES / "parquet/log.parquet", SAMPLES / "mcap/log.mcap"]


@pytest.mark.parametrize("log", LOGS, ids=lambda p: p.suffix)
def test_the_guess_reads_as_the_rig_file(cli: Cli, tmp_path: Path, log: Path) -> None:
    found = cli.json("info", log, ends=0)
    assert found["problems"] == []
    own = log.parent / "rig.yaml"
    document = yaml.safe_load(own.read_text())
    document.pop("log", None)
    document.pop("tracker", None)
    pasted = tmp_path / "rig.yaml"
    pasted.write_text(yaml.safe_dump(document) + found["mapping_yaml"])
    stated, guessed = load_rig(own), load_rig(pasted)
    a = read_log([log], stated.log, stated.rig.supports)
    b = read_log([log], guessed.log, guessed.rig.supports)
    for one, other in zip((*a.position, *a.force), (*b.position, *b.force), strict=True):
        np.testing.assert_array_equal(one.time, other.time)
        np.testing.assert_array_equal(one.value, other.value)
    assert yaml.safe_load(found["mapping_yaml"]) == found["mapping"]


def odd(tmp_path: Path, header: str, separator: str, factor: float, comma: bool) -> Path:
    """The sample log with other names, units and numbers; 40 s of it."""
    rows = np.loadtxt(SAMPLES / "csv/log.csv", delimiter=",", skiprows=1)[:2000]
    order = [0, *(6 * i + k for i in range(3) for k in (1, 2, 3, 4, 5, 6))]
    rows = rows[:, order]
    rows[:, 0] *= 1e3
    for i in range(3):
        rows[:, 6 * i + 4 : 6 * i + 7] *= factor
    path = tmp_path / "odd.csv"
    lines = [header, *(separator.join(f"{x:.9g}" for x in row) for row in rows)]
    text = "\n".join(lines) + "\n"
    path.write_text(text.replace(".", ",") if comma else text)
    return path


def test_sensor_side_kilonewtons_milliseconds_and_decimal_commas(cli: Cli, tmp_path: Path) -> None:
    names = [f"{kind}{s}_{x}" for s in "123" for kind in ("Pos", "F") for x in "XYZ"]
    path = odd(tmp_path, ";".join(["Zeit_t_ms", *names]), ";", -1e-3, True)
    found = cli.json("info", path)
    assert found["mapping"]["log"] == {
        "time": {"field": "Zeit_t_ms", "unit": "ms"},
        "length_unit": "mm",
        "force_unit": "kN",
        "force_on": "sensor",
        "decimal": ",",
        "supports": {
            f"ncp{s}": {
                "position": [f"Pos{s}_{x}" for x in "XYZ"],
                "force": [f"F{s}_{x}" for x in "XYZ"],
            }
            for s in "123"
        },
    }
    assert found["dwells"]["count"] >= 4


def test_what_is_no_campaign_is_still_described(cli: Cli, tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("time,temperature,note\n0,20.5,on\n1,20.6,off\n")
    result = cli("info", path, ends=0)
    assert "temperature" in result.out
    assert "no mapping is guessed" in result.out
