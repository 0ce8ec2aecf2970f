"""The gears: energy, clearances, friction."""

import numpy as np
import pytest

from studies.control.contact import GearPair
from tdfscal.records import FloatArray

SMOOTH = GearPair(friction=0.0)


def loop(rng: np.random.Generator, depth: float, count: int, aside: float = 3e-4) -> FloatArray:
    """A closed path (count + 1, 6) about `depth` that presses in every direction."""
    phase = 2.0 * np.pi * np.arange(count + 1) / count
    size = np.array([aside, aside, 2e-3, 1e-3, 1e-3, 2e-3])
    q = np.zeros((count + 1, 6))
    for k in (1, 2, 3):
        a, b = rng.normal(size=(2, 6)) * size / k
        q += np.cos(k * phase)[:, None] * a + np.sin(k * phase)[:, None] * b
    q[:, 2] += depth
    return q


def work(gears: GearPair, q: FloatArray, *, rub: bool) -> tuple[float, float]:
    """Work on the gears along a path, and the sum of its parts' sizes, J."""
    middle, step = 0.5 * (q[1:] + q[:-1]), np.diff(q, axis=0)
    part = np.sum(gears.wrench(middle, step / 1e-3 if rub else None) * step, axis=1)
    return float(part.sum()), float(np.abs(part).sum())


@pytest.mark.parametrize("depth", [0.0, 3.0e-3, 1.0 / 3.0])
def test_contact_without_friction_conserves_energy(depth: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(2):
        # Shallow paths must reach the lead-in, 1.7 mm wide.
        q = loop(rng, depth, 60_000, 3e-3 if depth < 3e-3 else 3e-4)
        net, gross = work(SMOOTH, q, rub=False)
        assert gross > 1e-4
        assert abs(net) < 2e-4 * gross


def test_clearance_and_stiffness() -> None:
    gears = SMOOTH
    q = np.zeros((4, 6))
    q[:, 2] = 0.1
    q[:, 0] = [0.0, 4.99e-5, 6.0e-5, -6.0e-5]
    force = gears.wrench(q)
    assert not force[:2].any()
    # Tip and mouth bear on one tooth each, 10 µm beyond the clearance.
    assert force[2, 0] == pytest.approx(-2 * gears.stiffness * 1e-5, rel=1e-9)
    np.testing.assert_allclose(force[3, :3], -force[2, :3], atol=1e-12)
    twisted = np.zeros((2, 6))
    twisted[:, 2], twisted[:, 5] = 0.1, [1.99e-4, 3e-4]
    torque = gears.wrench(twisted)[:, 5]
    assert torque[0] == 0.0
    assert torque[1] == pytest.approx(-gears.stiffness * gears.radius**2 * 1e-4, rel=1e-9)
