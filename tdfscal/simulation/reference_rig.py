"""Rigs to simulate where the user gives none."""

from __future__ import annotations

import numpy as np

from tdfscal.records import Acceptance, DeclaredUncertainty, Rig, UncertainValue

GRAVITY = 9.80665


def make_rig(
    n: int = 3,
    mass: float = 500.0,
    radius: float = 0.6,
    *,
    height: float = 0.25,
    mass_std: float = 0.2,
    barycentre_std: float = 1.0e-3,
    zero_std: float = 0.5,
    declared: DeclaredUncertainty | None = None,
    name: str | None = None,
) -> Rig:
    """A rig of n hinges, evenly spaced on a circle of `radius` (m) in the LCS' xy plane.

    mass in kg; the barycentre lies `height` (m) above the middle of the circle; zeros are 0 N.
    The std are standard uncertainties (∞: unknown). declared: default 10 µm repeatability, 20 µm
    hinges, 0.1 N.
    """
    angle = 2.0 * np.pi * np.arange(n) / n
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    hinge = np.round(radius * circle, 15) + 0.0  # −0.3, not −0.29999999999999993 or −0.0
    return Rig(
        name=name or f"{n} supports, {mass:g} kg",
        supports=tuple(f"ncp{i + 1}" for i in range(n)),
        gravity=GRAVITY,
        gravity_tilt_std=0.0,
        mass=UncertainValue(np.array(mass), np.array(mass_std)),
        barycentre=UncertainValue(np.array([0.0, 0.0, height]), np.full(3, barycentre_std)),
        inertia=None,
        hinge=hinge,
        zero=UncertainValue(np.zeros((n, 3)), np.full((n, 3), zero_std)),
        nominal_rpy=np.zeros((n, 3)),
        rpy_std=np.full((n, 3), np.inf),
        capacity=np.full((n, 3), np.inf),
        axes=np.ones((n, 3), dtype=np.bool_),
        declared=declared or DeclaredUncertainty(positioner=1.0e-5, hinge=2.0e-5, force_noise=0.1),
        acceptance=Acceptance(),
    )


def reference_rig() -> Rig:
    """Three hinges at 120° on 0.6 m, 500 ± 0.2 kg, barycentre (0, 0, 0.25) m ± 1 mm."""
    return make_rig(name="Reference rig")
