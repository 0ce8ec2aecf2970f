"""Damaged and nonsensical files of every kind through the command line.

    python -m benchmarks.fuzz [CASES [SEED [KIND ...]]] > benchmarks/fuzz.md

A file of each kind is mutated and given to a command that reads it, in a process of its own: bytes
flipped, cut, doubled, put in and spliced with another file's; for text also cells and lines; for
YAML and JSON also their values, keys and types. Each run must end with a status of the contract,
within 20 s of processor time, without traceback, internal error or a library's warning.
"""

from __future__ import annotations

import copy
import json
import os
import random
import re
import resource
import signal
import sys
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.csv
import pyarrow.parquet as pq
import yaml

from benchmarks.edits import edits
from benchmarks.frame import heads, introduce, numbers, over, row, scratch
from tdfscal.cli import main as command_line
from tdfscal.commands.calibrate import calibrate
from tdfscal.commands.plan import plan
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.simulation import Recorder
from tests.files.logs.log_making import make_truth, mcap_bytes
from tests.files.logs.test_log_bag_kinds import ros1_bag, sqlite_bag

STATUSES = (0, 1, 2, 3, 4)
#: Processor time, s, that a run may take, and time by the clock, on a machine that others use too.
PATIENCE, HANGING = 20, 200
ODD_WORDS = (
    "", "nan", "inf", "-inf", "1e999", "1e308", "-0", "0x10", "1_000", "1,5", "٣", "=1+1", "'", '"',
    "#", "null", "~", "yes", "2026-02-30", "2026-11-21T02:00:00+25:00", "\x00", "\u2028", "\ud7ff",
    "-", "1e", "9" * 400, "*a", "&a [*a]", "!!python/object:os.system x", "{", "[", "- ", "\t",
)  # fmt: skip
ODD_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, 5e-324, float("nan"), float("inf"), 10**400, "", "x", "nan", [], {},
    [[]], {"a": 1}, [0, 0, 0], [1e308] * 3, "2026-11-21", "../../etc", "\x85",
)  # fmt: skip
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
    Kind("log.parquet", "C/log.parquet", "bytes",
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
    del content["content_sha256"]
    (home / "bare.json").write_text(json.dumps(content), encoding="utf-8")
    plan(home / "C" / "rig.yaml", output=home / "plan.csv", postures=4)
    (home / "log.mcap").write_bytes(mcap_bytes(make_truth(12)))
    sqlite_bag(home / "sql")
    ros1_bag(home / "ros1.bag")
    rig = yaml.safe_load((home / "C" / "rig.yaml").read_text(encoding="utf-8"))
    rig.pop("tracker")
    rig["log"] = {
        "supports": {
            name: {"position": f"/{name}/position.point", "force": f"/{name}/wrench.wrench.force"}
            for name in ("ncp1", "ncp2", "ncp3")
        }
    }
    (home / "bag.yaml").write_text(yaml.safe_dump(rig), encoding="utf-8")


def bytes_mutated(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """One to four changes of a file's bytes."""
    data = bytearray(raw)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at = rng.randrange(len(data) + 1)
        size = rng.choice((1, 2, 4, 8, 64, max(1, len(data) // 4)))
        chunk = rng.choice((b"\x00", b"\xff", b"\x7f\xff\xff\xff", b"\xff\xfe", b"\n", b"\x80")) * 2
        match rng.randrange(8):
            case 0 | 1:
                if at < len(data):
                    data[at] ^= 1 << rng.randrange(8)
            case 2:
                del data[at : at + size]
            case 3:
                data[at:at] = data[at : at + size]
            case 4:
                data[at : at + len(chunk)] = chunk
            case 5:
                data[at:at] = rng.randbytes(size % 65)
            case 6:
                data = data[:at]
            case _:
                other = rng.choice(others)
                start = rng.randrange(len(other) + 1)
                data[at : at + size] = other[start : start + size]
    return bytes(data)


def text_mutated(raw: bytes, rng: random.Random) -> bytes:
    """Cells or lines of a text changed."""
    lines = raw.decode("utf-8").split("\n")
    for _ in range(rng.choice((1, 1, 2, 5))):
        at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        cells = re.split(r"([,\s:]+)", lines[at])
        match rng.randrange(4):
            case 0 | 1:
                cells[rng.randrange(len(cells))] = rng.choice(ODD_WORDS)
                lines[at] = "".join(cells)
            case 2:
                lines[at] = "".join(cells[: rng.randrange(len(cells) + 1)])
            case _:
                lines[at], lines[other] = lines[other], lines[at]
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def document_mutated(raw: bytes, rng: random.Random, form: str) -> bytes:
    """Values, keys and types of a document changed."""
    document = yaml.safe_load(raw)
    for _ in range(rng.choice((1, 1, 2, 4))):
        if not document:
            break
        (edit,) = edits(document, 1, rng.randrange(1 << 30))
        document = edit.document
        if rng.random() < 0.6:
            inner: Any = document
            for part in edit.place[:-1]:
                inner = inner[part]
            if isinstance(inner, list) and edit.place[-1] == len(inner):
                continue
            inner[edit.place[-1]] = copy.deepcopy(rng.choice(ODD_VALUES))
    if form == "json":
        return json.dumps(document).encode()
    return str(yaml.safe_dump(document, sort_keys=False, allow_unicode=True)).encode()


def mutated(kind: Kind, raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """One mutation of a file, by bytes or by what its kind knows."""
    ways: list[Callable[[], bytes]] = [lambda: bytes_mutated(raw, rng, others)]
    if kind.form in ("yaml", "json"):
        ways += [lambda: document_mutated(raw, rng, kind.form)] * 2
    if kind.form in ("yaml", "json", "text"):
        ways.append(lambda: text_mutated(raw, rng))
    return rng.choice(ways)()


def run(words: list[str], said: Path) -> tuple[int, float, str]:
    """Status of a command line, its processor time, s, and what is wrong with its end, if anything.

    said : file for what it says.
    """
    sys.stdout.flush()
    child = os.fork()
    if not child:
        status = 0
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE + 5))
            signal.alarm(HANGING)
            sink = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(sink, 1)
            os.dup2(sink, 2)
            sys.argv = ["tdfscal", *words]
            command_line()
        except SystemExit as end:
            status = int(end.code or 0)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
    _, ended, used = os.wait4(child, 0)
    status, text = os.waitstatus_to_exitcode(ended), said.read_text("utf-8", "replace")
    fault = ""
    if status < 0:
        fault = f"ended by {signal.Signals(-status).name}"
    elif status not in STATUSES or "Traceback" in text or re.search(r"\w+Warning:", text):
        fault = f"status {status}: {text[-300:]}"
    return status, used.ru_utime + used.ru_stime, fault


def fuzzed(seed: int, job: tuple[Kind, int]) -> tuple[str, list[str]]:
    """The row of a kind, and its faults."""
    kind, cases = job
    ends, faults, slowest = Counter[int](), [], 0.0
    with scratch() as folder:
        home = folder / "files"
        home.mkdir()
        build(home)
        os.chdir(home)
        path = home / kind.file
        raw = path.read_bytes()
        others = [p.read_bytes() for p in sorted(home.rglob("*")) if p.is_file()]
        for case in range(cases):
            rng = random.Random(f"{kind.name} {seed} {case}")
            path.write_bytes(mutated(kind, raw, rng, others))
            words = rng.choice(kind.lines).split()
            status, seconds, fault = run(words, folder / "said")
            ends[status] += 1
            slowest = max(slowest, seconds)
            if fault:
                faults.append(f"{kind.name}, case {case}: {fault}")
        os.chdir("/")
    counts = (ends[status] for status in STATUSES)
    return row(kind.name, cases, *counts, f"{slowest:.1f}", len(faults)), faults


def main() -> None:
    """Print the table."""
    cases, seed = numbers(20_000, 0)
    kinds = [kind for kind in KINDS if not sys.argv[3:] or kind.name in sys.argv[3:]]
    total = sum(kind.weight for kind in KINDS)
    found = over(partial(fuzzed, seed), [(kind, cases * kind.weight // total) for kind in kinds])
    introduce("Damaged files", f"fuzz {cases} {seed}", __doc__)
    print("Columns 0 to 4 are exit statuses.\n")
    print(heads("file", "cases", *map(str, STATUSES), "slowest, s", "faults"))
    print("\n".join(line for line, _ in found))
    faults = [fault for _, several in found for fault in several]
    print("\nFaults: " + ("none" if not faults else ""))
    print("\n".join(f"- {fault}" for fault in faults))


if __name__ == "__main__":
    main()
