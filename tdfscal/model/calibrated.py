"""A calibration as those see it who use it, and as the next campaign's prior.

Every parameter of the rig with one covariance; what earlier campaigns know of its constants.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.model.parameters import (
    EVEN_TURN,
    LOAD,
    State,
    constants,
    furthest,
    layout,
    nominal,
    parameter_count,
    prior_std,
    retract,
    vector,
)
from tdfscal.numerics.information import Information
from tdfscal.records import BoolArray, ExactMoves, FloatArray, JointPrior, Rig, UncertainValue


@record
class Calibrated:
    """The estimate in use, with P = 18 n + 9 parameters ordered as in `parameters.layout`:
    zeros as they were at the first posture, however they moved afterwards.

    covariance : (P, P), of the step of `parameters.retract` from the estimate to the truth; SI
    units, rotations as left perturbations in the BCS, rad; zero rows where exactly known or open.
    open : (P,), nothing is known of these parameters one by one.
    joint : the covariance is that of all parameters together; else only the rotations' own block
    is joint and the rest is taken as independent, which overstates the contact wrench's
    uncertainty after a self-calibration.
    """

    rig: Rig
    state: State
    covariance: FloatArray
    open: BoolArray
    joint: bool

    @property
    def root(self) -> FloatArray:
        """U (P, r) with U Uᵀ the covariance, in as many columns as it has rank."""
        scale = np.sqrt(np.diagonal(self.covariance))
        used = np.flatnonzero(scale)
        unit = self.covariance[np.ix_(used, used)] / np.outer(scale[used], scale[used])
        values, vectors = np.linalg.eigh(unit)
        keep = values > len(used) * np.finfo(float).eps * values.max(initial=0.0)
        root = np.zeros((len(scale), int(keep.sum())))
        root[used] = scale[used, None] * vectors[:, keep] * np.sqrt(values[keep])
        return root


def about_point(given: Calibrated, point: FloatArray) -> Calibrated:
    """The same with the LCS moved parallel to itself to a point (3,), m, of the present one.

    Moments and the inertia are then about that point.
    """
    state, rig = given.state, given.rig
    inertia = rig.inertia
    if inertia is not None:
        r, m = state.barycentre, float(state.mass)
        about_old, about_new = (v @ v * np.eye(3) - np.outer(v, v) for v in (r, r - point))
        inertia = replace(inertia, value=inertia.value + m * (about_new - about_old))
    moved = replace(
        rig,
        hinge=rig.hinge - point,
        barycentre=replace(rig.barycentre, value=rig.barycentre.value - point),
        inertia=inertia,
    )
    at = replace(state, hinge=state.hinge - point, barycentre=state.barycentre - point)
    return replace(given, rig=moved, state=at)


def redrawn(given: Calibrated, **own: tuple[FloatArray, FloatArray]) -> Calibrated:
    """The same with quantities that are others now, independent of all that was calibrated.

    own : `zero`, `mass` or `barycentre` with its value as in the state, and its covariance (q, q),
    ∞ on the diagonal where nothing is known.
    """
    place, covariance, unknown = layout(given.rig.n), given.covariance.copy(), given.open.copy()
    for name, (_, cov) in own.items():
        where = place[name]
        unknown[where] = np.isinf(np.diagonal(cov))
        covariance[where], covariance[:, where] = 0.0, 0.0
        covariance[where, where] = np.where(np.isinf(cov), 0.0, cov)
    values = {name: value for name, (value, _) in own.items()}
    return replace(given, state=replace(given.state, **values), covariance=covariance, open=unknown)


def with_rotations(covariance: FloatArray, turns: int, rotations: FloatArray) -> FloatArray:
    """Covariance (P, P) whose first block is replaced, the others' given the first kept.

    With x = A r + ν, A = C_xr C_rr⁻¹ and ν independent of r, only r changes.
    """
    own, cross = covariance[:turns, :turns], covariance[turns:, :turns]
    slope = np.linalg.solve(own, cross.T).T
    given = covariance[turns:, turns:] - slope @ cross.T
    mixed = slope @ rotations
    out = np.block([[rotations, mixed.T], [mixed, given + mixed @ slope.T]])
    return np.asarray((out + out.T) / 2)


def independent(
    rig: Rig,
    rotation: FloatArray,
    rotation_covariance: FloatArray,
    *,
    zero: UncertainValue | None = None,
    mass: UncertainValue | None = None,
    barycentre: UncertainValue | None = None,
    sensitivity: FloatArray | None = None,
) -> Calibrated:
    """Rotations with their covariance, everything else independent of them.

    True after a laser-tracker calibration. zero, mass, barycentre : as in `Rig`, default the
    rig's. sensitivity : (n, 6), S as xx, yy, zz, yz, xz, xy, default 0.
    """
    start, place = nominal(rig), layout(rig.n)
    zero, mass, barycentre = zero or rig.zero, mass or rig.mass, barycentre or rig.barycentre
    std = prior_std(rig)
    std[place["rotation"]] = 0.0
    std[place["zero"]] = zero.std.ravel()
    std[place["mass"]] = mass.std
    std[place["barycentre"]] = barycentre.std
    unknown = np.isinf(std)
    covariance = np.diag(np.where(unknown, 0.0, std) ** 2)
    covariance[place["rotation"], place["rotation"]] = rotation_covariance
    return Calibrated(
        rig=rig,
        state=replace(
            start,
            rotation=rotation,
            zero=zero.value,
            sensitivity=start.sensitivity if sensitivity is None else sensitivity,
            mass=mass.value,
            barycentre=barycentre.value,
        ),
        covariance=covariance,
        open=unknown,
        joint=False,
    )


#: A sensor that was mounted anew turns by about this much, rad per axis. Postures are not called
#: outliers for a turn that all of them share.
REMOUNTED = 5e-3
#: A spin known no better than this, rad, is open: nothing linear holds along it.
_OPEN = 0.3
#: And is held within this, rad, while the others are sought.
_PIN = 1e-3


def free_constants(rig: Rig) -> BoolArray:
    """Which parameters (P,) are constants of the rig and not exactly known.

    Where earlier campaigns speak, those of which they do: a load stated otherwise is none of them.
    """
    if rig.earlier is not None:
        return rig.earlier.places
    shared = constants(rig.n)
    shared[layout(rig.n)["zero"]] = rig.zeros_common
    return np.asarray(shared & (prior_std(rig) > 0))


def among_constants(rig: Rig, *groups: str) -> BoolArray:
    """Which of the free constants (C,) are of these groups of parameters."""
    place, those = layout(rig.n), np.zeros(parameter_count(rig.n), dtype=np.bool_)
    for group in groups:
        those[place[group]] = True
    return np.asarray(those[free_constants(rig)])


def of_load(rig: Rig) -> BoolArray:
    """Which of the free constants (C,) are of the terminal."""
    return among_constants(rig, *LOAD)


def constants_known(rig: Rig, covariance: FloatArray) -> Information:
    """Information (C,) on the free constants by all parameters' covariance; open ones are wide."""
    free = free_constants(rig)
    own = covariance[: len(free), : len(free)][np.ix_(free, free)]
    wide = np.where(np.diagonal(own) > 0, 0.0, furthest(rig.n)[free])
    own = own + np.diag(wide**2)
    # The inverse, scaled.
    return Information(Information(own, np.zeros(len(own))).covariance, np.zeros(len(own)))


