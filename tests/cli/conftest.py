"""What several tests of the command line begin with."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.cli.running import SAMPLES


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """Copy of the sample campaign in Parquet, without the survey."""
    folder = tmp_path / "campaign"
    folder.mkdir()
    for name in ("rig.yaml", "log.parquet"):
        shutil.copy(SAMPLES / "parquet" / name, folder / name)
    return folder
