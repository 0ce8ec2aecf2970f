"""What the data determine, said before any number, and what noise in the design only fakes.

Least squares take a design as exact, and columns of it are made of readings. Noise in them seems to
tell turns of which it knows nothing, and gains come out smaller than they are, by its share of the
readings' variance however many postures there are. What it makes of the score on the mean is taken
away (corrected score); turns are free of it where the noise is alike in all directions (theory,
sections 3 and 4).

References
----------
Nakamura: Corrected score function for errors-in-variables models. Biometrika 77 (1990) 127–137.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from tdfscal.acceptance import prior_turn_std, turn_names, turn_std
from tdfscal.errors import NotConvergedError, NotIdentifiableError
from tdfscal.estimation.uncertainty import Estimate, F
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State, sensing
from tdfscal.model.postures import zeros
from tdfscal.model.statics import Balance, Postures, forces
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.numerics.least_squares import spectrum, triangular
from tdfscal.records import BoolArray, FloatArray, Rig

#: Postures that determine the angles at all.
ENOUGH = 5
#: An angle known better than half its prior owes more to the data than to the prior.
PRIOR_SHARE = 0.5
#: Turning a sensor about its load is what no datum shows: within this angle it is the cause.
_ALONG_LOAD = np.radians(20.0)
#: Less than this across its load, N, and a sensor carries none.
_CARRIED = 0.05
#: Turns that are named one by one, at most.
_LISTED = 3


@record
class Angle:
    """One turn of one sensor about an axis of the BCS, by the angle's name where it is that angle.

    std in rad; prior_std likewise, ∞ where there is no prior.
    """

    support: str
    angle: str
    std: float
    prior_std: float
    identified: bool

    @property
    def name(self) -> str:
        """As users call it."""
        return f"{self.angle} of {self.support}"


@record
class Weakness:
    """An angle that the data do not determine, and why."""

    angle: Angle
    finding: Finding


@record
class Observability:
    """The verdict: every angle, and the weak ones with cause and advice.

    undetermined : sensors that lack an axis and have an angle that the data do not determine;
    they go without a number. weak : their weaknesses last. spread : (n,), rad, angle about the mean
    load within which the loads on each sensor stay.
    """

    angles: tuple[Angle, ...]
    weak: tuple[Weakness, ...]
    spread: FloatArray
    undetermined: tuple[str, ...] = ()

    @property
    def determined(self) -> BoolArray:
        """Which sensors (n,) have angles that the data determine."""
        names = dict.fromkeys(angle.support for angle in self.angles)
        return np.array([name not in self.undetermined for name in names])

    @property
    def identified(self) -> bool:
        """All angles are determined by the data, but those of sensors that lack an axis."""
        return not self._open

    @property
    def weakest(self) -> Angle:
        """The angle with the largest standard uncertainty."""
        stand = [angle for angle in self.angles if angle.support not in self.undetermined]
        return max(stand or self.angles, key=lambda angle: angle.std)

    @property
    def unseen(self) -> Finding:
        """Which angles are determined and which not; the first's cause stands for all of these."""
        first = self.weak[0]
        stand = [angle for angle in self.angles if angle.identified]
        named = self._named(stand)
        values: dict[str, Value] = {
            "angles": self._named(self._open),
            "first": first.angle.name,
            "determined": named if len(named) <= _LISTED else ["every other turn"],
            "worst": INTERVAL_FACTOR * max((angle.std for angle in stand), default=0.0),
        }
        values = {**first.finding.values, **values}
        return replace(first.finding, code=_OF_ALL[first.finding.code], values=values)

    def _named(self, angles: list[Angle]) -> list[str]:
        """Names of angles, in short where they are every sensor's."""
        if len(angles) == len(self.angles):
            return ["any angle of any sensor"]
        supports, of = dict.fromkeys(a.support for a in self.angles), dict[str, list[str]]()
        for angle in angles:
            of.setdefault(angle.angle, []).append(angle.support)
        whole = [name for name, own in of.items() if len(own) == len(supports)]
        names = [a.name for a in angles if a.angle not in whole]
        return [f"{' and '.join(whole)} of every sensor", *names] if whole else names

    @property
    def _open(self) -> list[Angle]:
        """The weak angles of sensors that have to be determined."""
        return [w.angle for w in self.weak if w.angle.support not in self.undetermined]

    @property
    def findings(self) -> list[Finding]:
        """Sensors that go without angles although the calibration stands."""
        return [Finding("mounting-open", self.undetermined)] if self.undetermined else []

    @property
    def finding(self) -> Finding:
        """What is identified, and the weakest of it."""
        w = self.weakest
        but = ", ".join(self.undetermined)
        values = {"angle": w.angle, "but": but, **_size(w.std)}
        return Finding("angles-determined", (w.support,), w.std, "rad", values=values)


