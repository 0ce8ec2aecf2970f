from pathlib import Path

import pytest

from tdfscal.commands.campaign import find_logs, resolve
from tdfscal.errors import UsageError
from tests.files.sample_documents import RIG


def make(folder: Path, *names: str, rig: str | None = RIG) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    if rig is not None:
        (folder / "rig.yaml").write_text(rig)
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("x")
    return folder


SURVEY = tuple(f"tracker/{name}.csv" for name in ("nominal", "targets", "servo", "moves"))


def test_folder_gives_rig_and_logs(tmp_path: Path) -> None:
    home = make(
        tmp_path / "c",
        *("part_10.csv", "part_2.csv", "b.parquet", "c.MCAP", "d.csv.gz", "e.tsv.zst"),
        *(".hidden.csv", "truth.yaml", "calibration.yaml", "calibration.csv", "notes.txt"),
        *("bag/metadata.yaml", "bag/bag_0.mcap", "other/log.csv", *SURVEY),
    )
    campaign = resolve([home])
    assert campaign.rig.path == home / "rig.yaml"
    expected = ["b.parquet", "bag", "c.MCAP", "d.csv.gz", "e.tsv.zst", "part_2.csv", "part_10.csv"]
    assert [path.relative_to(home).as_posix() for path in campaign.logs] == expected


def test_survey_alone_will_do_and_nothing_will_not(tmp_path: Path) -> None:
    campaign = resolve([make(tmp_path / "a", *SURVEY)])
    assert campaign.logs == ()
    with pytest.raises(UsageError, match=r"no log here, nor a tracker's survey"):
        resolve([make(tmp_path / "b", *SURVEY[:3])])


def test_files_take_the_rig_beside_them_or_the_given_one(tmp_path: Path) -> None:
    home = make(tmp_path / "a", "x.csv", "y.csv")
    assert resolve([home / "y.csv", home / "x.csv"]).rig.path == home / "rig.yaml"
    assert [p.name for p in resolve([home / "y.csv", home / "x.csv"]).logs] == ["y.csv", "x.csv"]
    other = make(tmp_path / "b", rig=RIG.replace("Rotor-hub", "Other"))
    for paths in ([home / "x.csv"], [home]):
        assert resolve(paths, other / "rig.yaml").rig.rig.name == "Other rig"
    bare = make(tmp_path / "c", "z.csv", rig=None)
    assert resolve([bare / "z.csv"], other / "rig.yaml").rig.rig.name == "Other rig"


def test_same_rig_twice_is_no_conflict_but_two_rigs_are(tmp_path: Path) -> None:
    one, two = make(tmp_path / "a", "x.csv"), make(tmp_path / "b", "y.csv")
    assert len(resolve([one, two]).logs) == 2
    make(tmp_path / "b", rig=RIG.replace("500.0", "501.0"))
    with pytest.raises(UsageError, match="different rigs") as refused:
        resolve([one, two])
    assert refused.value.exit_status == 2
    assert str(one / "rig.yaml") in str(refused.value)
    assert str(two / "rig.yaml") in str(refused.value)
    assert len(resolve([one, two], one / "rig.yaml").logs) == 2


def test_no_path_no_rig_no_log(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no path"):
        resolve([])
    bare = make(tmp_path / "a", "x.csv", rig=None)
    with pytest.raises(UsageError, match=r"there is no rig\.yaml.* with --rig"):
        resolve([bare])
    (bare / "rig.yml").write_text(RIG)
    with pytest.raises(UsageError, match=r"ename rig\.yml to rig\.yaml"):
        resolve([bare / "x.csv"])
    home = make(tmp_path / "b")
    with pytest.raises(UsageError, match=r"rig\.yaml: is a rig file, not a log"):
        resolve([home / "rig.yaml"])


@pytest.mark.parametrize("stored", ["second_0.mcap", "second_0.MCAP.zstd", "second_0.db3"])
def test_recording_that_was_not_finished_is_not_passed_over(tmp_path: Path, stored: str) -> None:
    home = make(tmp_path, "first.mcap", f"second/{stored}", *SURVEY)
    match = rf"second: the folder holds {stored} and no metadata\.yaml.*ros2 bag reindex.*\.mcap"
    for found in (resolve, find_logs):
        with pytest.raises(UsageError, match=match):
            found([home])
    (home / "second" / "metadata.yaml").write_text("x")
    assert [path.name for path in resolve([home]).logs] == ["first.mcap", "second"]


def test_folders_that_are_no_part_of_the_campaign_are_left_alone(tmp_path: Path) -> None:
    others = ("old/log.csv", ".trash/log.mcap", "notes/a.mcap.txt", "held_out/log.mcap")
    home = make(tmp_path, "log.mcap", *others, *SURVEY)
    (home / "held_out" / "rig.yaml").write_text(RIG)  # a campaign of its own
    campaign = resolve([home])
    assert campaign.logs == (home / "log.mcap",)
