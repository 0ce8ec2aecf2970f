"""Files for every outcome of every command: campaigns, calibrations, points, sound and faulty."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from tdfscal.commands.calibrate import calibrate
from tdfscal.files.calibration.document import Calibration, save_calibration
from tests.cli.running import SAMPLES, recorded
from tests.words import found


def build(home: Path) -> None:
    """Fill a folder; the names of the files are those of the table of cases."""
    _campaigns(home)
    _calibrations(home)
    _points(home)
    (home / "out").mkdir()
    (home / "hollow").mkdir()
    for name in ("kept.yaml", "kept.csv"):
        (home / "out" / name).write_text("kept")
    (home / "empty.csv").write_text("")
    (home / "move.csv").write_text("header\n" + ",".join(["0"] * 9 + ["0.01"] * 3) + "\n")


def _campaigns(home: Path) -> None:
    shutil.copytree(SAMPLES / "parquet", home / "campaign")
    table = pq.read_table(home / "campaign" / "log.parquet")
    for name in ("strict", "badrig", "turned", "brief", "damaged"):
        (home / name).mkdir()
        shutil.copy(home / "campaign" / "rig.yaml", home / name)
        pq.write_table(table, home / name / "log.parquet")
    _edit(home / "strict" / "rig.yaml", lambda d: d["acceptance"].update(angle_std=1e-6))
    _edit(home / "badrig" / "rig.yaml", lambda d: d["terminal"].update(mass=-5))
    pq.write_table(_turned(table), home / "turned" / "log.parquet")
    pq.write_table(table.slice(0, 150), home / "brief" / "log.parquet")
    log = home / "damaged" / "log.parquet"
    log.write_bytes(log.read_bytes()[:-100])


def _turned(table: pa.Table) -> pa.Table:
    """The log of a rig whose first sensor was turned by 20 mrad since, all tared by 0.4 N anew."""
    force = {n: table[n].to_numpy() + 0.4 for n in table.column_names if n[-2:-1] == "f"}
    x, z = force["ncp1.fx"], force["ncp1.fz"]
    c, s = np.cos(0.02), np.sin(0.02)
    return recorded(table, force | {"ncp1.fx": c * x + s * z, "ncp1.fz": c * z - s * x})


def _calibrations(home: Path) -> None:
    own = calibrate([home / "campaign"], trials=0)
    survey = calibrate([home / "campaign"], method="tracker", trials=0)
    document: dict[str, Any] = own.model_dump()
    document |= {"status": "rejected", "findings": [found("a reason", "rejects")]}
    save_calibration(own, home / "own.yaml")
    save_calibration(survey, home / "survey.json")
    save_calibration(Calibration.model_validate(document), home / "rejected.yaml")
    (home / "broken.yaml").write_text("format: tdfscal-calibration/1\nstatus: maybe\n")


def _points(home: Path) -> None:
    rng = np.random.default_rng(1)
    cloud = rng.uniform(-1e3, 1e3, (6, 3))
    line = np.outer(np.arange(6.0), [100.0, 0.0, 0.0])
    for name, points, unit in (
        ("points", cloud, " [mm]"),
        ("moved", cloud + [1.0, 2.0, 3.0] + 0.01 * rng.normal(size=cloud.shape), " [mm]"),
        ("line", line, " [mm]"),
        ("unitless", cloud, ""),
    ):
        rows = [f"jig,P{i},{x!r},{y!r},{z!r}" for i, (x, y, z) in enumerate(points.tolist())]
        header = "group,point," + ",".join(f"{axis}{unit}" for axis in "xyz")
        (home / f"{name}.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")


def _edit(path: Path, change: Any) -> None:
    document = yaml.safe_load(path.read_text())
    change(document)
    path.write_text(yaml.safe_dump(document, sort_keys=False))
