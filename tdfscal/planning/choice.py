"""From a rig and its limits to the postures to drive, and the uncertainty to expect of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import ceil

import numpy as np

from tdfscal.errors import NotIdentifiableError, UsageError
from tdfscal.estimation.observability import PRIOR_SHARE
from tdfscal.numerics import so3
from tdfscal.planning.candidates import Candidates, check_limits, check_reach, draw
from tdfscal.planning.plan import Plan, Request, contact_conforms, hinge_radius
from tdfscal.planning.predicted_information import (
    Forecast,
    Sight,
    angle_rows,
    averaged,
    forecast,
    leaning,
    wrench_rows,
)
from tdfscal.planning.selection import (
    approaches,
    choose,
    distances,
    gains,
    information,
    inverse,
    objective,
    short_tour,
    variances,
    with_returns,
)
from tdfscal.records import ANGLES, BoolArray, FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import Fit, faked_information

#: Most postures that a target may ask for.
MOST = 400
#: Factor by which more are tried until a contact is known.
_MORE = 1.4
#: Postures per return to the first one.
_PER_RETURN = 24
#: Fewest postures of which one is spent on a return.
_FEWEST_WITH_RETURN = 6
#: Random sets that stand for driving without a plan.
_RANDOM_SETS = 16
#: An objective that follows the width of ignorance by more than this share is not measured.
_FOLLOWS = 1e-2


class Planner:
    """A pool of candidates with all that choosing from it needs."""

    def __init__(
        self, rig: Rig, request: Request, rng: np.random.Generator, given: Fit | None
    ) -> None:
        _check(rig, request)
        self.rig, self.request, self.given = rig, request, given
        pool_rng, self.rng = rng.spawn(2)
        self.sight = Sight.of(rig, request.noise, given.state if given else None)
        self.held = self._held(self.sight)
        self.pool = draw(rig, request.limits, request.candidates, pool_rng)
        self.rows = self.sight.rows(self.pool)
        self.scatter = self._scatter(self.sight)
        self.leaning = (self.sight,) if given else leaning(self.sight)
        self.sight = replace(self.sight, open=self._open())
        self.objective = self._objective()
        self._usual: FloatArray | None = None
        self._selected: dict[int, IntArray] = {}

    def _held(self, sight: Sight) -> FloatArray:
        """Information (p, p) that stands before the plan: priors and recorded postures."""
        held = sight.prior()
        if self.given is not None:
            J = self.given.at.whitener @ self.given.jacobian
            held = held + np.einsum("k,kmp,kmq->pq", self.given.weight, J, J)
            turns = slice(0, 3 * self.rig.n)
            held[turns, turns] -= faked_information(self.given)
            # Where noise fakes all there is, ignorance remains: 1 in units of its width.
            values, vectors = np.linalg.eigh(sight.wide[:, None] * held * sight.wide)
            half = vectors * np.sqrt(np.maximum(values, 1.0)) / sight.wide[:, None]
            held = half @ half.T
        return held

    def _scatter(self, sight: Sight) -> FloatArray:
        """Information (p, p) to expect per posture of internal forces that nobody plans."""
        some = self.pool.take(np.arange(min(8, len(self.pool))))
        return np.asarray(sight.scatter(some, self.request.limits).mean(axis=0))

    def _open(self) -> BoolArray:
        """Sensors (n,) without all axes that all candidates together leave undetermined."""
        lacking = np.asarray((~self.rig.axes).any(axis=1))
        if not lacking.any():
            return lacking
        variance = []
        for sight in self.leaning:
            seen = information(sight.rows(self.pool)) + len(self.pool) * self._scatter(sight)
            variance.append(variances(inverse(self.held + seen), angle_rows(sight)))
        std = np.sqrt(np.mean(variance, axis=0)).reshape(-1, 3)
        return np.asarray(lacking & self._weak(std).any(axis=1))

    def _weak(self, std: FloatArray) -> BoolArray:
        """Angles (n, 3) that standard uncertainties, rad, leave undetermined."""
        limit, prior = self.rig.acceptance.identifiable, PRIOR_SHARE * self.rig.rpy_std
        return np.asarray((std >= limit) | (std > prior))

    def _objective(self) -> FloatArray:
        """L (r, p) with tr(L C Lᵀ) the mean variance of the angles, or of the contact wrench.

        Moments count by the force that makes them at the hinges.
        """
        if self.request.objective == "angles":
            L = angle_rows(self.sight)
        else:
            L = wrench_rows(self.sight, self.rig.acceptance.contact_rpy)
            L[3:] /= hinge_radius(self.rig)
        return np.asarray(L / np.sqrt(len(L)))

    def select(self, count: int) -> tuple[IntArray, int]:
        """Choose distinct candidates and how often the first comes again: `count` rows in all."""
        returns = max(1, round(count / _PER_RETURN)) if count >= _FEWEST_WITH_RETURN else 0
        if count - returns > len(self.pool):
            raise UsageError(
                f"{count - returns} postures are to be chosen from {len(self.pool)} candidates",
                hint="ask for more candidates",
            )
        if count not in self._selected:
            base = self.held + count * self.scatter
            chosen, covariance = choose(self.rows, base, self.objective, count - returns)
            first = int(np.argmax(gains(self.rows[chosen], covariance, self.objective)))
            self._selected[count] = np.concatenate([chosen[[first]], np.delete(chosen, first)])
        return self._selected[count], returns

    def forecast(self, postures: Candidates) -> Forecast:
        """Uncertainty to expect of postures, with what is held already."""
        stated = self.rig.acceptance
        wanted = self.request.objective == "wrench" or stated.states_contact
        at = stated.contact_rpy if wanted else None
        limits, held = self.request.limits, self.held
        draws: list[np.random.Generator | None] = [None]
        if not self.rig.axes.all():
            draws = [*np.random.default_rng(0).spawn(len(self.leaning))]
        seen = (replace(sight, open=self.sight.open) for sight in self.leaning)
        return averaged(
            [
                forecast(sight, postures, limits, held, at, rng)
                for sight, rng in zip(seen, draws, strict=True)
            ]
        )

    def expected(self, count: int) -> Forecast:
        """Uncertainty to expect of the pool's best `count` rows."""
        index, returns = self.select(count)
        rows = np.concatenate([index, np.repeat(index[:1], returns)])
        return self.forecast(self.pool.take(rows))

    def scaled(self, count: int) -> float:
        """About the largest std to expect, rad, by the information per posture of a usual plan."""
        if self._usual is None:
            index, _ = self.select(min(_PER_RETURN, len(self.pool)))
            J = self.rows[index]
            self._usual = information(J) / len(index) + self.scatter
        C = inverse(self.held + count * self._usual)
        return float(np.sqrt(variances(C, angle_rows(self.sight)).max()))

    def plan(self, count: int) -> Plan:
        """Choose, order and judge."""
        if count < 1:
            raise UsageError(f"{count} postures are asked for", hint="ask for one or more")
        index, returns = self.select(count)
        distinct = self.pool.take(index)
        order = with_returns(short_tour(distances(distinct.place), 0), returns)
        postures = distinct.take(order)
        expected = self.forecast(postures)
        self._refuse_unobservable(postures, expected)
        return Plan(
            rig=self.rig,
            request=self.request,
            postures=postures,
            approach=approaches(order),
            returns=np.flatnonzero(order == order[0])[1:],
            given=0 if self.given is None else int(np.sum(self.given.weight > 0)),
            before=None if self.given is None else self.forecast(postures.take(order[:0])),
            expected=expected,
            random=self._random(count),
        )

    def _random(self, count: int) -> Forecast:
        """Mean forecast of random sets of as many postures."""
        sets = [
            self.forecast(draw(self.rig, self.request.limits, count, self.rng, extremes=False))
            for _ in range(_RANDOM_SETS)
        ]
        return averaged(sets, power=1)

    def _refuse_unobservable(self, postures: Candidates, expected: Forecast) -> None:
        """Raise NotIdentifiableError where the best of plans does not reach the objective."""
        if self.request.objective == "wrench":
            self._refuse_unmeasured(postures)
            return
        weak = self._weak(expected.rpy_std)
        if not weak.any():
            return
        names = [f"{ANGLES[j]} of {self.rig.supports[i]}" for i, j in np.argwhere(weak)]
        worst = 1e3 * float(expected.rpy_std[weak].max())
        raise NotIdentifiableError(
            f"within these limits {len(postures)} postures do not determine {', '.join(names)} "
            f"(up to ±{worst:.3g} mrad)",
            where="objective angles",
            hint="allow a larger squeeze, tilt more, or drive more postures",
        )

    def _refuse_unmeasured(self, postures: Candidates) -> None:
        """Raise where the wrench's variance is what ignorance was taken to be."""
        seen = information(self.sight.rows(postures))
        seen += self.sight.scatter(postures, self.request.limits).sum(axis=0)
        value, wider = (
            objective(inverse(self._held(sight) + seen), self.objective)
            for sight in (self.sight, replace(self.sight, wide=2.0 * self.sight.wide))
        )
        if wider > value * (1 + _FOLLOWS):
            raise NotIdentifiableError(
                f"within these limits {len(postures)} postures do not determine the contact "
                "wrench at the assembly posture",
                where="objective wrench",
                hint="drive more postures, tare the sensors, or weigh the terminal",
            )


