"""Whole files of every kind for `benchmarks.fuzz`, small, and the commands that read them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pyarrow.csv
import pyarrow.parquet as pq
import yaml
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.simulation import Recorder
from tdfscal.workflows.calibrate import calibrate
from tdfscal.workflows.plan import plan
from tests.files.logs.log_making import STORE, make_truth, mcap_bytes
from tests.files.logs.test_log_bag_kinds import ROS1, as_ros1, events

TABLE = (
    "info C/{0} --rig C/rig.yaml -q",
    "calibrate C/{0} --rig C/rig.yaml --trials 0 -o x.yaml -q",
)
BAG = ("info {0} --rig bag.yaml -q", "info {0} -q")


@dataclass(frozen=True)
class Kind:
    """A file that is mutated, the form that its mutations know, the commands that read it."""

    name: str
    file: str
    form: str
    lines: tuple[str, ...]
    weight: int = 2


KINDS = (
    Kind("rig.yaml", "C/rig.yaml", "yaml", (
        "calibrate C/log.csv --rig C/rig.yaml --trials 0 -o x.yaml -q",
        "info C/log.csv --rig C/rig.yaml -q",
        "calibrate C/log.csv --rig C/rig.yaml --method tracker --trials 0 -o x.yaml -q",
    ), 4),
    Kind("log.csv", "C/log.csv", "text", tuple(line.format("log.csv") for line in TABLE), 4),
    Kind("log.parquet", "C/log.parquet", "parquet",
         tuple(line.format("log.parquet") for line in TABLE), 3),
    Kind("log.mcap", "log.mcap", "bytes", tuple(line.format("log.mcap") for line in BAG), 3),
    Kind("bag, SQLite", "sql/sql.db3", "bytes", tuple(line.format("sql") for line in BAG)),
    Kind("bag, metadata", "sql/metadata.yaml", "yaml", tuple(line.format("sql") for line in BAG)),
    Kind("ROS 1 bag", "ros1.bag", "bytes", tuple(line.format("ros1.bag") for line in BAG)),
    Kind("points", "C/tracker/targets.csv", "text", (
        "register C/tracker/targets.csv C/tracker/nominal.csv",
        "calibrate C/log.csv --rig C/rig.yaml --method tracker --trials 0 -o x.yaml -q",
    ), 3),
    Kind("calibration.yaml", "c.yaml", "yaml", (
        "report c.yaml", "export c.yaml --to csv",
        "apply c.yaml C/log.csv --rig C/rig.yaml -o w.csv -q",
    ), 3),
    Kind("calibration.json", "c.json", "json", (
        "report c.json", "compare c.json c.yaml", "validate c.json C/log.csv --rig C/rig.yaml -q",
    ), 3),
    Kind("calibration without digest", "bare.json", "json", (
        "report bare.json", "compare bare.json c.yaml", "export bare.json --to ros",
        "validate bare.json C/log.csv --rig C/rig.yaml -q",
        "apply bare.json C/log.csv --rig C/rig.yaml -o w.csv -q",
    ), 4),
    Kind("plan", "plan.csv", "text", ("info plan.csv -q", "info plan.csv --rig C/rig.yaml -q"), 1),
)  # fmt: skip


def build(home: Path) -> None:
    """Fill a folder with all that the commands name."""
    simulate_to_folder(
        home / "C", postures=12, rows="postures", seed=1, recorder=Recorder(mean_sd=0.05)
    )
    pq.write_table(pyarrow.csv.read_csv(home / "C" / "log.csv"), home / "C" / "log.parquet")
    found = calibrate([home / "C" / "log.csv"], rig=home / "C" / "rig.yaml", trials=20)
    for name in ("c.yaml", "c.json"):
        found.save(home / name)

    content = json.loads((home / "c.json").read_text(encoding="utf-8"))
    del content["content_sha256"], content["rig"]["content_sha256"]
    (home / "bare.json").write_text(json.dumps(content), encoding="utf-8")
    plan(home / "C" / "rig.yaml", output=home / "plan.csv", postures=4)
    _recordings(home)


def _recordings(home: Path) -> None:
    (home / "log.mcap").write_bytes(mcap_bytes(make_truth(12)))
    with Writer2(home / "sql", version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        _write(bag, STORE)
    with Writer1(home / "ros1.bag") as bag:
        _write(bag, ROS1)
    rig = yaml.safe_load((home / "C" / "rig.yaml").read_text(encoding="utf-8"))
    rig.pop("tracker")
    rig["log"] = {
        "supports": {
            name: {"position": f"/{name}/position.point", "force": f"/{name}/wrench.wrench.force"}
            for name in ("ncp1", "ncp2", "ncp3")
        }
    }
    (home / "bag.yaml").write_text(yaml.safe_dump(rig), encoding="utf-8")


def _write(bag: Writer1 | Writer2, store: object) -> None:
    topics: dict[str, object] = {}
    for t, topic, kind, data in list(events())[::5]:
        if topic not in topics:
            topics[topic] = bag.add_connection(topic, kind, typestore=store)  # type: ignore[arg-type]
        raw = bytes(as_ros1(data, kind)) if store is ROS1 else data
        bag.write(topics[topic], round(t * 1e6) * 1000, raw)  # type: ignore[arg-type]
