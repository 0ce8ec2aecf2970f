"""Stops by the hinges' speed, against the drive that was simulated."""

import numpy as np

from tdfscal.model.samples_in_motion import Samples, still


def driven(begin: float, end: float, speed: float) -> Samples:
    """A minute at 100 Hz in which all hinges move along x between two times."""
    time = np.arange(6000) / 100
    way = speed * (np.clip(time, begin, end) - begin)
    position = np.zeros((len(time), 3, 3))
    position[..., 0] = way[:, None]
    return Samples(time, position, np.zeros_like(position))


def test_a_move_is_told_from_the_stops_beside_it() -> None:
    """1 mm/s from 20 to 40 s; half a span about the ends may go either way."""
    found = still(driven(20.0, 40.0, 1e-3))
    time = np.arange(6000) / 100
    assert not found[(time > 20.1) & (time < 39.9)].any()
    assert found[(time < 19.9) | (time > 40.1)].all()
    assert still(driven(20.0, 40.0, 1e-4)).all()
