"""Clocks, several files, postures: what holds for every format."""

from pathlib import Path

import numpy as np
import pytest

from tdfscal.errors import DataError, UsageError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.files.saving import fingerprint
from tdfscal.logs import iter_log, read_log
from tdfscal.records import Log
from tests.files.logs.log_making import LOG_TIME, SUPPORTS, make_truth, mcap_bytes, write
from tests.words import in_words

ONE = ("a",)
DEFAULT = LogBlock()
POSTURES = LogBlock(rows="postures")


def csv(tmp_path: Path, times: list[float] | np.ndarray, name: str = "log.csv") -> Path:
    lines = ["time,a.x,a.y,a.z,a.fx,a.fy,a.fz"]
    lines += [f"{float(t)!r},{k},0,0,0,0,0" for k, t in enumerate(times)]
    return write(tmp_path / name, ("\n".join(lines) + "\n").encode())


def read(paths: list[Path], mapping: LogBlock = DEFAULT) -> Log:
    return read_log(paths, mapping, ONE)


def test_samples_that_do_not_ascend_are_left_out_and_counted(tmp_path: Path) -> None:
    times = np.arange(5000) * 0.01
    times[100] = times[99]
    times[200] = times[198] + 0.001
    log = read([csv(tmp_path, times)])
    kept = np.delete(np.arange(5000), [100, 200])
    np.testing.assert_array_equal(log.position[0].value[:, 0], kept)
    assert (np.diff(log.position[0].time) > 0.0).all()
    (warning,) = in_words(log.findings)
    assert "of 5000 samples of column time, 1 repeat" in warning
    assert "1 step back by up to 0.009 s" in warning


@pytest.mark.parametrize("jump", [-1.5, -3600.0])
def test_clock_set_back_is_refused(tmp_path: Path, jump: float) -> None:
    times = np.arange(5000) * 0.01 + 1e4
    times[2500:] += jump
    with pytest.raises(DataError, match=r"goes from 10024.99 s to"):
        read([csv(tmp_path, times)])


@pytest.mark.parametrize("step", [-1, 37])
def test_rows_in_another_order_are_refused(tmp_path: Path, step: int) -> None:
    order = np.arange(101) * step % 101
    with pytest.raises(DataError, match=r"[Ss]ort the rows") as refused:
        read([csv(tmp_path, order[1:])])
    assert ("newest rows come first" in str(refused.value)) == (step == -1)


def test_several_files_are_one_campaign_in_order_of_time(tmp_path: Path) -> None:
    late = csv(tmp_path, np.arange(10.0, 20.0), "a.csv")
    early = csv(tmp_path, np.arange(0.0, 10.0), "b.csv")
    log = read([late, early])
    np.testing.assert_array_equal(log.force[0].time, np.arange(20.0))
    assert [i.path for i in log.inputs] == [str(early), str(late)]
    with fingerprint(early) as described:
        assert log.inputs[0] == described("unverified")


def test_overlapping_files_are_refused(tmp_path: Path) -> None:
    first = csv(tmp_path, np.arange(0.0, 10.0), "a.csv")
    second = csv(tmp_path, np.arange(9.0, 20.0), "b.csv")
    third = csv(tmp_path, np.arange(8.5, 20.0), "c.csv")
    assert len(read([first, second]).force[0].time) == 20  # the sample at 9 s is there twice
    for pair in ([first, third], [first, first, third]):
        with pytest.raises(DataError, match="before the end of another log at 9 s"):
            read(pair)


def test_postures_without_time_count_their_rows(tmp_path: Path) -> None:
    lines = "a.x,a.y,a.z,a.fx,a.fy,a.fz\n1,0,0,0,0,0\n2,0,0,0,0,0\n"
    first = write(tmp_path / "b.csv", lines.encode())
    second = write(tmp_path / "a.csv", lines.encode())
    log = read([first, second], POSTURES)
    assert log.rows == "postures"
    np.testing.assert_array_equal(log.position[0].time, [0.0, 1.0, 2.0, 3.0])
    np.testing.assert_array_equal(log.position[0].value[:, 0], [1.0, 2.0, 1.0, 2.0])
    timed = csv(tmp_path, [5.0, 6.0], "c.csv")
    np.testing.assert_array_equal(read([timed], POSTURES).force[0].time, [5.0, 6.0])
    with pytest.raises(DataError, match="some have none"):
        read([timed, first], POSTURES)


def test_no_posture_is_left_out_silently(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="goes from 6 s to 6 s"):
        read([csv(tmp_path, [5.0, 6.0, 6.0])], POSTURES)


def test_pieces_put_together_are_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tdfscal.logs.messages.recording._ENOUGH", 100)
    truth = make_truth(200)
    path = write(tmp_path / "log.mcap", mcap_bytes(truth))
    pieces = list(iter_log([path], LOG_TIME, SUPPORTS))
    assert len(pieces) > 1
    for i in range(3):
        np.testing.assert_array_equal(
            np.concatenate([p.force[i].value for p in pieces]), truth.force[i]
        )


def test_paths_that_are_no_logs(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such file"):
        read([tmp_path / "absent.csv"])
    with pytest.raises(UsageError, match=r"no kind of log ends in '\.json'"):
        read([write(tmp_path / "a.json", b"{}")])
    with pytest.raises(UsageError, match="no recording"):
        read([tmp_path])
    with pytest.raises(UsageError, match="no log is given"):
        read([])


def test_gaps_are_counted(tmp_path: Path) -> None:
    times = np.arange(3000) * 0.01
    times[1000:] += 0.045
    times[2000:] += 7.0
    log = read([csv(tmp_path, times)])
    assert len(log.position[0].time) == 3000
    (warning,) = in_words(log.findings)
    assert "2 gaps of more than 5 periods of 0.01 s" in warning
    assert "longest of 7.01 s at 20.035 s" in warning
    times = np.arange(3000) * 0.01
    times[1000:] += 0.035
    assert in_words(read([csv(tmp_path, times)]).findings) == ()
