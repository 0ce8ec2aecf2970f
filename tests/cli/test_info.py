"""`tdfscal info`: its mapping pasted into a rig file; units that cannot be, clocks of no use."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import tdfscal
from tdfscal.dwells import offset_finding
from tdfscal.files.rig.reading import load_rig
from tdfscal.logs import read_log
from tests.cli.running import SAMPLES, Cli
from tests.files.logs.log_making import (
    STAMPED,
    SUPPORTS,
    point_stamped,
    small_mcap,
    wrench_stamped,
    write,
)

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


NAMES, *_ = (SAMPLES / "csv/log.csv").read_text().splitlines()
ROWS = np.loadtxt(SAMPLES / "csv/log.csv", delimiter=",", skiprows=1)[:1500]
POSITIONS = [6 * i + k for i in range(3) for k in (1, 2, 3)]


def written(folder: Path, rows: np.ndarray, header: str = NAMES, *, block: bool = False) -> Path:
    """A folder with a log and the sample's rig file, with its log block or without."""
    folder.mkdir()
    document = yaml.safe_load((SAMPLES / "csv/rig.yaml").read_text())
    document.pop("tracker")
    if not block:
        document.pop("log")
    (folder / "rig.yaml").write_text(yaml.safe_dump(document))
    lines = [",".join(f"{x:.9g}" for x in row) for row in rows]
    (folder / "log.csv").write_text("\n".join([header, *lines]) + "\n")
    return folder


def scaled(columns: list[int], factor: float) -> np.ndarray:
    rows = ROWS.copy()
    rows[:, columns] *= factor
    return rows


def told(cli: Cli, path: Path) -> dict[str, Any]:
    found: dict[str, Any] = cli.json("info", path, ends=0)
    return found


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ns", 1e9)])
def test_unit_of_time_by_the_interval(cli: Cli, tmp_path: Path, unit: str, factor: float) -> None:
    folder = written(tmp_path / "alone", scaled([0], factor), NAMES.replace("t_s", "clock"))
    (folder / "rig.yaml").unlink()
    found = told(cli, folder / "log.csv")
    assert found["mapping"]["log"]["time"] == {"field": "clock", "unit": unit}
    assert {round(s["rate"]) for s in found["signals"]} == {50}
    assert any(note.startswith(f"time unit: {unit}, as") for note in found["mapping_notes"])


def test_a_rig_file_with_the_wrong_unit_of_time(cli: Cli, tmp_path: Path) -> None:
    found = told(cli, written(tmp_path / "ms", scaled([0], 1e3), block=True))
    assert any("a sample every 20 s" in problem for problem in found["problems"])
    found = told(cli, written(tmp_path / "s", ROWS, block=True))
    assert found["problems"] == []


@pytest.mark.parametrize(
    ("length", "force", "said", "known"),
    [
        ("µm", "N", "the NCPs are 0.001039 m apart", True),
        ("m", "N", "the NCPs are 1039 m apart", False),
        ("mm", "kN", "the forces add up to 4.9", True),
        ("mm", "kN", "the forces add up to 4.9", False),
        ("mm", "N", None, False),
    ],
)
def test_units_of_the_header_that_cannot_be(
    cli: Cli, tmp_path: Path, length: str, force: str, said: str | None, known: bool
) -> None:
    cells = [
        f"{name} [{length}]" if "Pos" in name else f"{name} [{force}]" if "_F" in name else name
        for name in NAMES.split(",")
    ]
    folder = written(tmp_path / "units", ROWS, ",".join(cells))
    if not known:
        (folder / "rig.yaml").unlink()
    found = told(cli, folder if known else folder / "log.csv")
    assert found["mapping"]["log"]["length_unit"] == {"µm": "um"}.get(length, length)
    assert found["mapping"]["log"]["force_unit"] == force
    doubts = [p for p in found["problems"] if "check the header" in p]
    assert len(doubts) == (said is not None)
    assert said is None or said in doubts[0]


@pytest.mark.parametrize(
    ("stamp", "why"),
    [
        (lambda k, t: 0.0, "repeat the time of the sample before"),
        (lambda k, t: t // 1.0, "repeat the time of the sample before"),
        (lambda k, t: t + 3.0 * (k > 100), "depart"),
    ],
)
def test_header_times_that_cannot_be_used(
    cli: Cli, tmp_path: Path, stamp: Callable[[int, float], float], why: str
) -> None:
    """Those of one topic."""
    messages = []
    for k in range(200):
        when = 100.0 + 0.02 * k
        for name in SUPPORTS:
            header = stamp(k, when) if name == "ncp2" else when
            for topic, data in (
                ("position", point_stamped(when, (1.0, 2.0, 3.0))),
                ("wrench", wrench_stamped(header, (4.0, 5.0, 6.0))),
            ):
                messages.append((f"/{name}/{topic}", round(when * 1e9), data))
    kinds = {"position": STAMPED["/p"], "wrench": STAMPED["/f"]}
    channels = {f"/{name}/{topic}": kinds[topic] for name in SUPPORTS for topic in kinds}
    found = told(cli, write(tmp_path / "log.mcap", small_mcap(channels, messages)))
    assert found["mapping"]["log"]["time"] == {"source": "log"}
    note = next(n for n in found["mapping_notes"] if n.startswith("time source: log"))
    assert why in note
    assert "/ncp2/wrench" in note
    assert {round(s["rate"]) for s in found["signals"]} == {50}


@pytest.mark.parametrize("rows", [-200, 3, 25])
def test_forces_of_any_lag_are_seen(tmp_path: Path, rows: int) -> None:
    """From some hundredths of a second, by the moves, to seconds, by the balance."""
    whole = np.loadtxt(SAMPLES / "csv/log.csv", delimiter=",", skiprows=1)
    late = np.roll(whole, rows, axis=0)
    late[:, [0, *POSITIONS]] = whole[:, [0, *POSITIONS]]
    kept = slice(max(rows, 0), min(rows, 0) or None)
    found = tdfscal.info(written(tmp_path / "late", late[kept], block=True)).description
    lag = offset_finding(found.offset) if found.offset else found.lag
    assert lag is not None
    assert lag.size == pytest.approx(abs(rows) * 0.02, abs=0.02)
    assert lag.values["late"] is (rows > 0)
