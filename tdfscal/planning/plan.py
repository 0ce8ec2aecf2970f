"""From a rig and its limits to the postures to drive, and the uncertainty to expect of them.

Which candidates to buy is told by their rows of information: greedy, then by exchange.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from tdfscal.errors import NotIdentifiableError, UsageError
from tdfscal.estimation.observability import PRIOR_SHARE
from tdfscal.frozen import record, replace
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.numerics.information import inverse
from tdfscal.planning.candidates import Candidates, Request, check_noise, draw
from tdfscal.planning.predicted_information import (
    Forecast,
    Sight,
    angle_rows,
    contact_excess,
    forecast,
    information,
    variances,
)
from tdfscal.records import ANGLES, BoolArray, FloatArray, IntArray, Rig


@record
class Plan:
    """Postures in the order to drive them, K rows.

    approach : (K,), ±1, side to come from: they alternate, so that backlash and friction show as
    scatter and not as angles. expected : the uncertainty that they promise.
    """

    rig: Rig
    request: Request
    postures: Candidates
    approach: IntArray
    expected: Forecast

    def __len__(self) -> int:
        return len(self.postures)

    @property
    def position(self) -> FloatArray:
        """Hinge centres (K, n, 3) to command, m, BCS: with the displacements that squeeze where a
        stiffness is known, else the forces postures.squeeze are to be servoed to.
        """
        return self.postures.position(self.request.limits)


#: Postures of a usual plan, and most that a target may ask for.
USUAL, _MOST = 24, 400
#: Rounds of exchange at most.
_SWEEPS = 12
#: A swap must lower the objective by this share, or rounding would swap for ever.
_WORTH = 1e-6
#: Candidates whose gains are worked out together.
_AT_ONCE = 32


class Planner:
    """A pool of candidates with all that choosing from it needs."""

    def __init__(self, rig: Rig, request: Request, rng: np.random.Generator) -> None:
        check_noise(rig, request.noise)
        self.rig, self.request = rig, request
        self.sight = Sight.of(rig, request.noise)
        self.held = self.sight.prior()
        self.pool = draw(rig, request.limits, request.candidates, rng.spawn(1)[0])
        self.rows = self.sight.rows(self.pool)
        some = self.pool.take(np.arange(min(8, len(self.pool))))
        # Information (p, p) to expect per posture of internal forces that nobody plans.
        self.scatter = self.sight.scatter(some, request.limits).mean(axis=0)
        self.sight = replace(self.sight, open=self._open())
        # L (r, p) with tr(L C Lᵀ) the mean variance of the angles.
        self.objective = angle_rows(self.sight) / np.sqrt(3 * rig.n)
        self.most = min(_MOST, len(self.pool))
        self._selected: dict[int, IntArray] = {}

    def _open(self) -> BoolArray:
        """Sensors (n,) without all axes that all candidates together leave undetermined."""
        lacking = np.asarray((~self.rig.axes).any(axis=1))
        if not lacking.any():
            return lacking
        seen = information(self.rows) + len(self.pool) * self.scatter
        std = np.sqrt(variances(inverse(self.held + seen), angle_rows(self.sight)))
        return np.asarray(lacking & self._weak(std.reshape(-1, 3)).any(axis=1))

    def _weak(self, std: FloatArray) -> BoolArray:
        """Angles (n, 3) that standard uncertainties, rad, leave undetermined."""
        limit, prior = self.rig.acceptance.identifiable, PRIOR_SHARE * self.rig.rpy_std
        return np.asarray((std >= limit) | (std > prior))

    def select(self, count: int) -> IntArray:
        """Choose `count` candidates, the one that tells most first."""
        if not 0 < count <= len(self.pool):
            what = f"{count} postures are to be chosen from {len(self.pool)} candidates"
            raise UsageError(what, hint="ask for fewer postures, for one at least")
        if count not in self._selected:
            base = self.held + count * self.scatter
            chosen, covariance = choose(self.rows, base, self.objective, count)
            first = int(np.argmax(gains(self.rows[chosen], covariance, self.objective)))
            self._selected[count] = np.concatenate([chosen[[first]], np.delete(chosen, first)])
        return self._selected[count]

    def forecast(self, postures: Candidates) -> Forecast:
        """Uncertainty to expect of postures, with what is held already."""
        stated = self.rig.acceptance
        at = stated.contact_rpy if stated.states_contact else None
        return forecast(self.sight, postures, self.request.limits, self.held, at)

    def fewest(
        self, excess: Callable[[Forecast], float], low: int, progress: Callable[[str], None]
    ) -> int:
        """Fewest postures, above `low`, whose excess over what is asked is at most 1.

        Variances fall as the inverse of their number. Above `most` where none of them gets there.
        """
        count, high = USUAL, self.most + 1
        while high - low > 1:
            progress(f"trying {count} postures")
            reached = excess(self.forecast(self.pool.take(self.select(count))))
            low, high = (low, count) if reached <= 1.0 else (count, high)
            count = int(np.clip(np.ceil(count * reached**2), low + 1, high - 1))
        return high

    def plan(self, count: int) -> Plan:
        """Choose, order and judge."""
        chosen = self.pool.take(self.select(count))
        postures = chosen.take(short_tour(chosen.place))
        expected = self.forecast(postures)
        self._refuse_unobservable(expected, count)
        approach = 1 - 2 * (np.arange(count) % 2)
        return Plan(self.rig, self.request, postures, approach, expected)

    def _refuse_unobservable(self, expected: Forecast, count: int) -> None:
        """Raise NotIdentifiableError where the best of plans leaves an angle open."""
        weak, known = self._weak(expected.rpy_std), np.isfinite(expected.rpy_std)
        if not weak.any():
            return
        open_, told = (", ".join(self._named(which)) for which in (weak, ~weak & known))
        raise NotIdentifiableError(
            f"within these limits {count} postures do not determine {open_}; they do determine "
            f"{told or 'no angle'}",
            hint="allow a larger squeeze, tilt more, or drive more postures",
        )

    def _named(self, which: BoolArray) -> Iterator[str]:
        """Some of the angles (n, 3), sensor by sensor."""
        for name, row in zip(self.rig.supports, which, strict=True):
            if row.any():
                angles = (a for a, told in zip(ANGLES, row, strict=True) if told)
                yield f"{' and '.join(angles)} of {name}"


def make_plan(
    rig: Rig,
    request: Request,
    postures: int | None,
    rng: np.random.Generator,
    *,
    target: float | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> Plan:
    """Choose postures and squeezes by exchange over a random pool.

    postures : how many to drive; None: as few as bring every angle within ± `target`, rad, with
    95 %, else as many as is usual, or more where the rig file's limits of the contact wrench ask.
    progress : told how many postures are tried.

    Raises
    ------
    UsageError : infeasible limits. NotIdentifiableError : an angle stays open, or no number of
        postures gets to the target.
    """
    planner = Planner(rig, request, rng)
    if postures is None and target is not None:
        if not 0.0 < target < np.inf:
            raise UsageError(f"the target is {target:g} rad", hint="give a number above zero")
        postures = planner.fewest(
            lambda found: INTERVAL_FACTOR * found.largest / target, 0, progress
        )
        if postures > planner.most:
            raise NotIdentifiableError(
                f"{planner.most} postures do not bring the weakest angle within "
                f"± {1e3 * target:.3g} mrad (95 %), which is asked for",
                hint="squeeze harder, average longer, or know zeros, mass and barycentre better",
            )
    elif postures is None and rig.acceptance.states_contact:
        postures = planner.fewest(lambda found: contact_excess(rig, found), USUAL - 1, progress)
        postures = USUAL if postures > planner.most else postures
    return planner.plan(USUAL if postures is None else postures)


def gains(J: FloatArray, C: FloatArray, L: FloatArray) -> FloatArray:
    """Fall (N,) of tr(L C Lᵀ) by each candidate's rows J (N, m, p), by the matrix lemma."""
    N, m, p = J.shape
    T = (J.reshape(-1, p) @ C).reshape(N, m, p)
    S = T @ np.swapaxes(J, 1, 2)
    S[:, np.arange(m), np.arange(m)] += 1.0
    Q = (T.reshape(-1, p) @ L.T).reshape(N, m, -1)
    return np.asarray(np.einsum("kmr,kmr->k", Q, np.linalg.solve(S, Q)))


