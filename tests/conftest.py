"""One thread of linear algebra for each worker; the sample campaign, calibrated once."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tdfscal import Calibration
    from tests.cli.running import Cli

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import tdfscal.catalogue  # noqa: E402, F401  whose words errors are read in


@pytest.fixture(scope="session")
def sample() -> "Calibration":
    """The calibration of the sample campaign in Parquet, without trials."""
    from tdfscal import calibrate

    return calibrate(Path(__file__).parents[1] / "sample_data" / "parquet", trials=0)


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> "Cli":
    """Runs the command line in this process."""
    from tests.cli.running import Cli

    return Cli(capsys)
