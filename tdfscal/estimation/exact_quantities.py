"""What is taken as exact: by how much a typical error of it would turn each sensor.

A quantity that the rig file states without uncertainty has no part in the budget, and tests hardly
see its error: 1 mrad of level turns every sensor by 1 mrad and leaves no residual. The angles give
way to an error a (true less stated) along whitened columns c by J⁺ c a, J of all that is estimated.
A tare is named likewise where it is stated to be better than tares are: with the covariance C of
the estimate an error a of what is stated to s moves it by −C a/s². What a wrong geometry, known by
the distances between hinges alone, does to the angles is such a move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tdfscal.checks.geometry import Geometry
from tdfscal.checks.hinge_distances import FRAMES, Cause
from tdfscal.estimation.fit import Fitted, information
from tdfscal.estimation.suspicion import Suspicion, worst_angle
from tdfscal.estimation.uncertainty import Estimate, F, Uncertainty
from tdfscal.findings import Finding
from tdfscal.model.dynamics import DELAY
from tdfscal.model.parameters import layout, prior_std
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import CERTAINLY_UNDECLARED, HARMFUL_SHIFT


@dataclass(frozen=True, slots=True)
class ExactQuantity:
    """A quantity taken as exact, and what an error of it does.

    error : typical, in `unit`, of each of its components. moves : (3n, c), rad, turns of all
    sensors in the BCS by that error of each component by itself. zeros : (3n, c), N, moves of the
    zeros likewise. shows : (c,), χ² that such an error leaves in the residuals.
    """

    name: str
    error: float
    unit: str
    moves: FloatArray
    zeros: FloatArray | None = None
    shows: FloatArray | None = None

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3n, 3n), rad², of the turns by independent errors of the components."""
        return np.asarray(self.moves @ self.moves.T)


#: Group of parameters, what it is called, a typical error of a component, its unit; what careful
#: work with everyday means leaves: a machinist's level, CAD, a workshop drawing, a data sheet.
_TYPICAL = (
    ("tilt", "base level", 1e-3, "rad"),
    ("mass", "mass", 1e-3, "of it"),
    ("barycentre", "barycentre", 1e-3, "m"),
    ("hinge", "hinge drawing", 1e-4, "m"),
    ("datum", "servo datums", 1e-4, "m"),
    ("sensitivity", "gain, crosstalk", 1e-3, "relative"),
    ("zero", "zeros", 1.0, "N"),
)
#: What is as good as exact where it is stated to less than this share of a typical error: under a
#: load that hardly varies no residual shows a tare that was none.
_TRUSTED = {"zero": 0.5}
#: Typical error of a delay of the force stamps, s: a sample or two of a fieldbus.
_DELAY = 1e-3
#: What of these is the terminal's, and the code of its finding.
_OF_THE_TERMINAL = {"mass": "mass-exact", "barycentre": "barycentre-exact"}
#: Share of its entry in S by which crosstalk is smaller than gain (theory, section 3).
_CROSSTALK = np.sqrt(0.5)


def exact_quantities(of: Fitted) -> tuple[ExactQuantity, ...]:
    """Each quantity of a calibration that has no uncertainty of its own."""
    columns, parts, n = of.all_slopes(), information(of), of.rig.n
    free, left = np.flatnonzero(of.active), parts.left[: len(columns)]
    place = layout(n, of.still.motions)
    P = place["drift"].stop

    def moved(known: FloatArray) -> FloatArray:
        """Moves (P′, c) of the parameters with errors (r, c)."""
        out = np.zeros((len(of.active), known.shape[1]))
        out[free] = (parts.root @ known)[: len(free)]
        return out

    stated, found = prior_std(of.rig), []
    for group, name, error, unit in _TYPICAL:
        index = np.arange(place[group].start, place[group].stop)
        mass = float(of.still.mass) if group == "mass" else 1.0
        size = np.full(len(index), error * mass)
        if group == "sensitivity":
            size[np.arange(len(index)) % 6 >= 3] *= _CROSSTALK
        exact = ~of.active[index]
        trusted = ~exact & (stated[index] < _TRUSTED.get(group, 0.0) * size)
        if not (exact | trusted).any():
            continue
        wrong = columns[:, index[exact]] * size[exact]
        known = left.T @ wrong
        shows = np.sum(wrong**2, axis=0) - np.sum(known**2, axis=0)
        # What is estimated moves with what is stated, and that is off by −a.
        own = parts.root[np.searchsorted(free, index[trusted])].T
        pull = size[trusted] / stated[index[trusted]] ** 2
        moves = moved(np.concatenate([known, -own * pull], axis=1))
        left_over = (size[trusted] / stated[index[trusted]]) ** 2
        left_over -= np.sum((own * pull) ** 2, axis=0)
        found.append(
            ExactQuantity(
                name,
                error,
                unit,
                moves[place["rotation"]],
                moves[place["zero"]],
                np.concatenate([shows, left_over]),
            )
        )
    if len(of.active) > P and not of.active[P + DELAY]:
        moves = moved(left.T @ (_DELAY * columns[:, [P + DELAY]]))
        found.append(ExactQuantity("delay", _DELAY, "s", moves[place["rotation"]]))
    return tuple(found)


