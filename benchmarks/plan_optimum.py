"""Plans against an optimiser that is not the plan's: SLSQP, from the plan and from random starts.

    python -m benchmarks.plan_optimum [STARTS [SUPPORTS ...]]

All postures move together: turn, lean and internal forces of each, their limits as constraints, the
gradient by differences of one posture's rows. Appended to benchmarks/plan.md.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import minimize

from benchmarks.plan import FEW, NOISE, STIFF, TILT
from tdfscal.numerics import so3
from tdfscal.planning import Limits, Plan, Request, make_plan
from tdfscal.planning.candidates import Candidates, realised
from tdfscal.planning.choice import Planner
from tdfscal.planning.refinement import turn_and_lean
from tdfscal.records import FloatArray
from tdfscal.simulation import make_rig

SQUEEZE, STEP, ITERATIONS = 200.0, 1e-5, 300
DISTINCT = FEW - 1  # the first posture comes again


@dataclass
class Problem:
    """Postures as one vector: per posture turn and lean over the tilt limit, and internal forces.

    modes : (n, 3, m), internal forces in the LCS, in which they do not depend on the pose.
    """

    planner: Planner
    limits: Limits
    modes: FloatArray

    @property
    def size(self) -> int:
        """Unknowns of a posture."""
        return 3 + int(self.modes.shape[2])

    def postures(self, x: FloatArray, limits: Limits) -> Candidates:
        """Postures (K) of unknowns (K, size)."""
        angles = TILT * x[:, :3]
        lean = np.concatenate([angles[:, 1:], np.zeros((len(x), 1))], axis=1)
        turn = np.concatenate([np.zeros((len(x), 2)), angles[:, :1]], axis=1)
        R = so3.exp(turn) @ so3.exp(lean)
        squeeze = SQUEEZE * np.einsum("kab,nbm,km->kna", R, self.modes, x[:, 3:])
        found = realised(self.planner.rig, limits, angles[:, 0], angles[:, 1:], squeeze)
        assert found is not None
        return found[0]

    def value(self, flat: FloatArray) -> tuple[float, FloatArray]:
        """log tr(L C Lᵀ) and its gradient."""
        x = flat.reshape(DISTINCT, self.size)
        moved = x[:, None] + STEP * np.concatenate([np.zeros((1, self.size)), np.eye(self.size)])
        rows = self.planner.sight.rows(self.postures(moved.reshape(-1, self.size), self._wide))
        rows = rows.reshape(DISTINCT, self.size + 1, *rows.shape[1:])
        weight = np.ones(DISTINCT)
        weight[0] = 2.0
        base = self.planner.held + FEW * self.planner.scatter
        own = rows[:, 0]
        C = np.linalg.inv(base + np.einsum("k,kap,kaq->pq", weight, own, own))
        LC = self.planner.objective @ C
        total = float(np.sum(LC * self.planner.objective))
        seen = np.sum((rows @ LC.T) ** 2, axis=(2, 3))
        gradient = -weight[:, None] * (seen[:, 1:] - seen[:, :1]) / STEP / total
        return float(np.log(total)), gradient.ravel()

    @property
    def _wide(self) -> Limits:
        """Limits that a difference at the limit does not meet."""
        return Limits(1.01 * TILT, 1.01 * SQUEEZE, self.limits.travel, self.limits.home,
                      stiffness=STIFF)  # fmt: skip

    def room(self, flat: FloatArray) -> FloatArray:
        """What is left of the limits, each at least 0: lean, and internal force of each NCP."""
        x = flat.reshape(DISTINCT, self.size)
        force = np.einsum("nbm,km->knb", self.modes, x[:, 3:])
        lean = 1.0 - np.sum(x[:, 1:3] ** 2, axis=1)
        return np.concatenate([lean[:, None], 1.0 - np.sum(force**2, axis=2)], axis=1).ravel()

    def room_gradient(self, flat: FloatArray) -> FloatArray:
        """Its derivative."""
        x, n = flat.reshape(DISTINCT, self.size), len(self.modes)
        force = np.einsum("nbm,km->knb", self.modes, x[:, 3:])
        each = np.zeros((DISTINCT, 1 + n, DISTINCT, self.size))
        k = np.arange(DISTINCT)
        each[k, 0, k, 1:3] = -2.0 * x[:, 1:3]
        each[k, 1:, k, 3:] = -2.0 * np.einsum("knb,nbm->knm", force, self.modes)
        return each.reshape(DISTINCT * (1 + n), -1)

    def random(self, rng: np.random.Generator) -> FloatArray:
        """Unknowns (K, size) anywhere within the limits."""
        start = rng.uniform(-1.0, 1.0, (DISTINCT, self.size))
        start[:, 1:3] /= np.maximum(np.linalg.norm(start[:, 1:3], axis=1), 1.0)[:, None]
        reach = np.linalg.norm(np.einsum("nbm,km->knb", self.modes, start[:, 3:]), axis=2)
        start[:, 3:] /= np.maximum(reach.max(axis=1), 1.0)[:, None]
        return start

    def of(self, plan: Plan) -> FloatArray:
        """Unknowns (K, size) of a plan, without its return."""
        distinct = plan.postures.take(np.delete(np.arange(FEW), plan.returns))
        turn, lean = turn_and_lean(distinct.rotation)
        inner = np.einsum("kba,knb->kna", distinct.rotation, distinct.squeeze) / SQUEEZE
        amount = np.einsum("nam,kna->km", self.modes, inner)
        return np.concatenate([turn[:, None] / TILT, lean / TILT, amount], axis=1)

    def solved(self, start: FloatArray) -> float:
        """Mean standard uncertainty of an angle, rad, where SLSQP ends."""
        turn = [(-1.0, 1.0)] + [(None, None)] * (self.size - 1)
        found = minimize(
            self.value, start.ravel(), jac=True, method="SLSQP", bounds=turn * DISTINCT,
            constraints={"type": "ineq", "fun": self.room, "jac": self.room_gradient},
            options={"maxiter": ITERATIONS, "ftol": 1e-7},
        )  # fmt: skip
        postures = self.postures(found.x.reshape(DISTINCT, self.size), self.limits)
        rows = np.append(np.arange(DISTINCT), 0)
        return float(self.planner.forecast(postures.take(rows)).rpy_std.mean())


def problem(n: int) -> Problem:
    """Supports on a circle, as in `benchmarks.plan`."""
    rig = make_rig(n=n)
    limits = Limits(TILT, SQUEEZE, np.full((n, 3), np.inf), np.zeros(3), stiffness=STIFF)
    planner = Planner(rig, Request(limits, noise=NOISE), np.random.default_rng(0), None)
    arm = rig.hinge - rig.hinge.mean(axis=0)
    balance = np.concatenate([np.tile(np.eye(3), n), np.hstack(list(so3.hat(arm)))])
    return Problem(planner, limits, null_space(balance).reshape(n, 3, -1))


def main() -> None:
    """Print the table."""
    starts = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    print(
        f"\n# Against another optimiser\n\n`python -m benchmarks.plan_optimum {starts}`: SLSQP on "
        f"the plan's objective, all {FEW} postures at once, from the plan and from {starts} random "
        "starts; mean\nstandard uncertainty of an angle, mrad.\n"
    )
    print("| n | plan | CPU, s | SLSQP from it | best of random | median | plan / best | CPU |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for n in map(int, sys.argv[2:] or "3456"):
        task, begin = problem(n), time.process_time()
        plan = make_plan(task.planner.rig, task.planner.request, FEW, np.random.default_rng(0))
        mine, spent = float(plan.expected.rpy_std.mean()), time.process_time() - begin
        local = task.solved(task.of(plan))
        found = [task.solved(task.random(np.random.default_rng(k))) for k in range(starts)]
        best = min(local, *found)
        print(
            f"| {n} | {1e3 * mine:.4f} | {spent:.1f} | {1e3 * local:.4f} | {1e3 * min(found):.4f} "
            f"| {1e3 * np.median(found):.4f} | {mine / best:.3f} "
            f"| {time.process_time() - begin - spent:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