#: Code of an angle's weakness, and of all of them by the first's.
_OF_ALL = {
    "angle-by-prior": "angles-by-prior",
    "angle-few-postures": "angles-few-postures",
    "angle-along-load": "angles-along-load",
}


def require_angles(
    seen: Observability, settled: bool, iterations: int, evidence: object, *, moving: bool = False
) -> None:
    """Raise NotIdentifiableError or NotConvergedError where no angles can be given."""
    if not seen.determined.any() or not seen.identified:
        raise NotIdentifiableError(seen.unseen, evidence=evidence)
    if not settled:
        unsettled = Finding("estimate-unsettled", size=iterations, values={"moving": moving})
        raise NotConvergedError(unsettled, evidence=evidence)


def _size(std: float) -> dict[str, Value]:
    return {"unknown": std >= 1, "mrad": 1e3 * std}


def verdict(
    rig: Rig, state: State, postures: Postures, covariance: FloatArray, *, moving: bool = False
) -> Observability:
    """Judge every turn about an axis of the BCS by its variance (covariance (3n, 3n), rad²).

    moving : the postures are instants of a motion.

    A turn is identified when its standard uncertainty is below `acceptance.identifiable` and at
    most half of its prior's.
    """
    std, names = turn_std(covariance), turn_names(state.rotation)
    prior = prior_turn_std(rig.rpy_std, state.rotation)
    limit = rig.acceptance.identifiable
    good = (std < limit) & (std <= PRIOR_SHARE * prior)
    angles = tuple(
        Angle(name, names[i][j], float(std[i, j]), float(prior[i, j]), bool(good[i, j]))
        for i, name in enumerate(rig.supports)
        for j in range(3)
    )
    # Axis (n, 3) of the loads in the BCS, which an opposite load has too, their spread (n,), rad,
    # about it, and the load across it, N. NCPs only translate: a sensor sees the same angles.
    F = np.swapaxes(forces(state, postures.force), 0, 1)  # (n, K, 3)
    axis = np.linalg.eigh(np.swapaxes(F, 1, 2) @ F)[1][:, :, 2]
    along = (F @ axis[..., None])[..., 0]
    across = np.linalg.norm(F - along[..., None] * axis[:, None], axis=2)
    across, along = (np.sqrt(np.mean(part**2, axis=1)) for part in (across, along))
    spread = np.arctan2(across, along)
    weak, count = [], 0 if moving else len(postures)
    for k, angle in enumerate(angles):
        if angle.identified:
            continue
        i, j = divmod(k, 3)
        off = float(np.arccos(min(1.0, abs(axis[i, j]))))
        weak.append(_explain(angle, off, spread[i], across[i], limit, count))
    lacks = {name for name, axes in zip(rig.supports, rig.axes, strict=True) if not axes.all()}
    return Observability(
        angles,
        tuple(sorted(weak, key=lambda w: w.angle.support in lacks)),
        spread,
        undetermined=tuple(n for n in rig.supports if n in {w.angle.support for w in weak} & lacks),
    )


def _explain(
    angle: Angle, off: float, spread: float, across: float, limit: float, count: int
) -> Weakness:
    """Say why an angle is weak and what would help.

    off : rad, its axis from the loads'. count : of postures, 0 of a motion.
    """
    values: dict[str, Value] = {"moving": not count, **_size(angle.std)}
    if 0 < count < ENOUGH:
        values |= {"few": count, "least": ENOUGH}
    code = "angle-along-load"
    if angle.std < limit:
        code = "angle-by-prior"
    elif off > _ALONG_LOAD:
        code = "angle-few-postures"
    else:
        need = 2 * across * angle.std / limit
        digits = 10 ** (np.floor(np.log10(max(need, _CARRIED))) - 1)  # two, upwards
        enough = across >= _CARRIED and angle.std < 1
        values |= {
            "within": float(np.degrees(spread)),
            "carried": across >= _CARRIED,
            "across": across,
            "enough": f"{np.ceil(need / digits) * digits:.0f} N" if enough else "",
        }
    return Weakness(angle, Finding(code, (angle.support,), angle.std, "rad", values=values))


Change = Literal["postures", "squeeze", "tare", "seconds"]
#: How many times as long a motion is easily made.
LONGER = 2.0


