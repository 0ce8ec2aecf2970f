import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.errors import DataError
from tdfscal.files.rig.draft import sketch_rig

RIG = simulation.make_rig(3)
RNG = np.random.default_rng(0)
DWELLS = simulation.simulate_dwells(RIG, simulation.Options(), RNG, 1).dwells(0)


def test_instants_without_a_finite_number_are_left_out() -> None:
    position, force = DWELLS.position.copy(), DWELLS.force.copy()
    position[3, 0, 1], force[5, 2, 0] = np.inf, np.nan
    whole = np.delete(np.arange(len(position)), [3, 5])
    found = sketch_rig(position, force, RIG.gravity)
    alone = sketch_rig(position[whole], force[whole], RIG.gravity)
    np.testing.assert_array_equal(found.hinge, alone.hinge)
    assert found.mass == alone.mass
    position[:] = np.nan
    with pytest.raises(DataError, match="finite"):
        sketch_rig(position, force, RIG.gravity)


def test_the_drafts_axes_are_those_of_the_posture_that_is_named() -> None:
    position = DWELLS.position.copy()
    position[0, 0, 0] = np.nan  # what is left out counts in the number all the same
    found = sketch_rig(position, DWELLS.force, RIG.gravity)
    there = position[found.reference] - position[found.reference].mean(axis=0)
    assert np.abs(found.hinge - there).max() < 5 * found.spread + 1e-4
    off = [np.abs(found.hinge - p + p.mean(axis=0)).max() for p in np.delete(position, 0, axis=0)]
    assert np.median(off) > 1e-2  # other postures lean otherwise