def informed(rig: Rig, given: Calibrated) -> Rig:
    """Return a campaign's rig with what a calibration knows of the rig's constants."""
    known = constants_known(given.rig, given.covariance)
    return replace(rig, earlier=joint_prior(given.rig, given.state, known))


def same_load(a: Rig, b: Rig) -> bool:
    """Whether two rig files state the same terminal: one weighing, one realisation."""
    return all(
        np.array_equal(getattr(first, of), getattr(second, of))
        for first, second in ((a.mass, b.mass), (a.barycentre, b.barycentre))
        for of in ("value", "std")
    )


def same_tare(a: Rig, b: Rig) -> bool:
    """Whether two rig files state the same zeros, so that one tare may be meant."""
    alike = (np.array_equal(getattr(a.zero, of), getattr(b.zero, of)) for of in ("value", "std"))
    return all(alike) and np.array_equal(a.axes, b.axes) and bool(np.isfinite(tare_std(a)).all())


def tare_std(rig: Rig) -> FloatArray:
    """Standard uncertainty (z,), N, of the zeros that are free."""
    std = prior_std(rig)[layout(rig.n)["zero"]]
    return std[std > 0]


def joint_prior(
    rig: Rig,
    reference: State,
    known: Information,
    chi2: float = 0.0,
    dof: int = 0,
    *,
    exact: Sequence[ExactMoves] = (),
) -> JointPrior:
    """Gaussian of the free constants (C,) about a reference as the prior of a campaign's fit.

    exact : (C,) rows, how the mean moves with what is taken as exact.

    Estimates of a sensor that measures one axis have no common spin axis, and seem to say something
    of the spin: that is taken from them.
    """
    free = free_constants(rig)
    step, shown = np.zeros(len(free)), np.eye(int(free.sum()))
    for spin in _open_spins(rig, known, reference.rotation):
        shown -= np.outer(spin, spin)
    step[free] = shown @ known.mean
    placed = np.zeros((len(free), len(shown)))
    placed[free] = shown
    moves = tuple(one.by(placed) for one in exact)
    estimate = retract(reference, step)
    matrix = known.matrix
    for spin in _open_spins(rig, known, estimate.rotation):
        seen = matrix @ spin
        matrix = matrix - np.outer(seen, seen) / (spin @ seen)
        matrix += np.outer(spin, spin) / EVEN_TURN**2
    root = np.zeros((int(free.sum()), len(free)))
    root[:, free] = np.linalg.cholesky(matrix).T
    return JointPrior(estimate.rotation, vector(estimate), root, chi2, dof, moves)