def best_gain(
    J: FloatArray, C: FloatArray, L: FloatArray, taken: list[int], least: float
) -> tuple[int, float]:
    """The candidate with the largest of the `gains`, and that; −1 where none is above `least`.

    No gain exceeds |L C Jᵀ|², S being 1 at least: few candidates are asked for their own.
    """
    Q = (J.reshape(-1, len(C)) @ (C @ L.T)).reshape(len(J), -1)
    bound = np.einsum("kr,kr->k", Q, Q)
    bound[taken] = -1.0
    best, order, first = -1, np.argsort(-bound), 0
    while first < len(order) and bound[order[first]] > least:
        some = np.sort(order[first : first + _AT_ONCE])
        some, first = some[bound[some] > least], first + _AT_ONCE
        gain = gains(J[some], C, L)
        if gain.max() > least:
            best, least = int(some[gain.argmax()]), float(gain.max())
    return best, least


def updated(C: FloatArray, J: FloatArray, sign: float = 1.0) -> FloatArray:
    """Covariance with rows J (m, p) added, or with sign −1 taken away."""
    T = J @ C
    S = np.eye(len(J)) + sign * T @ J.T
    return np.asarray(C - sign * T.T @ np.linalg.solve(S, T))


def greedy(J: FloatArray, base: FloatArray, L: FloatArray, count: int) -> list[int]:
    """Choose `count` candidates, each once, the most useful first, on top of `base` (p, p)."""
    C, chosen = inverse(base), list[int]()
    for _ in range(count):
        best, _ = best_gain(J, C, L, chosen, -1.0)
        chosen.append(best)
        C = updated(C, J[best])
    return chosen


