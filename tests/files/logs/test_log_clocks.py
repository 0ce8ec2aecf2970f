"""Header against log time, progress."""

from pathlib import Path

import numpy as np
import pytest

from tdfscal.errors import DataError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.logs import read_log
from tdfscal.logs.clock import Clock
from tests.files.logs.log_making import STAMPED, point_stamped, small_mcap, wrench_stamped, write
from tests.words import in_words

FIELDS = {"position": "/p.point", "force": "/f.wrench.force"}
ONE = LogBlock.model_validate({"supports": {"a": FIELDS}})


def skewed(shift: float, late: set[int]) -> bytes:
    """One support, 60 messages; header times off by a shift, those of `late` by 0.5 s more."""
    messages = []
    for k in range(60):
        when = 100.0 + 0.01 * k
        header = when + shift + (0.5 if k in late else 0.0)
        for topic, make in (("/p", point_stamped), ("/f", wrench_stamped)):
            messages.append((topic, round(when * 1e9), make(header, (1, 2, 3))))
    return small_mcap(STAMPED, messages)


def test_header_times_are_compared_with_log_times(tmp_path: Path) -> None:
    quiet = read_log([write(tmp_path / "a.mcap", skewed(-0.003, set()))], ONE, ("a",))
    assert in_words(quiet.findings) == ()
    off = read_log([write(tmp_path / "b.mcap", skewed(-37.0, {7, 8}))], ONE, ("a",))
    assert len(in_words(off.findings)) == 4
    assert "header times of /p are -37 s off the recorder's" in in_words(off.findings)[0]
    assert "of 60 messages of /p, 2 have a header time that departs" in in_words(off.findings)[1]
    assert "by 0.5 s at most" in in_words(off.findings)[1]


def dying(begin: int, end: int, rate: float = 20.0) -> bytes:
    """Positions of one support for 10 s at `rate`, forces only of samples `begin` to `end`."""
    messages = []
    for k in range(round(10.0 * rate) + 1):
        when = 1_750_000_000.0 + k / rate
        messages.append(("/p", round(when * 1e9), point_stamped(when, (1, 2, 3))))
        if begin <= k < end:
            messages.append(("/f", round(when * 1e9), wrench_stamped(when, (1, 2, 3))))
    return small_mcap(STAMPED, messages)


def test_a_signal_that_stops_or_starts_apart_from_the_others(tmp_path: Path) -> None:
    def warnings(begin: int, end: int) -> list[str]:
        path = write(tmp_path / "log.mcap", dying(begin, end))
        found = in_words(read_log([path], ONE, ("a",)).findings)
        assert all(str(path) in warning for warning in found)
        return [warning.removeprefix(f"{path}: ").split(";")[0] for warning in found]

    assert warnings(0, 201) == []
    assert warnings(20, 181) == []  # 1 s each
    assert warnings(0, 180) == ["/f ends 1.05 s before the others"]
    assert warnings(100, 201) == ["/f begins 5 s after the others"]
    assert warnings(60, 101) == ["/f begins 3 s after the others", "/f ends 5 s before the others"]


@pytest.mark.parametrize(("unit", "ticks"), [("us", 1e6), ("ns", 1e9)])
def test_dates_in_a_smaller_unit_are_known(unit: str, ticks: float) -> None:
    with pytest.raises(DataError, match=f"`time.unit: {unit}`.* 2025-06-15"):
        Clock("column t", "timeseries").ascending(ticks * np.linspace(1.75e9, 1.75e9 + 1e3, 100))
