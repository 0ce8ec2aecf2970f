import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.checks.rig_from_log import sketch_rig
from tdfscal.errors import DataError


def test_instants_without_a_finite_number_are_left_out() -> None:
    rig = simulation.make_rig(3)
    batch = simulation.simulate_dwells(rig, simulation.Options(), np.random.default_rng(0), 1)
    dwells = batch.dwells(0)
    position, force = dwells.position.copy(), dwells.force.copy()
    position[3, 0, 1], force[5, 2, 0] = np.inf, np.nan
    whole = np.delete(np.arange(len(position)), [3, 5])
    found = sketch_rig(position, force, rig.gravity)
    alone = sketch_rig(position[whole], force[whole], rig.gravity)
    np.testing.assert_array_equal(found.hinge, alone.hinge)
    assert found.mass == alone.mass
    position[:] = np.nan
    with pytest.raises(DataError, match="finite"):
        sketch_rig(position, force, rig.gravity)