def information_of(prior: JointPrior) -> Information:
    """Information (C,) of a prior about its own estimate."""
    root = prior.root[:, prior.places]
    return Information(root.T @ root, np.zeros(root.shape[1]))


def _open_spins(rig: Rig, known: Information, rotation: FloatArray) -> FloatArray:
    """Directions (s, C) of the spins of sensors about the only axis that they measure, BCS.

    Those that nothing knows; rotation : (n, 3, 3), the estimate.
    """
    covariance, found = known.covariance, []
    for i in np.flatnonzero(rig.axes.sum(axis=1) == 1):
        direction = np.zeros(len(covariance))
        direction[3 * i : 3 * i + 3] = rotation[i][:, np.argmax(rig.axes[i])]
        if direction @ covariance @ direction > _OPEN**2:
            found.append(direction)
    return np.array(found).reshape(-1, len(covariance))


def pinned(rig: Rig) -> Rig:
    """Return the rig with an earlier knowledge that holds the spins which no posture shows.

    While the balance is linearised about a state, they seem to be shown and wander.
    """
    if rig.earlier is None or not np.any(rig.axes.sum(axis=1) == 1):
        return rig
    known = information_of(rig.earlier)
    spins = _open_spins(rig, known, rig.earlier.rotation)
    return _with_matrix(rig, known.matrix + spins.T @ spins / _PIN**2)


def _with_matrix(rig: Rig, matrix: FloatArray) -> Rig:
    """Return the rig with another information (C, C) about the same earlier estimate."""
    assert rig.earlier is not None
    root = np.zeros_like(rig.earlier.root)
    root[:, rig.earlier.places] = np.linalg.cholesky(matrix).T
    return replace(rig, earlier=replace(rig.earlier, root=root))


def turned(rig: Rig, std: float, size: int) -> FloatArray:
    """Variance (C,) of C = size constants after every sensor turned by std, rad per axis."""
    variance = np.zeros(size)
    variance[: 3 * rig.n] = std**2
    return variance


def loosened(rig: Rig) -> Rig:
    """Return the rig with an earlier knowledge that allows for sensors mounted anew."""
    if rig.earlier is None:
        return rig
    known = information_of(rig.earlier)
    wide = known.walked(turned(rig, REMOUNTED, len(known.score)))
    return _with_matrix(rig, wide.matrix)


def with_own_load(given: Calibrated, rig: Rig) -> Calibrated:
    """Return the calibration with the load of a log's rig file, where that states another one.

    Stated alike it is one weighing: the calibration's, with what it has in common with the angles.
    """
    own = {}
    for name in ("mass", "barycentre"):
        ours, theirs = getattr(rig, name), getattr(given.rig, name)
        if not (np.array_equal(ours.value, theirs.value) and np.array_equal(ours.std, theirs.std)):
            own[name] = (ours.value, np.diag(np.ravel(ours.std) ** 2))
    return redrawn(given, **own) if own else given