@record
class Prospect:
    """A change of the campaign, and the angles' uncertainty to expect of it.

    amount : postures more; N, largest internal force at an NCP; N, standard uncertainty of a zero;
    s, of motion. rpy_std : (n, 3), rad, of roll, pitch, yaw.
    """

    change: Change
    amount: float
    rpy_std: FloatArray


def prospect(
    of: Estimate[F],
    change: Change,
    amount: float,
    *,
    count: float = 1.0,
    rows: FloatArray | None = None,
    priors: FloatArray | None = None,
) -> Prospect:
    """Linearise a campaign as it would be at the estimate of the one that is there.

    What is published changes as the linear covariance does. count : how many times as many rows
    there would be. rows, priors : whitened (M, p + …), (m₀, p + …), if they would be others.
    """
    fit, R = of.fit, of.fit.still.rotation

    def linear(rows: FloatArray, priors: FloatArray) -> FloatArray:
        whole = np.concatenate([rows, priors])
        turns = spectrum(triangular(whole), len(whole)).root[: 3 * len(R)]
        return np.sqrt(so3.rpy_variance(R, turns @ turns.T))

    then = linear(
        np.sqrt(count) * (fit.factor if rows is None else rows),
        fit.prior_jacobian if priors is None else priors,
    )
    now = linear(fit.factor, fit.prior_jacobian)
    return Prospect(change, amount, of.uncertainty.rpy_std * then / now)


def noise_pull(at: Balance, state: State, W: FloatArray) -> FloatArray:
    """Score (q,) of the features that noise makes by standing in their own columns.

    Σ_k Σ_ν (∂Φ/∂ν)ᵀ W cov(ν) (∂e/∂ν), ν : readings, and the turn of the registered pose.
    W : (K, 6, 6), how much the balances count.
    """
    n, A = state.n, at.noise_turn[:, 3:]
    both = at.seen.measured[:, :, None] & at.seen.measured[:, None, :]
    F = forces(state, at.seen.force - (zeros(state, at.seen) - state.zero))
    pull = np.zeros(at.design.shape[2])
    # W (∂e/∂ν) cov(ν) of the readings, (K, n, 6, 3), and of the turn, (K, 3, 3), moments alone.
    felt = W[:, None] @ at.noise_force @ np.where(both, at.seen.force_cov, 0.0)
    turned = (W @ at.noise_turn @ at.turn_cov)[:, 3:]
    across = np.swapaxes(turned, 1, 2) - _traces(turned)
    levers = at.arm @ np.swapaxes(across, 1, 2)
    mixed = np.swapaxes(at.wrench, -1, -2) @ felt + levers[..., None] * at.seen.force[:, :, None]
    pull[: 9 * n] = mixed.sum(axis=0).ravel()
    pull[9 * n : 12 * n] = -levers.sum(axis=0).ravel()
    pull[12 * n + 3 : 12 * n + 12] = (across @ at.rotation).sum(axis=0).T.ravel()
    # Hinges, datums and what gives turn the pose, at levers A that are made of both.
    in_bcs = felt[:, :, 3:] @ np.swapaxes(sensing(state), -1, -2)
    L, lever = A - _traces(A) / 2, -A[:, None] @ at.turn
    base = (turned @ so3.axial(L)[..., None])[..., 0] - so3.axial(np.swapaxes(A, 1, 2) @ turned)
    base -= (np.swapaxes(L, 1, 2) @ so3.axial(turned)[..., None])[..., 0]
    base += ((in_bcs - np.swapaxes(in_bcs, -1, -2)) @ at.arm[..., None])[..., 0].sum(axis=1)
    by_turn = np.einsum("knab,ka->knb", at.turn, base)
    hinge = by_turn - so3.axial(in_bcs - so3.hat(F) @ turned[:, None])
    datum = by_turn - so3.axial(np.swapaxes(lever, -1, -2) @ turned[:, None])
    pull[12 * n + 12 : 15 * n + 12] = (hinge @ at.rotation).sum(axis=0).ravel()
    pull[15 * n + 12 : 18 * n + 12] = datum.sum(axis=0).ravel()
    gives = (datum * F + np.sum(lever * in_bcs, axis=2)).sum(axis=(0, 1))
    pull[18 * n + 12 : 18 * n + 14] = gives[:2].sum(), gives[2]
    return pull


def _traces(matrix: FloatArray) -> FloatArray:
    """The trace of each matrix (K, 3, 3) times the unit matrix."""
    return np.asarray(np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(3))
