"""rosbag2 folders, by rosbags' writer and made by hand; their metadata against their files."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin

from tdfscal.errors import DataError
from tdfscal.logs import read_log
from tdfscal.logs.describe import describe_logs
from tests.files.logs.log_making import (
    MAPPING,
    SUPPORTS,
    Truth,
    assert_holds,
    make_truth,
    mcap_bytes,
    rosbag2,
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
    counts = {f"/{s}/position": 60 for s in SUPPORTS} | {f"/{s}/wrench": 240 for s in SUPPORTS}
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "relative_file_paths": names,
        "message_count": sum(counts.values()),
        "topics_with_message_count": topics(counts),
    }
    kept = {key: value for key, value in (information | changes).items() if value is not None}
    text = yaml.safe_dump({"rosbag2_bagfile_information": kept})
    (folder / "metadata.yaml").write_text(text)
    return folder


def topics(counts: dict[str, int]) -> list[dict[str, Any]]:
    return [
        {"topic_metadata": {"name": name, "type": "x"}, "message_count": count}
        for name, count in counts.items()
    ]


def test_by_rosbags_with_another_file_in_place_of_its_own(tmp_path: Path) -> None:
    folder = rosbag2(tmp_path / "bag", TRUTH, StoragePlugin.MCAP)
    (file,) = folder.glob("*.mcap")
    file.write_bytes(mcap_bytes(part(TRUTH, 0, 59)))
    match = r"59 messages of /ncp1/position are there where metadata\.yaml states 60"
    with pytest.raises(DataError, match=match):
        read_log([folder], MAPPING, SUPPORTS)
    assert any("59 messages" in problem for problem in describe_logs([folder]).problems)


@pytest.mark.parametrize("absent", [None, "topics_with_message_count"])
def test_split_in_two(tmp_path: Path, absent: str | None) -> None:
    changes = {absent: None} if absent else {}
    log = read_log([by_hand(tmp_path / "bag", **changes)], MAPPING, SUPPORTS)
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
        ({"topics_with_message_count": [{"message_count": 3}]}, "no description"),
    ],
)
def test_metadata_that_is_wrong(tmp_path: Path, changes: dict[str, Any], match: str) -> None:
    with pytest.raises(DataError, match=match):
        read_log([by_hand(tmp_path / "bag", **changes)], MAPPING, SUPPORTS)


def test_paths_that_carry_the_name_of_the_folder(tmp_path: Path) -> None:
    """As recorders of metadata version 2 write them."""
    folder = by_hand(tmp_path / "bag", relative_file_paths=["bag/bag_0.mcap", "bag/bag_1.mcap"])
    assert_holds(read_log([folder], MAPPING, SUPPORTS), TRUTH)
