"""Parquet logs."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tdfscal.errors import DataError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.logs import read_log
from tdfscal.logs.describe import describe_logs
from tdfscal.records import Log

ONE = ("a",)
FIELDS = {"supports": {"a": {"position": "p", "force": "f"}}}
DEFAULT = ("a.x", "a.y", "a.z", "a.fx", "a.fy", "a.fz")


def plain(**changes: Any) -> dict[str, Any]:
    columns: dict[str, Any] = {"time": np.array([0.0, 1.0, 2.0])}
    columns |= {name: np.arange(3.0) + k for k, name in enumerate(DEFAULT)}
    return columns | changes


def read(tmp_path: Path, columns: dict[str, Any], mapping: LogBlock | None = None) -> Log:
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(columns), path)
    return read_log([path], mapping, ONE)


def test_number_types_and_timestamps(tmp_path: Path) -> None:
    columns = plain(time=pd.to_datetime([1000, 2000, 3000], unit="ms"))
    columns["a.x"] = np.array([1, 2, 3], dtype=np.int32)
    columns["a.y"] = np.array([0.5, 1.5, 2.5], dtype=np.float32)
    log = read(tmp_path, columns)
    np.testing.assert_array_equal(log.position[0].time, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(log.position[0].value[:, :2], [[1, 0.5], [2, 1.5], [3, 2.5]])


@pytest.mark.parametrize(
    ("columns", "match"),
    [
        (plain(**{"a.x": pa.array([1.0, None, 2.0])}), r"column a\.x, row 1: the cell is empty"),
        (plain(**{"a.fz": [1.0, 2.0, np.inf]}), r"column a\.fz, row 2: inf is not a finite"),
        (plain(**{"a.fz": ["1", "2", "3"]}), r"column a\.fz holds string, not numbers"),
        (plain(**{"a.fz": [True, False, True]}), r"column a\.fz holds bool, not numbers"),
        (plain(**{"a.fz": pa.array([b"x" * 40] * 3, pa.binary(40))}), r"a\.fz holds bytes, not"),
        (plain(time=pa.array([0.0, 1.0, None])), "column time, row 2: the cell is empty"),
        ({k: v for k, v in plain().items() if k != "a.fy"}, r"no column a\.fy; the nearest"),
        (
            {k: v for k, v in plain().items() if k != "a.fy"} | {"a.fy": [[1.0]] * 3},
            r"no column a\.fy; the nearest that it has",
        ),
        ({k: v for k, v in plain().items() if k != "time"}, "no column time"),
        ({k: v[:0] for k, v in plain().items()}, "has no rows"),
        (plain(a=[{"x": 1.0}] * 3), r"column a\.x is there 2 times"),
    ],
)
def test_faults_are_named(tmp_path: Path, columns: dict[str, Any], match: str) -> None:
    with pytest.raises(DataError, match=match):
        read(tmp_path, columns)


@pytest.mark.parametrize("size", [64, 1 << 20])
def test_streams_that_take_turns(tmp_path: Path, size: int) -> None:
    """Nulls in all cells of a signal leave it out of the row; a null in one of them is refused."""
    count = 400
    full = np.random.default_rng(0).normal(size=(count, 6))
    columns: dict[str, Any] = {"time": np.arange(count) * 0.01}
    for k, name in enumerate(DEFAULT):
        turn = np.arange(count) % 4 == 0 if k < 3 else np.ones(count, dtype=bool)
        columns[name] = pa.array(full[:, k], mask=~turn)
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(columns), path, row_group_size=size)
    log = read_log([path], None, ONE)
    np.testing.assert_array_equal(log.position[0].value, full[::4, :3])
    np.testing.assert_array_equal(log.position[0].time, columns["time"][::4])
    np.testing.assert_array_equal(log.force[0].value, full[:, 3:])
    (vector, _) = describe_logs([path]).contents[0].vectors
    np.testing.assert_array_equal(vector.value, full[vector.time.astype(int), :3])
    hole = np.arange(count) % 4 != 0
    hole[300] = True
    columns[DEFAULT[1]] = pa.array(full[:, 1], mask=hole)
    pq.write_table(pa.table(columns), path, row_group_size=size)
    with pytest.raises(DataError, match=rf"column {DEFAULT[1]}, row 300: the cell is empty"):
        read_log([path], None, ONE)


@pytest.mark.parametrize("unit", ["ns", "us", "ms", "s"])
@pytest.mark.parametrize("kind", ["duration", "timestamp"])
def test_times_know_their_unit(tmp_path: Path, unit: str, kind: str) -> None:
    ticks = {"ns": 10**9, "us": 10**6, "ms": 1000, "s": 1}[unit]
    times = pa.array(np.arange(3) * ticks).cast(getattr(pa, kind)(unit))
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(plain(time=times)), path)
    np.testing.assert_array_equal(read_log([path], None, ONE).force[0].time, [0.0, 1.0, 2.0])


def test_struct_columns_units_and_sign(tmp_path: Path) -> None:
    vectors = [{"x": 1.0 + k, "y": 2.0, "z": 3.0} for k in range(2)]
    columns = {"time": [10, 20], "p": vectors, "f": vectors}
    units = {"length_unit": "um", "force_unit": "kN", "time": {"unit": "ms"}}
    mapping = LogBlock.model_validate(FIELDS | units | {"force_on": "sensor"})
    log = read(tmp_path, columns, mapping)
    values = np.array([[1.0, 2.0, 3.0], [2.0, 2.0, 3.0]])
    np.testing.assert_allclose(log.position[0].value, values * 1e-6, rtol=3e-16)
    np.testing.assert_allclose(log.force[0].value, -values * 1e3, rtol=3e-16)
    np.testing.assert_allclose(log.force[0].time, [0.01, 0.02], rtol=3e-16)