def choose(
    J: FloatArray, base: FloatArray, L: FloatArray, count: int
) -> tuple[IntArray, FloatArray]:
    """Minimise tr(L (base + Σ JᵀJ)⁻¹ Lᵀ) over `count` of the candidates: greedy, then exchange.

    J : (N, m, p), whitened rows. base : (p, p), information held already, positive definite.
    L : (r, p). Each candidate is taken at most once. Returns their indices and the covariance.
    """
    chosen = greedy(J, base, L, count)
    for _ in range(_SWEEPS):
        C = inverse(base + information(J[chosen]))
        value = float(variances(C, L).sum())
        swapped = False
        for place, old in enumerate(chosen):
            without = updated(C, J[old], -1.0)
            held = float(variances(without, L).sum())
            new, gain = best_gain(J, without, L, chosen, held - value * (1 - _WORTH))
            if new >= 0:
                chosen[place], C = new, updated(without, J[new])
                value, swapped = held - gain, True
        if not swapped:
            break
    return np.array(chosen), inverse(base + information(J[chosen]))


def short_tour(place: FloatArray) -> IntArray:
    """Order (K,) in which to drive postures with hinges at place (K, n, 3), m: the first, then
    always the nearest one that is left, by the way of the slowest axis.
    """
    flat = place.reshape(len(place), -1)
    way = np.max(np.abs(flat[:, None] - flat), axis=2)
    tour, left = [0], set(range(1, len(place)))
    while left:
        tour.append(min(left, key=lambda k: (way[tour[-1], k], k)))
        left.remove(tour[-1])
    return np.array(tour)