def exact_caveats(fit: Fitted, uncertainty: Uncertainty) -> list[Finding]:
    """Find a mass or barycentre called exact whose errors go into the zeros unseen.

    Along three directions zeros and these are exchangeable (theory, section 4), and the zeros are
    as good as what is called exact: an error of typical size, or as small as the tests are certain
    to show, moves a zero by far more than it would have to move a residual.
    """
    place = layout(fit.rig.n, fit.still.motions)
    if all(fit.active[place[group]].all() for group in _OF_THE_TERMINAL):
        return []
    certain = np.sqrt(chi2_quantile(1.0 - CERTAINLY_UNDECLARED, 1))
    std, found = uncertainty.parameter_std[layout(fit.rig.n)["zero"]], []
    for quantity in exact_quantities(fit):
        if quantity.name not in _OF_THE_TERMINAL or quantity.zeros is None:
            continue
        known = (std > 0) & np.isfinite(std)
        size = np.abs(quantity.zeros) / np.where(known, std, np.inf)[:, None]
        shown = np.sqrt(np.maximum(np.asarray(quantity.shows), certain**2)) / certain
        i, j = np.unravel_index(int((size / shown).argmax()), size.shape)
        if size[i, j] / shown[j] > HARMFUL_SHIFT * certain:
            found.append(
                Finding(
                    _OF_THE_TERMINAL[quantity.name],
                    size=quantity.error,
                    unit=quantity.unit,
                    values={
                        "zero": f"{'xyz'[i % 3]} of {fit.rig.supports[i // 3]}",
                        "moved": abs(float(quantity.zeros[i, j])),
                        "shift": float(size[i, j]),
                    },
                )
            )
    return found


def misplaced(
    of: Estimate[F],
    found: Geometry,
    framed: Callable[[Cause], FloatArray] | None = None,
) -> tuple[Suspicion, ...]:
    """One suspicion of all causes that explain the distances, by the worst that one of them does.

    found : what the distances say. framed : whitened rows (m,) of a positioner's frame that is
    turned, scaled or not square, where distances are asked for that.
    """
    if not found.causes:
        return ()
    fit, parts = of.fit, of.parts
    slopes, p = fit.all_slopes(), int(fit.active.sum())
    places = layout(fit.rig.n, fit.still.motions)

    def move(cause: Cause) -> FloatArray:
        """How far the free parameters give way to it."""
        if framed is not None and cause.kind in FRAMES:
            white = framed(cause)
        else:
            step = np.zeros(slopes.shape[1])
            if (hinge := displaced_hinges(fit.rig, cause)) is not None:
                step[places["hinge"]] = hinge.ravel()
            elif cause.kind == "compliance":
                step[places["compliance"]] = cause.amount
            else:
                step[places["datum"]].reshape(-1, 3)[cause.support] = cause.amount
            white = slopes @ step
        return np.asarray(parts.root[:p] @ (parts.left[: len(white)].T @ white))

    moves = [move(cause) for cause in found.causes]
    shifts = [worst_angle(fit.rig, of.uncertainty, each) for each in moves]
    worst = int(np.argmax([shift for shift, _, _ in shifts]))
    best = found.causes[0]
    return (
        Suspicion(
            found.findings(fit.rig.supports),
            found.p_value,
            *shifts[worst],
            kind=best.kind,
            support=best.support,
            weight=best.statistic,
            move=moves[worst],
        ),
    )


def displaced_hinges(rig: Rig, cause: Cause) -> FloatArray | None:
    """Hinges' displacements (n, 3), m, LCS, by a cause that is one of the terminal."""
    if cause.kind == "scale":
        return np.asarray(cause.amount * (rig.hinge - rig.hinge.mean(axis=0)))
    if cause.kind != "hinge":
        return None
    out = np.zeros((rig.n, 3))
    out[cause.support] = cause.amount
    return out


def framed_positions(cause: Cause, position: FloatArray) -> FloatArray:
    """What a wrong frame of a positioner adds to the logged positions (K, n, 3), m, BCS."""
    out = np.zeros_like(position)
    away = position[:, cause.support] - position[:, cause.support].mean(axis=0)
    out[:, cause.support] = away @ np.tensordot(cause.amount, FRAMES[cause.kind], 1).T
    return out