def make_plan(
    rig: Rig,
    request: Request,
    postures: int,
    rng: np.random.Generator,
    *,
    given: Fit | None = None,
) -> Plan:
    """Choose postures and squeezes by exchange over a random pool.

    postures : how many rows to drive, returns included. given : the fit of postures recorded
    already; the plan adds the best next ones.

    Raises
    ------
    UsageError : infeasible limits. NotIdentifiableError : the objective stays unobservable.
    """
    return Planner(rig, request, rng, given).plan(postures)


def plan_for_target(
    rig: Rig,
    request: Request,
    target: float,
    rng: np.random.Generator,
    *,
    given: Fit | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> Plan:
    """Plan with the fewest postures whose every angle is expected within `target`, rad.

    progress : told how many postures are tried.

    Raises
    ------
    UsageError : infeasible limits. NotIdentifiableError : no number of postures gets there.
    """
    if not 0.0 < target < np.inf:
        raise UsageError(f"the target is {target:g} rad", hint="give a number above zero")
    planner = Planner(rig, request, rng, given)
    floor = planner.scaled(MOST)
    if floor > target:
        raise NotIdentifiableError(
            f"{MOST} postures leave about ±{1e3 * floor:.3g} mrad on the weakest angle, and "
            f"{1e3 * target:.3g} mrad is asked for",
            hint="squeeze harder, average longer, or know zeros, mass and barycentre better",
        )
    count = _fewest(planner, target, progress)
    progress(f"choosing {count} postures")
    return planner.plan(count)


def plan_for_contact(
    rig: Rig,
    request: Request,
    postures: int,
    rng: np.random.Generator,
    *,
    given: Fit | None = None,
) -> Plan:
    """Plan with as many postures as bring the contact wrench within the rig file's limits.

    No fewer than `postures`; so many where no number of them gets there.

    Raises UsageError, NotIdentifiableError as `make_plan`.
    """
    planner, count = Planner(rig, request, rng, given), postures
    while not contact_conforms(rig, planner.expected(count)):
        count = ceil(_MORE * count)
        if count > MOST:
            count = postures
            break
    return planner.plan(count)


def _fewest(planner: Planner, target: float, progress: Callable[[str], None]) -> int:
    """Fewest postures within the target: variances fall as the inverse of their number."""
    count = next(count for count in range(1, MOST + 1) if planner.scaled(count) <= target)
    low, high = 0, np.inf
    while high - low > 1:
        progress(f"trying {count} postures")
        reached = planner.expected(count).largest
        low, high = (low, count) if reached <= target else (count, high)
        count = int(np.clip(np.ceil(count * (reached / target) ** 2), low + 1, high - 1))
    return int(high)


def _check(rig: Rig, request: Request) -> None:
    check_limits(rig, request.limits)
    if not 0.0 <= request.noise < np.inf:
        raise UsageError(f"the noise is {request.noise:g} N", hint="give newtons, 0 or more")
    if request.noise == 0.0 and rig.declared.force_noise == 0.0:
        raise UsageError(
            "neither the request nor the rig states a force noise",
            hint="state what a posture's mean force will scatter by",
        )
    if request.candidates < 1:
        raise UsageError(f"{request.candidates} candidates", hint="ask for one or more")
    if request.objective == "wrench":
        rotation = so3.from_rpy(np.array(rig.acceptance.contact_rpy))
        check_reach(rig, request.limits, rotation, "the assembly posture")
