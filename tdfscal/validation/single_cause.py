"""One change that explains residual wrenches: a linear model of them, and how well it fits.

A cause is e = H a + noise of the whitened residual wrenches of all postures; it is judged by how
far χ² falls when its q unknowns a are fitted (generalised least squares), less q ln N for N
residuals (Schwarz, Ann. Stat. 6, 1978); the posture from which a step holds is an unknown too.
Causes of few and many unknowns are so held against each other on one scale, twice the logarithm of
their odds.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from typing import Literal

import numpy as np

from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import FloatArray
from tdfscal.significance import CAUSE_EXPLAINS, CAUSES_APART
from tdfscal.validation.residuals import Whitened

Kind = Literal[
    "sensor turned",
    "load changed",
    "zero drifted",
    "gain changed",
    "base tilted",
    "contact",
    "noise grown",
    "zeros wander",
    "zeros moved",
    "hinges stick",
    "sensor slipped",
    "zero jumped",
    "zeros drift",
    "zeros follow temperature",
]

#: Causes that are a scatter, not a change: the test of all residuals together sees them.
NOISE: tuple[Kind, ...] = ("noise grown", "zeros wander", "zeros moved", "hinges stick")
#: Changes in the course of a log; the test of all residuals together sees them too.
STEPS: tuple[Kind, ...] = ("sensor slipped", "zero jumped")
COURSES: tuple[Kind, ...] = (*STEPS, "zeros drift", "zeros follow temperature")

#: Order of causes, by the odds for them.
WEIGHT = attrgetter("weight")


@dataclass(frozen=True, slots=True)
class Cause:
    """A possible cause, fitted by generalised least squares.

    support : index, for a sensor's cause. postures : indices, for a contact; for a step the first
    one from which on it holds.
    value, std : (q,), its unknowns: a turn in rad (rx, ry, rz, BCS: R_now = exp([a]×) R); a load's
    mass in kg and barycentre in m, as changes; a zero's change in N,
    where it drifts the largest of each; a gain's change as S (6,): xx,
    yy, zz, yz, xz, xy; the base's tilt in rad about x and y of the BCS; the standard deviation of
    more noise, of the zeros' wander or of a move of all zeros, N, or of the hinges' friction, N·m,
    per axis and posture. A contact has none here.
    gain : by how much χ² falls, with q unknowns. weight : the same less what as many unknowns are
    worth (Schwarz). p_value : that chance alone lets it fall so far.
    remaining_p : probability of the χ² that is left.
    """

    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    value: FloatArray
    std: FloatArray
    gain: float
    weight: float
    unknowns: int
    p_value: float
    remaining_p: float

    @property
    def explains(self) -> bool:
        """Nothing remarkable is left."""
        return self.remaining_p >= CAUSE_EXPLAINS

    @property
    def told(self) -> bool:
        """Its size is told from none."""
        return self.p_value < CAUSE_EXPLAINS


@dataclass(frozen=True, slots=True)
class Causes:
    """Single causes, the most likely first.

    best : one per kind and support or posture, the likeliest of its shapes. tried : how many could
    have looked like the likeliest by chance.
    """

    best: tuple[Cause, ...]
    tried: int

    @property
    def suspected(self) -> tuple[Cause, ...]:
        """The causes that explain the residuals and cannot be told apart, the likeliest first.

        One whose size may as well be none is not among them: near the limit it explains the
        residuals as nothing would.
        """
        explaining = [cause for cause in self.best if cause.explains and cause.told]
        if not explaining:
            return ()
        most = explaining[0].weight
        # What explains less well than another that leaves too much is not the cause.
        if self.best[0].weight - most >= CAUSES_APART:
            return ()
        return tuple(c for c in explaining if most - c.weight < CAUSES_APART)


@dataclass(frozen=True, slots=True)
class Model:
    """Columns (6K, q) of the unknowns, of parameters by `shape` (p, q), which gives them back."""

    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    columns: FloatArray
    shape: FloatArray | None = None


def fitted(model: Model, given: Whitened) -> Cause:
    """Fit a cause to the residuals.

    What changed is minus what would cancel it: e is linear about the estimate.
    """
    size = np.linalg.norm(model.columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    U, s, Vt = np.linalg.svd(model.columns / size, full_matrices=False)
    seen = s > 1e-9 * s.max(initial=0.0)
    along = U[:, seen].T @ given.residual
    gain, q = float(along @ along), int(seen.sum())
    root = (Vt[seen].T / s[seen]) / size[:, None]
    rest = max(given.chi2 - gain, 0.0)
    contact = model.kind == "contact"
    if model.shape is not None:
        root = model.shape @ root
    return Cause(
        kind=model.kind,
        support=model.support,
        postures=model.postures,
        value=np.zeros(0) if contact else -(root @ along),
        std=np.zeros(0) if contact else np.linalg.norm(root, axis=1),
        gain=gain,
        weight=gain - (q + (model.kind in STEPS)) * given.worth,
        unknowns=q,
        p_value=float(chi2_sf(gain, q)),
        remaining_p=float(chi2_sf(rest, given.dof - q)),
    )
