"""What several tests of the command line begin with."""

import shutil
from pathlib import Path

import pytest

from tests.cli import world
from tests.cli.running import SAMPLES


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files for every outcome of every command; see `world`."""
    folder = tmp_path_factory.mktemp("world")
    world.build(folder)
    return folder


@pytest.fixture(scope="module")
def home(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of these files, to write into."""
    return Path(shutil.copytree(built, tmp_path_factory.mktemp("home") / "world"))


@pytest.fixture
def here(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in the folder; leave out drawing figures, which takes seconds."""
    monkeypatch.chdir(home)
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """Copy of the sample campaign in Parquet, without the survey."""
    folder = tmp_path / "campaign"
    folder.mkdir()
    for name in ("rig.yaml", "log.parquet"):
        shutil.copy(SAMPLES / "parquet" / name, folder / name)
    return folder
