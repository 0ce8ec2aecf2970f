"""Files that release 1.0 wrote are read for ever, whole and to the same numbers.

They are never made anew: where one is refused, the reading has broken.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from tdfscal.exports import FORMATS
from tdfscal.files.calibration.document import file_content, load_calibration
from tdfscal.files.calibration.parameters import calibrated

FOLDER = Path(__file__).parent / "reference_1_0"


@pytest.mark.parametrize("name", ["joint", "motion", "update"])
def test_a_file_of_1_0_is_read(name: str) -> None:
    content = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    file = load_calibration(FOLDER / f"{name}.json")
    assert file.accepted
    assert file.software.version == "1.0.0"
    written = file_content(file)
    assert {key: written[key] for key in content} == content
    supports = content["supports"]
    assert np.array_equal(file.rotation, [support["rotation"] for support in supports])
    assert np.array_equal(file.rotation_covariance, content["covariance"]["matrix"])
    assert np.array_equal(file.zero, [support["zero"] for support in supports])
    used = calibrated(file)
    assert float(used.state.mass) == pytest.approx(content["terminal"]["mass"]["value"], rel=1e-12)
    assert all(export(file, "bcs") for export in FORMATS.values())
