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

import numpy as np

from tdfscal.checks.geometry import Cause, Geometry
from tdfscal.estimation.fit import Fitted
from tdfscal.estimation.score_tests import Suspicion, worst_angle
from tdfscal.estimation.uncertainty import Estimate, F
from tdfscal.findings import Finding
from tdfscal.frozen import replace
from tdfscal.model.dynamics import DELAY
from tdfscal.model.parameters import layout, parameter_count, prior_std
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import ExactMoves, FloatArray, JointPrior
from tdfscal.significance import CERTAINLY_UNDECLARED, HARMFUL_SHIFT

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
UNMOVED = "no turn between campaigns"
"""What a pool takes as exact where no walk of the angles is declared; its size is a bound."""
#: What is another in each campaign; all else is the rig's, or its terminal's.
_OF_THE_CAMPAIGN = "zeros"
#: What of these is the terminal's, and the code of its finding.
OF_THE_TERMINAL = {"mass": "mass-exact", "barycentre": "barycentre-exact"}
#: Share of its entry in S by which crosstalk is smaller than gain (theory, section 3).
_CROSSTALK = np.sqrt(0.5)


def exact_rows(of: Fitted) -> tuple[ExactMoves, ...]:
    """Each quantity that a campaign takes as exact: whitened rows (m, c) that its errors miss.

    Of all components of a group, 0 where one is not exact.
    """
    columns, stated, n = of.all_slopes(), prior_std(of.rig), of.rig.n
    place, own_priors = layout(n, of.still.motions), of.prior_jacobian[: of.stated.count]
    P, rows, found = place["drift"].stop, len(columns) + len(of.prior_jacobian), []
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
        missed = np.zeros((rows, len(index)))
        missed[: len(columns)] = columns[:, index] * np.where(exact, size, 0.0)
        for j in np.flatnonzero(trusted):
            # What is estimated moves with what is stated, and that is off by −a.
            row = np.argmax(np.abs(own_priors[:, np.sum(of.active[: index[j]])]))
            missed[len(columns) + row, j] = -size[j] / stated[index[j]]
        none = missed[:, :0]
        sides = (none, missed) if name == _OF_THE_CAMPAIGN else (missed, none)
        found.append(ExactMoves(name, error, unit, *sides))
    if len(of.active) > P and not of.active[P + DELAY]:
        missed = np.zeros((rows, 1))
        missed[: len(columns)] = _DELAY * columns[:, [P + DELAY]]
        found.append(ExactMoves("delay", _DELAY, "s", missed, missed[:, :0]))
    return tuple(found)


def exact_quantities(of: Fitted, parts: Spectrum) -> tuple[ExactMoves, ...]:
    """Moves (P, …) of the parameters with each quantity that has no uncertainty of its own.

    parts : of the fit's Jacobian.
    """
    free, size = np.flatnonzero(of.active), parameter_count(of.rig.n)
    gain = np.zeros((len(of.active), len(parts.values)))
    gain[free] = parts.root[: len(free)]
    return tuple(one.by(parts.left.T).by(gain[:size]) for one in _all_rows(of).values())


def _all_rows(of: Fitted) -> dict[str, ExactMoves]:
    """Rows that errors miss, those of earlier campaigns as well.

    What these say moves with an error that they have in common with this one, and with those that
    each had anew.
    """
    found = {one.name: one for one in exact_rows(of)}
    if (earlier := of.rig.earlier) is not None:
        m = len(of.white)
        end = m - len(of.prior_jacobian) + of.stated.count
        rows = np.pad(earlier.root, ((end - len(earlier.root), m - end), (0, 0)))
        for one in earlier.exact:
            own = found.get(one.name)
            found[one.name] = one.by(rows) if own is None else _together(own, one.by(rows))
    return found


def _together(one: ExactMoves, other: ExactMoves) -> ExactMoves:
    """What both do: one and the same error in common, each its own apart."""
    common = one.common
    if common.shape == other.common.shape:
        common = common + other.common
    else:
        other = other.all_apart()
    return replace(one, common=common, apart=np.concatenate([one.apart, other.apart], axis=1))


