"""rosbag2 folders, by rosbags' writer and made by hand; their metadata against their files."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from tdfscal.errors import DataError
from tdfscal.logs import read_log
from tests.files.logs.log_making import (
    MAPPING,
    SUPPORTS,
    Truth,
    assert_holds,
    make_truth,
    mcap_bytes,
)
from tests.words import in_words

TRUTH = make_truth()
SPLIT = 36  # of 60 positions, in the first file


def part(truth: Truth, begin: int, end: int) -> Truth:
    forces = slice(4 * begin, 4 * end)
    return replace(
        truth,
        time=truth.time[begin:end],
        position=truth.position[:, begin:end],
        force_time=truth.force_time[forces],
        force=truth.force[:, forces],
    )


def by_hand(folder: Path, **changes: Any) -> Path:
    """Two files, as after a split; changes: of the metadata's entries."""
    folder.mkdir()
    names = ["bag_0.mcap", "bag_1.mcap"]
    (folder / names[0]).write_bytes(mcap_bytes(part(TRUTH, 0, SPLIT)))
    (folder / names[1]).write_bytes(mcap_bytes(part(TRUTH, SPLIT, 60)))
    information = {"version": 9, "storage_identifier": "mcap", "relative_file_paths": names}
    kept = {key: value for key, value in (information | changes).items() if value is not None}
    text = yaml.safe_dump({"rosbag2_bagfile_information": kept})
    (folder / "metadata.yaml").write_text(text)
    return folder


def test_split_in_two(tmp_path: Path) -> None:
    log = read_log([by_hand(tmp_path / "bag")], MAPPING, SUPPORTS)
    assert_holds(log, TRUTH)
    assert in_words(log.findings) == ()
    assert [entry.integrity for entry in log.inputs] == ["verified"] * 2


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"storage_identifier": "rocksdb"}, "stored as rocksdb.*bag convert"),
        ({"relative_file_paths": ["bag_0.mcap", "bag_2.mcap"]}, r"lacks bag_2\.mcap\. Copy"),
        ({"relative_file_paths": []}, "lacks any file"),
        ({"relative_file_paths": ["bag_0.mcap"] * 2}, "names a file twice"),
        ({"relative_file_paths": [["bag_0.mcap"]]}, "no description of a rosbag2 recording"),
        ({"relative_file_paths": 3}, "no description of a rosbag2 recording"),
        ({"storage_identifier": None}, "no description of a rosbag2 recording"),
    ],
)
def test_metadata_that_is_wrong(tmp_path: Path, changes: dict[str, Any], match: str) -> None:
    with pytest.raises(DataError, match=match):
        read_log([by_hand(tmp_path / "bag", **changes)], MAPPING, SUPPORTS)


def test_paths_that_carry_the_name_of_the_folder(tmp_path: Path) -> None:
    """As recorders of metadata version 2 write them."""
    folder = by_hand(tmp_path / "bag", relative_file_paths=["bag/bag_0.mcap", "bag/bag_1.mcap"])
    assert_holds(read_log([folder], MAPPING, SUPPORTS), TRUTH)
