"""From a rig and its limits to the postures to drive, and the uncertainty to expect of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.errors import NotIdentifiableError, UsageError
from tdfscal.estimation.observability import PRIOR_SHARE, faked_information
from tdfscal.frozen import record, replace
from tdfscal.numerics.information import inverse
from tdfscal.planning.candidates import Candidates, Request, check_noise, draw
from tdfscal.planning.predicted_information import (
    Forecast,
    Sight,
    angle_rows,
    averaged,
    contact_excess,
    forecast,
    hinge_radius,
    leaning,
    wrench_rows,
)
from tdfscal.planning.selection import (
    choose,
    gains,
    information,
    objective,
    short_tour,
    variances,
)
from tdfscal.records import ANGLES, BoolArray, FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import Fit


@record
class Plan:
    """Postures in the order to drive them, K rows.

    approach : (K,), ±1, side to come from: they alternate, so that backlash and friction show as
    scatter and not as angles. given : postures recorded before. before : what these alone promise,
    None without any. expected : of all together.
    """

    rig: Rig
    request: Request
    postures: Candidates
    approach: IntArray
    given: int
    before: Forecast | None
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
#: An objective that follows the width of ignorance by more than this share is not measured.
_FOLLOWS = 1e-2


class Planner:
    """A pool of candidates with all that choosing from it needs."""

    def __init__(
        self, rig: Rig, request: Request, rng: np.random.Generator, given: Fit | None
    ) -> None:
        check_noise(rig, request.noise)
        self.rig, self.request, self.given = rig, request, given
        self.sight = Sight.of(rig, request.noise, given.state if given else None)
        self.held = self._held(self.sight)
        self.pool = draw(rig, request.limits, request.candidates, rng.spawn(1)[0])
        self.rows = self.sight.rows(self.pool)
        self.scatter = self._scatter(self.sight)
        self.leaning = (self.sight,) if given else leaning(self.sight)
        self.sight = replace(self.sight, open=self._open())
        self.objective = self._objective()
        self.most = min(_MOST, len(self.pool))
        self._selected: dict[int, IntArray] = {}

    def _held(self, sight: Sight) -> FloatArray:
        """Information (p, p) that stands before the plan: priors and recorded postures."""
        held = sight.prior()
        if (given := self.given) is not None:
            J = given.at.whitener @ given.jacobian
            held = held + np.einsum("k,kmp,kmq->pq", given.weight, J, J)
            turns = slice(0, 3 * self.rig.n)
            held[turns, turns] -= faked_information(given.at, given.state, given.weight)
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

    def select(self, count: int) -> IntArray:
        """Choose `count` candidates, the one that tells most first."""
        if count > len(self.pool):
            what = f"{count} postures are to be chosen from {len(self.pool)} candidates"
            raise UsageError(what, hint="ask for more candidates")
        if count not in self._selected:
            base = self.held + count * self.scatter
            chosen, covariance = choose(self.rows, base, self.objective, count)
            first = int(np.argmax(gains(self.rows[chosen], covariance, self.objective)))
            self._selected[count] = np.concatenate([chosen[[first]], np.delete(chosen, first)])
        return self._selected[count]

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
        if count < 1:
            raise UsageError(f"{count} postures are asked for", hint="ask for one or more")
        chosen = self.pool.take(self.select(count))
        postures = chosen.take(short_tour(chosen.place))
        expected = self.forecast(postures)
        self._refuse_unobservable(postures, expected)
        return Plan(
            rig=self.rig,
            request=self.request,
            postures=postures,
            approach=1 - 2 * (np.arange(count) % 2),
            given=0 if self.given is None else int(np.sum(self.given.weight > 0)),
            before=None if self.given is None else self.forecast(postures.take(np.arange(0))),
            expected=expected,
        )

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
    postures: int | None,
    rng: np.random.Generator,
    *,
    target: float | None = None,
    given: Fit | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> Plan:
    """Choose postures and squeezes by exchange over a random pool.

    postures : how many to drive; None: as few as bring every angle within `target`, rad, else as
    many as is usual, or more where the rig file's limits of the contact wrench ask for more.
    given : the fit of postures recorded already; the plan adds the best next ones.
    progress : told how many postures are tried.

    Raises
    ------
    UsageError : infeasible limits. NotIdentifiableError : the objective stays unobservable, or no
        number of postures gets to the target.
    """
    planner = Planner(rig, request, rng, given)
    if postures is None and target is not None:
        if not 0.0 < target < np.inf:
            raise UsageError(f"the target is {target:g} rad", hint="give a number above zero")
        postures = planner.fewest(lambda found: found.largest / target, 0, progress)
        if postures > planner.most:
            raise NotIdentifiableError(
                f"{planner.most} postures do not bring the weakest angle within "
                f"{1e3 * target:.3g} mrad, which is asked for",
                hint="squeeze harder, average longer, or know zeros, mass and barycentre better",
            )
    elif postures is None and rig.acceptance.states_contact:
        postures = planner.fewest(lambda found: contact_excess(rig, found), USUAL - 1, progress)
        postures = USUAL if postures > planner.most else postures
    return planner.plan(USUAL if postures is None else postures)
