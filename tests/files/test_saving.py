"""A file appears whole or not at all, where its name leads."""

import os
import stat
from pathlib import Path

import pytest

from tdfscal.files.outputs import replacing
from tdfscal.files.saving import write_text


def test_writing_that_fails_leaves_the_old_file_and_no_trace(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("old")

    def fail_half_way() -> None:
        with replacing(path) as beside:
            beside.write_text("half")
            raise RuntimeError("beside it" if beside.parent == path.parent else "elsewhere")

    with pytest.raises(RuntimeError, match="beside it"):
        fail_half_way()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_written_file_keeps_mode_and_link_and_a_pipe_stays_one(tmp_path: Path) -> None:
    real, link, pipe = (tmp_path / name for name in ("real.yaml", "link.yaml", "pipe"))
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real.name)
    write_text(link, "new\n")
    assert link.is_symlink()
    assert real.read_bytes() == b"new\n"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_text(pipe, "through")
        assert os.read(reading, 100) == b"through"
    finally:
        os.close(reading)
    assert pipe.is_fifo()
