"""A file appears whole or not at all, where its name leads."""

from pathlib import Path

import pytest

from tdfscal.files.outputs import replacing


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
