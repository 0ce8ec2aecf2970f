import json
from pathlib import Path

import numpy as np
import pytest

from tdfscal.errors import DataError
from tdfscal.files.points.reading import PointReading, read_point_file
from tdfscal.findings import Finding
from tdfscal.records import PointSet

PLAIN = "group,point,x,y,z\nncp1,P1,1,2,3\nncp1,P2,4,5,6\n"
SA = """// SpatialAnalyzer SA 2024.1 ( x64 )
// AXES = CARTESIAN: X,  Y,  Z ({unit})
// Group,  Point,  X,  Y,  Z

ncp1,  P1,  1,  2,  3
ncp1,  P2,  4,  5,  6
"""
LEICA = "Group;Point;X [mm];Y [mm];Z [mm];U(95) X [mm];U(95) Y [mm];U(95) Z [µm]\n"
METRES = np.array([[1.0, 2, 3], [4, 5, 6]])


def read_points(path: Path, *, length_unit: str | None) -> PointSet:
    return read_point_file(path, length_unit=length_unit).points


def codes(read: PointReading) -> list[str]:
    return [finding.code for finding in read.findings]


def found(read: PointReading, code: str) -> Finding:
    return next(finding for finding in read.findings if finding.code == code)


def write(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "points.csv"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(
    ("unit", "factor"), [("m", 1.0), ("mm", 1e-3), ("um", 1e-6), ("in", 0.0254), ("cm", 1e-2)]
)
def test_plain_csv_takes_the_given_unit(tmp_path: Path, unit: str, factor: float) -> None:
    read = read_points(write(tmp_path, PLAIN), length_unit=unit)
    assert read.group == ("ncp1", "ncp1")
    assert read.point == ("P1", "P2")
    assert np.array_equal(read.xyz, factor * METRES)
    assert read.std is None


def test_no_unit_anywhere_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no length unit") as caught:
        read_points(write(tmp_path, PLAIN), length_unit=None)
    assert caught.value.exit_status == 3


@pytest.mark.parametrize(
    ("unit", "factor"), [("mm", 1e-3), ("Inches", 0.0254), ("Meters", 1.0), ("in.", 0.0254)]
)
def test_unit_in_the_file_wins(tmp_path: Path, unit: str, factor: float) -> None:
    read = read_points(write(tmp_path, SA.format(unit=unit)), length_unit="m")
    assert np.array_equal(read.xyz, factor * METRES)


@pytest.mark.parametrize(
    "text",
    [
        "// AXES = CARTESIAN: X, Y, Z (mm)\nncp1, P1, 1, 2, 3\nncp1, P2, 4, 5, 6\n",
        "// AXES = CARTESIAN: X, Y, Z (mm)\nA, ncp1, P1, 1, 2, 3\nA, ncp1, P2, 4, 5, 6\n",
        "\ufeffGroup,Point,X [mm],Y [mm],Z [mm],\r\nncp1,P1,1,2,3,\r\nncp1,P2,4,5,6,\r\n",
        "Group\tPoint\tX [mm]\tY [mm]\tZ [mm]\nncp1\tP1\t1\t2\t3\nncp1\tP2\t4\t5\t6\n",
        "group;point;x [mm];y [mm];z [mm]\nncp1;P1;1,0;2,0;3,0\nncp1;P2;4;5;6\n",
        'point,group,z (mm),y (mm),x (mm)\n"P1","ncp1",3,2,1\nP2,ncp1,6,5,4\n',
        "Group,Point,X [mm],Y [mm],Z [mm],Offset\nncp1,P1,1,2,3,0\nncp1,P2,4,5,6,0.0\n",
    ],
)
def test_variants_of_the_formats(tmp_path: Path, text: str) -> None:
    read = read_points(write(tmp_path, text), length_unit=None)
    assert read.group == ("ncp1", "ncp1")
    assert read.point == ("P1", "P2")
    assert read.xyz == pytest.approx(1e-3 * METRES, rel=1e-15)


PLAIN_U = "group,point,x [mm],y [mm],z [mm],ux,uy,uz\n"


@pytest.mark.parametrize(
    ("text", "std", "said"),
    [
        (LEICA + "ncp1;P1;1;2;3;0,1;0,2;300\n", [5e-5, 1e-4, 1.5e-4], ["uncertainty-expanded"]),
        (PLAIN_U + "ncp1,P1,1,2,3,0.1,0.2,0.3\n", [1e-4, 2e-4, 3e-4], []),
    ],
)
def test_u95_is_halved(tmp_path: Path, text: str, std: list[float], said: list[str]) -> None:
    read = read_point_file(write(tmp_path, text), length_unit="mm")
    assert read.points.xyz == pytest.approx(1e-3 * METRES[:1], rel=1e-15)
    assert read.points.std is not None
    assert read.points.std[0] == pytest.approx(std, rel=1e-12)
    assert codes(read) == said


HEAD = "group,point,x,y,z\n"
BAD = {
    "empty": ("", "no points"),
    "no header": ("P1,1,2,3\n", "line 1.*names the columns.*P1, 1, 2, 3.*group,point,x,y,z"),
    "nan": (HEAD + "ncp1,P1,1,2,3\nncp1,P2,nan,2,3\n", "line 3.*finite"),
    "no length": (HEAD + "ncp1,P1,1,2,3\nncp1,P2,1e300,2,3\n", "line 3.*1e300"),
    "too large": (HEAD + "ncp1,P1,1,1e999,3\n", "line 2.*beyond any length"),
    "underscore": (HEAD + "ncp1,P1,1,1_0,3\n", "line 2.*`1_0`"),
    "blank": (HEAD + "ncp1,P1,1,,3\n", "line 2"),
    "twice": (HEAD + "ncp1,P1,1,2,3\n\nncp1,P1,1,2,4\n", "line 4.*ncp1/P1.*line 2"),
    "short": (HEAD + "ncp1,P1,1,2\n", "line 2.*4 columns.*5"),
    "long": (HEAD + "ncp1,P1,1,2,3,4\n", "line 2.*6 columns.*5"),
    "nameless": (HEAD + "ncp1,,1,2,3\n", "line 2.*name"),
    "target twice": ("target,x,y,z\nA,1,2,3\nB,1,2,4\nC,1,3,2\nA,1,2,5\n", "line 5.*A"),
    "one u": ("group,point,x,y,z,ux,uy,uz\nncp1,P1,1,2,3,1,,1\n", "line 2.*some of x, y and z"),
    "two sigmas": ("// 1 sigma\n// 2 sigma\n" + HEAD + "ncp1,P1,1,2,3\n", "line 2.*2 sigma"),
    "no z": ("group,point,x,y\nncp1,P1,1,2\n", "line 1"),
    "x twice": ("group,point,x,y,z,x [mm]\nncp1,P1,1,2,3,1\n", "line 1.*twice"),
    "cylindrical": ("// AXES = CYLINDRICAL: R, Theta, Z (mm)\nncp1,P1,1,2,3\n", "cylindrical"),
    "offset": (
        "group,point,x,y,z,Planar Offset\nncp1,P1,1,2,3,0\nncp1,P2,1,2,4,19.05\n",
        "line 3.*probe offset",
    ),
    "radius": ("group,point,x,y,z,Probe Radius\nncp1,P1,1,2,3,6.35\n", "line 2.*probe"),
    "unit": ("group,point,x [furlong],y [furlong],z [furlong]\nncp1,P1,1,2,3\n", "furlong"),
    "units": ("// AXES = CARTESIAN (mm)\ngroup,point,x [m],y [m],z [m]\nn,P,1,2,3\n", "different"),
    "some u": ("group,point,x,y,z,ux\nncp1,P1,1,2,3,1\n", "line 1.*uncertainties for x"),
    "negative u": ("group,point,x,y,z,ux,uy,uz\nncp1,P1,1,2,3,1,-1,1\n", "line 2.*negative"),
    "six": ("// AXES = CARTESIAN (mm)\nA,B,ncp1,P1,1,2,3\n", "line 2.*names the columns"),
    "binary": ("group\0point", "not a text file"),
}


LEICA_ROWS = """Target,X [mm],Y [mm],Z [mm],U(95) X [mm],U(95) Y [mm],U(95) Z [mm],,
RRR 1.5in,1,2,3,0.02,0.00,0.03,,
RRR 1.5in,4,5,6.5,0.02,0.02,0.03
"""
SA_U = """// SpatialAnalyzer 2019.01 (x64)
// Working Frame: A::WORLD
// AXES = CARTESIAN: X, Y, Z (mm)  Uncertainties ({sigma})
// Collection{d}Group{d}Point{d}X{d}Y{d}Z{d}U-x{d}U-y{d}U-z
A{d}ncp1{d}P1{d}1.000{d}2.000{d}3.000{d}0.02{d}0.04{d}0.06
A{d}ncp1{d}P2{d}4.000{d}5.000{d}6.000{blank}
"""


def test_a_tracker_export_without_names(tmp_path: Path) -> None:
    """`Target` is the reflector; U(95) of 0.00 lies below 0.005, and k = 2."""
    read = read_point_file(write(tmp_path, LEICA_ROWS), length_unit=None)
    assert read.points.group == ("", "")
    assert read.points.point == ("1", "2")
    assert read.points.std is not None
    assert read.points.std[0] == pytest.approx([1e-5, 2.5e-6, 1.5e-5], rel=1e-12)
    assert found(read, "column-of-reflectors").values["reflector"] == "RRR 1.5in"


def test_zeros_throughout_state_no_uncertainty(tmp_path: Path) -> None:
    text = LEICA_ROWS.replace("0.02", "0.00").replace("0.03", "0.00")
    read = read_point_file(write(tmp_path, text), length_unit=None)
    assert read.points.std is None
    assert found(read, "uncertainty-unstated").values["zero"]


@pytest.mark.parametrize(("delimiter", "blank"), [(", ", ", , , "), (",", "")])
@pytest.mark.parametrize(("sigma", "k"), [("1.0 sigma", 1.0), ("2.00 Sigma", 2.0), ("k = 3", 3.0)])
def test_sa_uncertainties(tmp_path: Path, delimiter: str, blank: str, sigma: str, k: float) -> None:
    text = SA_U.format(d=delimiter, blank=blank, sigma=sigma)
    read = read_point_file(write(tmp_path, text), length_unit=None)
    assert (read.points.group, read.points.point) == (("ncp1", "ncp1"), ("P1", "P2"))
    assert read.points.xyz == pytest.approx(1e-3 * METRES, rel=1e-15)
    assert read.points.std is not None
    assert read.points.std[0] == pytest.approx(np.array([2e-5, 4e-5, 6e-5]) / k, rel=1e-12)
    assert np.isnan(read.points.std[1]).all()


@pytest.mark.parametrize(
    ("text", "point"),
    [
        ("Tracker AT960\nStation 1\n\nPoint ID;X [mm];Y [mm];Z [mm]\nP1;1;2;3\nP2;4;5;6\n",
         ("P1", "P2")),
        ("Name\tNominal X\tNominal Y\tNominal Z\tMeasured X\tMeasured Y\tMeasured Z\tDev\n"
         "P1\t0\t0\t0\t1\t2\t3\t1\nP2\t0\t0\t0\t4\t5\t6\t2\n", ("P1", "P2")),
        ("ID,Name,x_mm,y_mm,z_mm\n8,P1,1,2,3\n9,P2,4,5,6\n", ("P1", "P2")),
        ("Name,X,Y,Z\nA::ncp1::P1,1,2,3\nA::ncp1::P2,4,5,6\n", ("P1", "P2")),
        ("Unit: mm\nPoint;X;Y;Z\nP1;1,0;2,0;3,0\nP2;4;5;6\n;;;\n", ("P1", "P2")),
    ],
)  # fmt: skip
def test_texts_of_instruments(tmp_path: Path, text: str, point: tuple[str, str]) -> None:
    read = read_points(write(tmp_path, text), length_unit="mm")
    assert read.point == point
    assert read.xyz == pytest.approx(1e-3 * METRES, rel=1e-15)


@pytest.mark.parametrize(
    ("row", "digit"),
    [("1.25,2,3", 1e-5), ("1.250,2.5,3", 1e-6), ("1.5e2,2,3.1", 1e-4), ("50.0,-50.0,0.0", 0.0)],
)
def test_the_last_digit(tmp_path: Path, row: str, digit: float) -> None:
    """The finest of the file; whole numbers are a drawing's."""
    read = read_points(write(tmp_path, HEAD + f"ncp1,P1,{row}\n"), length_unit="mm")
    assert read.resolution == pytest.approx(digit, rel=1e-12)


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_with_its_line(tmp_path: Path, case: str) -> None:
    text, said = BAD[case]
    with pytest.raises(DataError, match=said) as caught:
        read_points(write(tmp_path, text), length_unit="mm")
    assert "points.csv" in str(caught.value)
    assert caught.value.hint
    assert caught.value.exit_status == 3
    assert "\n" not in str(caught.value)


def test_json_has_the_shape_of_the_model(tmp_path: Path) -> None:
    point = {"group": "ncp1", "point": "P1", "x": 1, "y": 2, "z": 3}
    content = {"length_unit": "mm", "points": [point]}
    path = tmp_path / "points.json"
    path.write_text(json.dumps(content))
    assert read_points(path, length_unit="m").xyz == pytest.approx(np.array([[1e-3, 2e-3, 3e-3]]))
    path.write_text(json.dumps({**content, "points": [point, point]}))
    with pytest.raises(DataError, match="already"):
        read_points(path, length_unit="m")


def test_other_encodings(tmp_path: Path) -> None:
    text = PLAIN.replace("P1", "Prüfpunkt")
    for encoding in ("utf-8-sig", "cp1252", "utf-16"):
        read = read_points(write(tmp_path, text, encoding), length_unit="m")
        assert read.point[0] == "Prüfpunkt"
