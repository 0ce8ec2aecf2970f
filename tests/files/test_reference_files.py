"""Files that release 1.0 wrote are read for ever, whole and to the same numbers.

They are never made anew: where one is refused, the reading has broken.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from tdfscal.exports import FORMATS
from tdfscal.files.calibration.consistency import FORMER
from tdfscal.files.calibration.document import file_content, load_calibration
from tdfscal.files.calibration.parameters import calibrated
from tests.files.sample_documents import lacking

FILES = sorted((Path(__file__).parent / "reference_1_0").glob("*.json"))


def test_there_is_one_of_each_kind() -> None:
    assert [path.stem for path in FILES] == ["joint", "motion", "update"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_file_of_1_0_is_read(path: Path) -> None:
    content = json.loads(path.read_text(encoding="utf-8"))
    file = load_calibration(path)
    assert file.accepted
    assert file.software.version == "1.0.0"
    former = lacking(content, file_content(file))
    assert set(former) <= {".content_sha256", *(f".{'.'.join(place)}" for place in FORMER)}
    supports = content["supports"]
    assert np.array_equal(file.rotation, [support["rotation"] for support in supports])
    assert np.array_equal(file.rotation_covariance, content["covariance"]["matrix"])
    assert np.array_equal(file.zero, [support["zero"] for support in supports])
    used = calibrated(file)
    assert float(used.state.mass) == pytest.approx(content["terminal"]["mass"]["value"], rel=1e-12)
    for written in FORMATS.values():
        assert written(file, "bcs")
