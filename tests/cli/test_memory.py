"""Too little memory is never taken for a damaged file, a full disk, or a fault of the program."""

from __future__ import annotations

import errno
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tdfscal import memory
from tdfscal.errors import DataError, MemoryShortError
from tdfscal.logs.common.damage import damage
from tests.cli.running import SAMPLES, run

resource = pytest.importorskip("resource")


@pytest.mark.parametrize("kind", ["RLIMIT_AS", "RLIMIT_DATA"])
@pytest.mark.parametrize("megabytes", [150, 500])
def test_a_run_under_a_limit_says_so_at_once(kind: str, megabytes: int, tmp_path: Path) -> None:
    def limit() -> None:
        resource.setrlimit(getattr(resource, kind), (megabytes * 1_000_000,) * 2)

    done = subprocess.run(
        [sys.executable, "-m", "tdfscal", "calibrate", SAMPLES / "csv", "-o", tmp_path / "c.yaml"],
        preexec_fn=limit, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "memory does not suffice" in done.stderr
    assert not list(tmp_path.iterdir())


def wrapped(fault: Exception) -> DataError:
    try:
        try:
            raise fault
        except Exception as cause:
            raise DataError("the file is damaged") from cause
    except DataError as error:
        return error


@pytest.mark.parametrize(
    "fault",
    [
        MemoryError(),
        ImportError("failed to map segment from shared object"),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        RuntimeError("can't start new thread"),
        wrapped(MemoryError()),
        wrapped(OSError("Unknown error: Failed to launch worker thread: Resource temporarily …")),
    ],
    ids=repr,
)
def test_faults_of_memory(
    fault: Exception, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*arguments: object) -> None:
        raise fault

    monkeypatch.setattr("tdfscal.workflows.report.read_sources", fail)
    seen = run(capsys, "report", "own.yaml")
    assert seen.status == 2
    assert "memory does not suffice" in seen.err


@contextmanager
def only(free: int) -> Iterator[None]:
    """Let no more than so many bytes be had from here on."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + free, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="addresses are counted by /proc")
@pytest.mark.parametrize(
    ("free", "expected"), [(1 << 32, DataError), (100_000_000, MemoryShortError)]
)
def test_a_file_is_to_blame_only_where_there_is_room(
    free: int, expected: type[Exception], tmp_path: Path
) -> None:
    file = tmp_path / "log.parquet"
    file.write_bytes(b"small")
    with only(free), pytest.raises(expected), damage(file):
        bytearray(1 << 60)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="addresses are counted by /proc")
def test_whatever_fails_where_memory_is_short_is_its_fault() -> None:
    assert not memory.is_short(ValueError("nothing of the kind"))
    with only(10_000_000):
        assert memory.is_short(SystemError("error return without exception set"))
