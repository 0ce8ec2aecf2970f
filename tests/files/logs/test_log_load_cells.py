"""Logs of sensors that lack axes: read without the fields, refused with the line to write."""

from pathlib import Path

import numpy as np
import pytest

from tdfscal.errors import DataError, RigError
from tdfscal.files.rig.reading import load_rig, parse_rig
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.logs import read_log
from tdfscal.records import BoolArray, Log
from tdfscal.simulation import Recorder, make_rig
from tests.files.logs.log_making import LOG_TIME, make_truth, mcap_bytes, write

SUPPORTS = ("ncp1", "ncp2", "ncp3", "ncp4")
#: Two load cells: one of z alone, and no sensor at all.
AXES = np.array([[True] * 3, [True] * 3, [False, False, True], [False] * 3])
LACKING = ("TDFS3_Fx", "TDFS3_Fy", "TDFS4_Fx", "TDFS4_Fy", "TDFS4_Fz")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same campaign in two formats, all axes recorded."""
    found = {}
    for form in ("csv", "mcap"):
        found[form] = tmp_path_factory.mktemp(form)
        simulate_to_folder(
            found[form], make_rig(4), "self", format=form, postures=3,
            recorder=Recorder(force_rate=20.0, position_rate=20.0),
        )  # fmt: skip
    return found


def read(path: Path, folder: Path, axes: BoolArray | None = None) -> Log:
    return read_log([path], load_rig(folder / "rig.yaml").log, SUPPORTS, axes=axes)


def assert_lacks(log: Log, whole: Log) -> None:
    """What is measured is as it was, the rest reads 0."""
    for i in range(4):
        assert np.array_equal(log.force[i].value, np.where(AXES[i], whole.force[i].value, 0.0))
        assert np.array_equal(log.position[i].value, whole.position[i].value)


@pytest.mark.parametrize("cell", [None, "nan", ""])
def test_csv_without_columns(folders: dict[str, Path], tmp_path: Path, cell: str | None) -> None:
    folder, path = folders["csv"], tmp_path / "log.csv"
    rows = [line.split(",") for line in (folder / "log.csv").read_text().splitlines()]
    gone = [rows[0].index(name) for name in LACKING]
    for row in rows[1:]:
        for k in gone:
            row[k] = cell or ""
    if cell is None:
        rows = [[c for k, c in enumerate(row) if k not in gone] for row in rows]
    path.write_text("\n".join(map(",".join, rows)) + "\n")
    assert_lacks(read(path, folder, AXES), read(folder / "log.csv", folder))
    line = r"write `axes: \[.*\]` for ncp[34] in rig.yaml" if cell is not None else "no column"
    with pytest.raises(DataError, match=line):
        read(path, folder)


def test_a_field_for_each_axis_that_is_measured(folders: dict[str, Path]) -> None:
    folder = folders["csv"]
    text = (folder / "rig.yaml").read_text()
    for gone, there in (
        ("name: ncp2\n", "name: ncp2\n  axes: [x, z]\n"),
        ("name: ncp4\n", "name: ncp4\n  axes: []\n"),
        ("TDFS2_Fy, ", ""),
        ("\n      force: [TDFS4_Fx, TDFS4_Fy, TDFS4_Fz]", ""),
    ):
        assert text.count(gone) == 1
        text = text.replace(gone, there)
    rig = parse_rig(text.encode(), "rig.yaml")
    whole = read(folder / "log.csv", folder)
    log = read_log([folder / "log.csv"], rig.log, SUPPORTS, axes=rig.rig.axes)
    for i, lacks in ((1, [1]), (3, [0, 1, 2])):
        expected = whole.force[i].value.copy()
        expected[:, lacks] = 0.0
        assert np.array_equal(log.force[i].value, expected)
    with pytest.raises(RigError, match="none for an axis not measured"):
        parse_rig(text.replace("[x, z]", "[z, x]").encode(), "rig.yaml")


def test_messages_with_nan(tmp_path: Path) -> None:
    truth = make_truth()
    truth.force[2][:, 1] = np.nan
    path = write(tmp_path / "log.mcap", mcap_bytes(truth))
    said = r"not finite \(/ncp3/wrench.wrench.force.y.*write `axes: \[x, z\]` for ncp3"
    with pytest.raises(DataError, match=said):
        read_log([path], LOG_TIME, SUPPORTS[:3])
    truth.force[2][:-1, 1] = 1.0  # one message alone
    write(path, mcap_bytes(truth))
    with pytest.raises(DataError, match=r"not finite \(/ncp3/wrench.wrench.force.y") as refused:
        read_log([path], LOG_TIME, SUPPORTS[:3])
    assert "axes" not in str(refused.value)


def test_mcap_without_the_topic(folders: dict[str, Path]) -> None:
    folder = folders["mcap"]
    (mapping,) = load_rig(folder / "rig.yaml").log
    fields = {name: dict(mapping.support_fields(name)) for name in SUPPORTS}
    fields["ncp4"]["force"] = ("none",)
    whole = LogBlock.model_validate({"time": mapping.time, "supports": fields})
    fields["ncp3"]["force"] = ("none", "none", f"{fields['ncp3']['force'][0]}.z")
    path = folder / "log.mcap"
    log = read_log(
        [path],
        LogBlock.model_validate({"time": mapping.time, "supports": fields}),
        SUPPORTS,
        axes=AXES,
    )
    assert_lacks(log, read(path, folder))
    with pytest.raises(DataError, match=r"no topic for none; .* as the recorder names") as refused:
        read_log([path], whole, SUPPORTS)
    assert "axes" not in str(refused.value)
