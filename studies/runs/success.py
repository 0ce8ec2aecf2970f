"""Does the assembly succeed, against the error of the angles, for contacts from soft to stiff?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from studies.control.contact import GearPair
from studies.control.runs import Controller
from studies.runs.compared_calibrations import misaligned
from studies.runs.docking import DockingStudy, Setup, docking
from tdfscal.records import FloatArray

#: Standard deviations of a turn per axis, rad.
DEVIATIONS = (5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3)
#: Contact stiffness over that of the gears given: two decades.
FACTORS = (0.1, 10**-0.5, 1.0, 10**0.5, 10.0)


@dataclass(frozen=True, slots=True)
class SuccessStudy:
    """S contact stiffnesses, D angle errors, N runs each.

    studies : (S,), the dockings, arms by angle error. deviations : (D,), rad.
    """

    deviations: FloatArray
    studies: tuple[DockingStudy, ...]
    seed: int

    @property
    def stiffness(self) -> FloatArray:
        """(S,), N/m of a tooth."""
        return np.array([study.setup.gears.stiffness for study in self.studies])

    @property
    def runs(self) -> int:
        """N."""
        return self.studies[0].arms.runs

    def force(self, s: int, d: int) -> FloatArray:
        """Largest true force, N, along any axis, of the runs that made contact (n,)."""
        study = self.studies[s]
        return np.asarray(study.peak[d, study.touched[d], :3].max(axis=-1))


def success(
    setup: Setup,
    controller: Callable[[GearPair], Controller],
    runs: int,
    seed: int,
    *,
    deviations: Sequence[float] = DEVIATIONS,
    workers: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> SuccessStudy:
    """Dock with controllers that know all but the angles, once per angle error, stiffness and run.

    controller : that for gears of another stiffness, by `FACTORS` of that of the setup's; each has
    to be stable. The same machines, directions of the errors and noise meet every case.

    Raises
    ------
    UsageError : a way that leaves the NCPs' travel, or an unstable loop.
    """
    arm_seed, study_seed = np.random.SeedSequence(seed).spawn(2)
    arms = misaligned(setup.rig, runs, deviations, np.random.default_rng(arm_seed))
    studies = []
    for s, factor in enumerate(FACTORS):
        gears = replace(
            setup.gears,
            stiffness=factor * setup.gears.stiffness,
            seat_stiffness=factor * setup.gears.seat_stiffness,
        )
        one = replace(setup, gears=gears, controller=controller(gears))
        fresh = np.random.SeedSequence(entropy=study_seed.entropy, spawn_key=study_seed.spawn_key)
        studies.append(
            docking(
                one,
                arms,
                fresh,
                seed,
                workers=workers,
                progress=lambda share, s=s: progress((s + share) / len(FACTORS)),  # type: ignore[misc]
            )
        )
    return SuccessStudy(np.asarray(deviations), tuple(studies), seed)
