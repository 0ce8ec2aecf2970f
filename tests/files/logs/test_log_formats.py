"""The same samples in every format, container and layout: read to the bit, and described."""

import csv
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import CompressionType, IndexType
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin

from tdfscal.files.rig.recorders import LogBlock
from tdfscal.logs import is_log, read_log
from tdfscal.logs.describe import describe_logs
from tests.files.logs.log_making import (
    JSON_MAPPING,
    MAPPING,
    SUPPORTS,
    Truth,
    assert_holds,
    make_truth,
    mcap_bytes,
    rosbag2,
    table,
    topics,
)
from tests.files.logs.test_log_bag_kinds import ros1_bag, without_definitions

Writing = Callable[[Path, Truth], object]


@dataclass(frozen=True)
class Form:
    """How a log is written into `log` with this suffix, and what holds of it.

    mapping : None where columns have the default names, all at one rate.
    """

    suffix: str
    write: Writing
    mapping: LogBlock | None = None
    integrity: str = "unverified"


def savetxt(head: str, delimiter: str = " ", comments: str = "# ") -> Writing:
    def write(path: Path, truth: Truth) -> None:
        frame = table(truth)
        header = head + delimiter.join(frame.columns)
        np.savetxt(path, frame, header=header, comments=comments, delimiter=delimiter)

    return write


def aligned(path: Path, truth: Truth) -> None:
    text = table(truth).to_string(index=False, float_format=lambda x: f"{x:.17g}")
    path.write_text("recorded on the rig\n\n" + text + "\n")


def rtde(path: Path, truth: Truth) -> None:
    with path.open("w", newline="") as file:
        rows = [list(table(truth).columns), *table(truth).to_numpy().tolist()]
        csv.writer(file, delimiter=" ").writerows(rows)


def labview(path: Path, truth: Truth) -> None:
    head = "LabVIEW Measurement\t\nWriter_Version\t2\n***End_of_Header***\t\n"
    rows = table(truth).to_csv(sep="\t", index=False).replace("ncp3.fz\n", "ncp3.fz\tComment\n")
    path.write_text(head + rows)


def parquet(**how: Any) -> Form:
    def write(path: Path, truth: Truth) -> None:
        columns = pa.Table.from_pandas(table(truth).assign(note="text"))
        pq.write_table(columns, path, row_group_size=17, **how)

    # pyarrow does not say which pages it checked.
    return Form(".parquet", write)


def mcap(integrity: str = "verified", mapping: LogBlock = MAPPING, **how: Any) -> Form:
    def write(path: Path, truth: Truth) -> None:
        path.write_bytes(mcap_bytes(truth, **how))

    return Form(".mcap", write, mapping, integrity)


def sqlite(version: Any, source: Any) -> Form:
    def write(path: Path, truth: Truth) -> None:
        rosbag2(path, truth, StoragePlugin.SQLITE3, version)

    return Form("", write, topics("wrench.wrench.force", time={"source": source}))


def bag(compressed: bool) -> Form:
    def write(path: Path, truth: Truth) -> None:
        rosbag2(path, truth, StoragePlugin.MCAP, compressed=compressed)

    return Form("", write, MAPPING)


def ros1(compression: Writer1.CompressionFormat | None = None, restarts: int = 0) -> Form:
    """restarts : of the publishers, with a connection each."""

    def write(path: Path, truth: Truth) -> None:
        ros1_bag(path, compression, truth, restarts=restarts)

    return Form(".bag", write, MAPPING)


def older(path: Path, truth: Truth) -> None:
    without_definitions(rosbag2(path, truth, StoragePlugin.SQLITE3))


FORMS = {
    "csv": Form(".csv", lambda path, truth: table(truth).to_csv(path, index=False)),
    "numpy": Form(".txt", savetxt("")),
    "matlab": Form(".dat", savetxt("", "\t", "% ")),
    "aligned": Form(".log", aligned),
    "rtde": Form(".csv", rtde),
    "labview": Form(".txt", labview),
    **{
        f"parquet {plain} {version}": parquet(
            write_page_checksum=plain, use_dictionary=plain, data_page_version=version
        )
        for plain in (True, False)
        for version in ("1.0", "2.0")
    },
    **{
        f"mcap {compression.name} {summary}": mcap(
            "verified" if summary else "unverified",
            compression=compression, index_types=index, summary=summary,
        )
        for compression, index in (
            (CompressionType.ZSTD, IndexType.ALL),
            (CompressionType.LZ4, IndexType.NONE),
            (CompressionType.NONE, IndexType.MESSAGE),
        )
        for summary in (True, False)
    },
    **{
        f"unchunked {summary} {crc}": mcap(
            "verified" if crc else "unverified",
            use_chunking=False, summary=summary, enable_data_crcs=crc,
        )
        for summary in (True, False)
        for crc in (True, False)
    },
    "json": mcap(mapping=JSON_MAPPING, encoding="json"),
    "two layouts": mcap(frames=("a", "bb")),
    "a long and an empty name": mcap(frames=("", "x" * 300)),
    "forty layouts": mcap(frames=tuple("x" * k for k in range(40))),
    "rosbag2": bag(compressed=False),
    "rosbag2 compressed": bag(compressed=True),
    "sqlite 8": sqlite(8, "header"),
    "sqlite 9": sqlite(9, "log"),
    "sqlite published": sqlite(9, "publish"),
    "sqlite before Iron": Form("", older, MAPPING),
    "ros1": ros1(),
    "ros1 bz2": ros1(Writer1.CompressionFormat.BZ2),
    "ros1 lz4": ros1(Writer1.CompressionFormat.LZ4),
    "ros1 started again": ros1(restarts=2),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_every_form_reads_to_the_same_and_is_described(tmp_path: Path, form: Form) -> None:
    path, truth = tmp_path / f"log{form.suffix}", make_truth()
    form.write(path, truth)
    if form.mapping is None:
        truth = replace(truth, force_time=truth.time, force=truth.force[:, ::4])
    assert is_log(path)
    log = read_log([path], form.mapping, SUPPORTS)
    assert_holds(log, truth)
    assert log.findings == ()
    for given in log.inputs:
        content = Path(given.path).read_bytes()
        assert (given.bytes, given.integrity) == (len(content), form.integrity)
        assert given.sha256 == hashlib.sha256(content).hexdigest()
    info = describe_logs([path])
    assert info.guess.supports == SUPPORTS
    seen = [signal.count for signal in info.signals]
    assert seen == 3 * [truth.time.size] + 3 * [truth.force_time.size]