def with_unmoved(prior: JointPrior, smallest: FloatArray) -> JointPrior:
    """Return what earlier campaigns know, its sensors unmoved since only as far as that was seen.

    smallest : (n, 3), rad, turns of roll, pitch, yaw of which a check is sure; as it is where one
    has no such turn.
    """
    if not np.isfinite(smallest).all():
        return prior
    turns = np.linalg.inv(so3.rpy_jacobian(prior.rotation)) * smallest[:, None]
    n = len(turns)
    moved = np.zeros((len(prior.vector), n, 3))
    moved[: 3 * n].reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n)] = turns
    apart = moved.reshape(len(moved), -1)
    own = ExactMoves(UNMOVED, float(smallest.max()), "rad", apart[:, :0], apart)
    found = {one.name: one for one in prior.exact}
    before = found.get(UNMOVED)
    found[UNMOVED] = own if before is None else _together(own, before)
    return replace(prior, exact=tuple(found.values()))


def exact_caveats(known: Estimate[F]) -> list[Finding]:
    """Find a mass or barycentre called exact whose errors go into the zeros unseen.

    Along three directions zeros and these are exchangeable (theory, section 4), and the zeros are
    as good as what is called exact: an error of typical size, or as small as the tests are certain
    to show, moves a zero by far more than it would have to move a residual.
    """
    fit, place = known.fit, layout(known.fit.rig.n, known.fit.still.motions)
    if all(fit.active[place[group]].all() for group in OF_THE_TERMINAL):
        return []
    certain = np.sqrt(chi2_quantile(1.0 - CERTAINLY_UNDECLARED, 1))
    std, found = known.uncertainty.parameter_std[place["zero"]], []
    rows = _all_rows(fit)
    for quantity in exact_quantities(fit, known.parts):
        if quantity.name not in OF_THE_TERMINAL:
            continue
        estimated, zeros = (std > 0) & np.isfinite(std), quantity.columns[place["zero"]]
        size = np.abs(zeros) / np.where(estimated, std, np.inf)[:, None]
        missed = rows[quantity.name].columns  # and what of it is left in the residuals, χ²
        left = np.sum(missed**2, axis=0) - np.sum((known.parts.left.T @ missed) ** 2, axis=0)
        shown = np.sqrt(np.maximum(left, certain**2)) / certain
        i, j = np.unravel_index(int((size / shown).argmax()), size.shape)
        if size[i, j] / shown[j] > HARMFUL_SHIFT * certain:
            found.append(
                Finding(
                    OF_THE_TERMINAL[quantity.name],
                    size=quantity.error,
                    unit=quantity.unit,
                    values={
                        "zero": f"{'xyz'[i % 3]} of {fit.rig.supports[i // 3]}",
                        "moved": abs(float(zeros[i, j])),
                        "shift": float(size[i, j]),
                    },
                )
            )
    return found


def misplaced(
    of: Estimate[F],
    found: Geometry,
    framed: Callable[[FloatArray], FloatArray] | None = None,
) -> tuple[Suspicion, ...]:
    """One suspicion of all causes that explain the distances, by the worst that one of them does.

    found : what the distances say. framed : whitened rows (m,) of positioners' frames that are
    wrong by E (n, 3, 3) about the middle of their travel, where distances are asked for that.
    """
    if not found.causes:
        return ()
    fit, parts = of.fit, of.parts
    slopes, p = fit.all_slopes(), int(fit.active.sum())
    places = layout(fit.rig.n, fit.still.motions)

    def move(cause: Cause) -> FloatArray:
        """How far the free parameters give way to it."""
        errors = cause.errors
        white = np.zeros(len(slopes)) if framed is None else framed(errors["frame"])
        for group in ("hinge", "datum", "compliance"):
            white = white + slopes[:, places[group]] @ errors[group]
        return np.asarray(parts.root[:p] @ (parts.left[: len(white)].T @ white))

    moves = [move(cause) for cause in found.causes]
    shifts = [worst_angle(fit.rig, of.uncertainty, each) for each in moves]
    worst = int(np.argmax([shift for shift, _, _ in shifts]))
    best = found.causes[0]
    return (
        Suspicion(
            found.findings(fit.rig),
            found.p_value,
            *shifts[worst],
            kind=best.kind,
            support=best.support,
            weight=best.statistic,
            move=moves[worst],
        ),
    )
