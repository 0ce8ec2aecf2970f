"""CSV and TSV logs, with the headers that recorders write."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest

from tdfscal.errors import DataError, RigError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.logs import read_log
from tdfscal.logs.describe import describe_logs
from tdfscal.records import Log
from tests.files.logs.log_making import write

ONE = ("a",)


def mapping(*force: str, **stated: Any) -> LogBlock:
    """Of a support whose fields are those of the header; stated : scales, and keys of the block."""
    fields = {"position": ["X", "Y", "Z"], "force": force or ("FX", "FY", "FZ")}
    fields |= {key: stated.pop(key) for key in ("position_scale", "force_scale") if key in stated}
    return LogBlock.model_validate({"time": {"field": "t"}, "supports": {"a": fields}} | stated)


MAPPING = mapping()
HEADER = "t,X,Y,Z,FX,FY,FZ"
ROWS = ("0,1,2,3,4,5,6", "0.1,1.5,2.5,3.5,4.5,5.5,6.5")


def text(*lines: str) -> bytes:
    return ("\n".join(lines) + "\n").encode()


def read(tmp_path: Path, content: bytes, block: LogBlock | None = MAPPING) -> Log:
    path = write(tmp_path / "log.csv", content)
    return read_log([path], block, ONE)


def assert_plain(log: Log, length: float = 1.0, force: float = 1.0) -> None:
    np.testing.assert_array_equal(log.position[0].time, [0.0, 0.1])
    position = np.array([[1.0, 2.0, 3.0], [1.5, 2.5, 3.5]])
    np.testing.assert_allclose(log.position[0].value, position * length, rtol=2e-16)
    np.testing.assert_allclose(
        log.force[0].value, np.array([[4.0, 5.0, 6.0], [4.5, 5.5, 6.5]]) * force, rtol=2e-16
    )


@pytest.mark.parametrize(
    "content",
    [
        text(HEADER, *ROWS),
        text(HEADER, *ROWS).replace(b"\n", b"\r\n"),
        text(HEADER, *ROWS).replace(b"\n", b"\r"),
        text(HEADER, *ROWS).replace(b",", b";"),
        text(HEADER, *ROWS).replace(b",", b"\t"),
        b"\xef\xbb\xbf" + text(HEADER, *ROWS),
        text('"t", "X", "Y", "Z", "FX", "FY", "FZ"', *ROWS),
        text(" t , X [m], Y[m],Z (m) ,FX [N],FY,FZ [N]", *ROWS),
        text(HEADER, "s,m,m,m,N,N,N", *ROWS),
        text(HEADER, "[s],[m],[m],[m],[N],[N],[N]", *ROWS),
        text("# recorder 7", "Machine: hub, 3 axes", "", HEADER, *ROWS),
        text("Bemerkung,t,X,Y,Z,FX,FY,FZ,", *(f"läuft,{r}," for r in ROWS)),
        "Größe,t,X,Y,Z,FX,FY,FZ\n0°,0,1,2,3,4,5,6\n0°,.1,1.5,2.5,3.5,4.5,5.5,6.5\n".encode(
            "cp1252"
        ),
        text(HEADER, "0,1,2,3,4,5,6", "", ' 0.10 ,"1.5", 2.5,+3.5,4.5E0,55e-1,6.5'),
    ],
)
def test_header_quirks(tmp_path: Path, content: bytes) -> None:
    assert_plain(read(tmp_path, content))


PREAMBLES = (
    "recorder 7",
    "Rate,50\nGain,2.5\nChannels,7,,",
    "note,of,several,words",
    "X_Dimension,Time,Time,Time,Time,Time,Time\nX0,0.0,0.0,0.0,0.0,0.0,0.0",
)


@pytest.mark.parametrize("preamble", PREAMBLES)
@pytest.mark.parametrize("separator", [",", ";"])
def test_the_table_below_a_preamble(tmp_path: Path, preamble: str, separator: str) -> None:
    content = text(preamble, HEADER, *ROWS).decode().replace(",", separator).encode()
    assert_plain(read(tmp_path, content))
    (stream,) = describe_logs([tmp_path / "log.csv"]).contents[0].streams
    assert [field.name for field in stream.fields] == HEADER.split(",")
    assert stream.count == len(ROWS)


def test_a_wider_table_below_hides_no_row(tmp_path: Path) -> None:
    wider = (f"{HEADER},more", *(f"{row},1" for row in ROWS), "0.2,1,2,3,4,5,6,1")
    with pytest.raises(DataError, match="line 4: the line has 8 cells, the header 7"):
        read(tmp_path, text(HEADER, *ROWS, *wider))


def test_decimal_comma_only_where_declared(tmp_path: Path) -> None:
    content = text(HEADER, *ROWS).replace(b",", b";").replace(b".", b",")
    assert_plain(read(tmp_path, content, mapping(decimal=",")))
    with pytest.raises(DataError, match=r"line 3, column t: '0,1' is not a finite.*decimal: \","):
        read(tmp_path, content)
    with pytest.raises(DataError, match=r"line 3, column t: '0.1'.*take it out"):
        read(tmp_path, text(HEADER, *ROWS).replace(b",", b";"), mapping(decimal=","))


def test_units_and_sign(tmp_path: Path) -> None:
    units = {"length_unit": "mm", "force_unit": "kN", "time": {"field": "t", "unit": "ms"}}
    in_ms = text(HEADER, *ROWS).replace(b"\n0.1", b"\n100")
    assert_plain(read(tmp_path, in_ms, mapping(**units, force_on="sensor")), 1e-3, -1e3)


def test_unit_in_brackets_is_honoured_or_checked(tmp_path: Path) -> None:
    content = text("t,X [mm],Y [mm],Z [mm],FX,FY,FZ", *ROWS)
    with pytest.raises(DataError, match=r"column 'X \[mm\]' is in mm, the mapping says m"):
        read(tmp_path, content)
    assert_plain(read(tmp_path, content, mapping(length_unit="mm")), 1e-3)
    pounds = content.replace(b"FX", b"FX [lbf]")
    with pytest.raises(DataError, match="is in lbf, the mapping says N") as refused:
        read(tmp_path, pounds, mapping(length_unit="mm"))
    # The line that it names reads it: 1 lbf is 0.45359237 kg of 9.80665 m/s².
    scale = float(re.findall(r"`force_scale: ([\d.]+)`", str(refused.value))[0])
    assert scale == pytest.approx(0.45359237 * 9.80665, rel=1e-12)
    assert_plain(read(tmp_path, pounds, mapping(length_unit="mm", force_scale=scale)), 1e-3, scale)
    # Without a log block nothing contradicts what the file says.
    content = text("time,a.x [mm],a.y [mm],a.z [mm],a.fx,a.fy,a.fz", *ROWS)
    assert_plain(read(tmp_path, content, None), 1e-3)
    with pytest.raises(DataError, match="different units"):
        read(tmp_path, content.replace(b"a.x [mm]", b"a.x [m]"), None)


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"\n\n", "is empty"),
        (text(HEADER), "a header and no rows"),
        (text(HEADER, "", ""), "a header and no rows"),
        (text(*ROWS), "no column t, X, .* it has 1, 2, 3"),
        (text(HEADER.replace("Y,", "Y2,"), *ROWS), "line 1: no column Y, FY; the nearest.*Y2"),
        (text(HEADER.replace("t,", "time,"), *ROWS), "no column t"),
        (text(HEADER.replace("FY", "FX"), *ROWS), "column FX is there 2 times"),
        (text(HEADER + ",FX", *(r + ",9" for r in ROWS)), "column FX is there 2 times"),
        (text(HEADER, *ROWS, "0.2,1,2,3,4,5"), "line 4: the line has 6 cells, the header 7"),
        (text(HEADER, *ROWS, "0.2,1,2,3,4,5,6,7"), "line 4: the line has 8 cells"),
        (
            text(HEADER, *ROWS, "0.2", ROWS[0], "0.3,x,2,3,4,5,6", "1"),
            "line 4: .*lines 6, 7 are .*3 in all",
        ),
        (text(HEADER, "", *ROWS, "0.2,1,,3,4,5,6"), "line 5, column Y: the cell is empty"),
        (text(HEADER, *ROWS, "0.2,1,2,3,nan,5,6"), "line 4, column FX: 'nan' is not a finite"),
        (text(HEADER, *ROWS, "0.2,1,2,3,4,-inf,6"), "line 4, column FY: '-inf' is not a finite"),
        (text(HEADER, *ROWS, "0.2,1,2,3,4,5,1e400"), "line 4, column FZ: '1e400' is not a finite"),
        (text(HEADER, *ROWS, "0.2,1,2,3,4,5,NA"), "line 4, column FZ: 'NA'"),
        (text(HEADER, *ROWS, "0.2,1,2,3,4,5,0x10"), "line 4, column FZ: '0x10'"),
        (text(HEADER, *ROWS, "0.2,1,2,3,4,5,6\0"), "line 4, column FZ"),
        (text("note," + HEADER, '"a,' + ROWS[0], '",' + ROWS[1]), "line 2"),
        (text(HEADER, f"{ROWS[0]},", f"{ROWS[1]},7"), "line 3: '7' stands in a column that has no"),
        (text(HEADER, f"{ROWS[0]},", ROWS[1]), "line 3: the line has 7 cells, the first row 8"),
        (text(HEADER, ROWS[0], f"{ROWS[1]},"), "line 3: the line has 8 cells, the header 7"),
        (text(f"{HEADER},", ROWS[0], f"{ROWS[1]},"), "line 3: the line has 8 cells, the first row"),
        (text(HEADER, f"{ROWS[0]},", "0.1,1.5,,3.5,4.5,5.5,6.5,"), "column Y: the cell is empty"),
        (text(HEADER, *(f"{row},7" for row in ROWS)), "line 2: the line has 8 cells, the header 7"),
        (text(HEADER)[:-1] + b"\n" + ROWS[0].encode(), "the only row below the header has no end"),
        (text(HEADER, *ROWS).decode().encode("utf-16-le"), "the text is UTF-16"),
        (text(HEADER, *ROWS).decode().encode("utf-16-be"), "the text is UTF-16"),
        (b"x," * 200_000, "the first line is longer than 256 KiB"),
        (bytes(range(256)) * 16, "the file is not text"),
        (bytes(1000), "nothing but zeros"),
        (b"<html><body>404</body></html>", "HTML"),
        (b'{"a":1}', "JSON"),
    ],
)
def test_faults_are_named(tmp_path: Path, content: bytes, match: str) -> None:
    with pytest.raises(DataError, match=match):
        read(tmp_path, content)


def test_quotation_marks_swallow_no_rows(tmp_path: Path) -> None:
    # Two lone marks make one legal row of three: its samples would be lost unseen.
    content = text(HEADER + ",note", ROWS[0] + ',"a', "0.05,1,2,3,4,5,6,b", ROWS[1] + ',c"')
    log = read(tmp_path, content)
    np.testing.assert_array_equal(log.position[0].time, [0.0, 0.05, 0.1])


def test_fault_far_down_has_its_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tdfscal.logs.text_file._HEAD", 1 << 12)
    monkeypatch.setattr("tdfscal.logs.text_file._BLOCK", 1 << 12)
    lines = [f"{k * 1e-3:.3f},1,2,3,4,5,6" for k in range(2000)]
    lines[1900] = "1.900,1,2,3,4,5,6x"
    with pytest.raises(DataError, match="line 1902, column FZ: '6x'"):
        read(tmp_path, text(HEADER, *lines))


@pytest.mark.parametrize("end", ["", "\n\x1a"])
def test_last_line_without_end(tmp_path: Path, end: str) -> None:
    lines = [HEADER, *(f"{k},1,2,3,4,5,{k * 1.25:.3f}" for k in range(1, 9))]
    whole = "\n".join(lines).encode()
    log = read(tmp_path, whole + end.encode())
    assert (log.findings, log.force[0].value[-1, 2]) == ((), 10.0)
    log = read(tmp_path, whole[:-1])  # 10.00
    assert [f.values["byte"] for f in log.findings] == [len("\n".join(lines[:-1])) + 1]


def test_a_support_that_the_mapping_lacks(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="no fields for support b"):
        read_log([write(tmp_path / "l.csv", b"")], MAPPING, ("b",))


def test_a_scale_takes_the_place_of_a_unit(tmp_path: Path) -> None:
    """Raw counts and mV: m and N per unit of the log, one for all axes or one of each."""
    scales = {"position_scale": 2e-6, "force_scale": [0.5, -1.0, 2.0]}
    content = text("t,X,Y,Z,FX [mV],FY [mV],FZ [mV]", *ROWS)
    for on, sign in (("terminal", 1.0), ("sensor", -1.0)):
        log = read(tmp_path, content, mapping(**scales, force_on=on))
        np.testing.assert_allclose(log.position[0].value[0], np.array([1, 2, 3]) * 2e-6)
        np.testing.assert_allclose(log.force[0].value[0], sign * np.array([2.0, -5.0, 12.0]))
    pq.write_table(pa_csv.read_csv(tmp_path / "log.csv"), tmp_path / "log.parquet")
    named = mapping("FX [mV]", "FY [mV]", "FZ [mV]", **scales)
    log = read_log([tmp_path / "log.parquet"], named, ONE)
    np.testing.assert_allclose(log.force[0].value[1], [2.25, -5.5, 13.0])
