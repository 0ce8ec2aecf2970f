"""Residual wrenches at a calibration, all that correlates them taken away; causes fitted to them.

A cause is a linear model e = H a + noise of the whitened residual wrenches of all postures; it is
judged by how far χ² falls when its q unknowns a are fitted (generalised least squares), less q ln N
for N residuals (Schwarz, Ann. Stat. 6, 1978); the posture from which a step holds is an unknown
too. Causes of few and many unknowns are so held against each other on one scale, twice the
logarithm of their odds.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter
from typing import Literal

import numpy as np

from tdfscal.frozen import field, record, replace
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import layout, parameter_count, prior_std
from tdfscal.model.postures import ZeroMotion
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig
from tdfscal.significance import CAUSE_EXPLAINS, CAUSES_APART


@record
class Course:
    """When K postures were held, s; and the temperature (K, n), °C, at each sensor, if logged."""

    time: FloatArray
    temperature: FloatArray | None = None

    def subset(self, keep: IntArray) -> Course:
        """Return that of the postures that keep selects."""
        warm = None if self.temperature is None else self.temperature[keep]
        return Course(self.time[keep], warm)

    def step(self, first: int, last: int | None = None) -> FloatArray:
        """1 at postures (K, 1) held with one of them or after it, up to a last one, else 0."""
        until = np.inf if last is None else self.time[last]
        during = (self.time >= self.time[first]) & (self.time <= until)
        return np.asarray(during, dtype=np.float64)[:, None]

    def drifts(self, sensors: int) -> Iterator[tuple[bool, FloatArray]]:
        """Shapes (K, n, g) of drifts, and whether they are of temperature.

        They begin with the log, or began before it.
        """
        everyone = (len(self.time), sensors, 1)
        before = np.ones(everyone)
        elapsed = self.time - self.time.min(initial=np.inf)
        if not elapsed.any():
            return
        line = np.broadcast_to((elapsed / elapsed.max())[:, None, None], everyone)
        for shapes in ([line], [line, line**2], [line, line**2, before]):
            yield False, np.concatenate(shapes, axis=2)
        if self.temperature is not None:
            warming = (self.temperature - self.temperature[np.argmin(self.time)])[:, :, None]
            if warming.any():
                warming = warming / np.abs(warming).max()
                yield True, warming
                yield True, np.concatenate([warming, before], axis=2)


@record
class Linearised:
    """Residual wrenches at a calibration to the first order, white in each posture's own noise.

    residual : (m,); m is 6K, or as many as a motion determines. columns : (m, P + E), derivative
    by the calibrated parameters and by E of this log alone: zeros that move, a motion's own.
    own : (K, 6, 6), whitens each posture's own noise, with 0 along forces that nobody measures;
    K = 0 in motion, where a contact is found otherwise. own_root : (E, r), of the covariance of
    this log's parameters. own_unknown : (E,), those of which nothing is known. rows : directions of
    all residuals that no unmeasured force reaches. sensors : n. course : of the K postures.
    """

    residual: FloatArray
    columns: FloatArray
    own: FloatArray
    own_root: FloatArray
    own_unknown: BoolArray
    rows: int
    sensors: int
    course: Course

    @property
    def zero_columns(self) -> FloatArray:
        """Derivative (m, 3n) by the zeros."""
        return self.columns[:, layout(self.sensors)["zero"]]


@record
class Whitened:
    """Residual wrenches of K postures with all that correlates them taken away.

    at : the same, white in each posture's own noise only. residual : (m,), white altogether; m is
    6K, or as many as a motion determines. columns : (m, P), its derivative by the calibrated
    parameters. common : (m, r), H of the inverse root I − H Hᵀ for the calibration's error, which
    is common to all postures. free : (m, f), orthonormal, directions of parameters that nobody
    knows; the residual has no part in them. spread : ln det of the residuals' covariance, by what
    it is without the calibration's error.
    """

    at: Linearised
    residual: FloatArray
    columns: FloatArray
    common: FloatArray
    free: FloatArray
    spread: float

    @property
    def chi2(self) -> float:
        """χ² of all residual wrenches together."""
        return float(self.residual @ self.residual)

    @property
    def dof(self) -> int:
        """Its degrees of freedom."""
        return int(self.at.rows - self.free.shape[1])

    @property
    def worth(self) -> float:
        """What one unknown has to lower χ² by (Schwarz)."""
        return float(np.log(max(self.at.rows, 2)))

    @property
    def deviance(self) -> float:
        """−2 ln of the residuals' likelihood, but for a constant of the log."""
        return float(self.chi2 + self.spread + self.worth * self.free.shape[1])

    @property
    def unfolded(self) -> tuple[FloatArray, FloatArray]:
        """Return y (m,) and M (m, r + f): y = Aᵀ residual, AᵀA = I − M Mᵀ, A the whitening.

        By them score and information of columns come from the rows where these are not 0.
        """
        H, F = self.common, self.free
        M = np.hstack([H * np.sqrt(2.0 - np.sum(H**2, axis=0)), F - H @ (H.T @ F)])
        return self.residual - H @ (H.T @ self.residual), M

    def white(self, columns: FloatArray) -> FloatArray:
        """Columns (6K, c), whitened posture by posture already, made white altogether."""
        white = columns - self.common @ (self.common.T @ columns)
        return np.asarray(white - self.free @ (self.free.T @ white))


def whiten(at: Linearised, given: Calibrated) -> Whitened:
    """Take away the error of a calibration, which is common to all postures, from residuals.

    given : P parameters with their covariance U Uᵀ; of those that are open nothing is known. The
    residuals are at its state.

    With B the columns times U the covariance is I + B Bᵀ; by the singular values s of B its
    inverse root is I − V (1 − 1/√(1 + s²)) Vᵀ.
    """
    root = block_diagonal(given.root, at.own_root)
    unknown = np.concatenate([given.open, at.own_unknown])
    V, s, _ = np.linalg.svd(at.columns @ root, full_matrices=False)
    common, spread = V * np.sqrt(1 - 1 / np.sqrt(1 + s**2)), float(np.sum(np.log1p(s**2)))
    none = np.zeros((len(at.columns), 0))
    start = Whitened(at, at.residual, at.columns, common, none, spread)
    known = replace(start, free=basis(start.white(at.columns[:, unknown])))
    white = known.white(at.residual[:, None])[:, 0]
    return replace(known, residual=white, columns=known.white(at.columns))


def moving_zeros(rig: Rig, motion: ZeroMotion | None) -> tuple[FloatArray, BoolArray]:
    """Root (3nG, 3nG) of the amplitudes' covariance by which zeros move in this log; the unknown.

    A log's amplitudes are its own: they have their prior.
    """
    std = prior_std(rig, motion)[parameter_count(rig.n) :]
    return np.diag(np.where(np.isfinite(std), std, 0.0)), np.isinf(std)


def basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what columns (m, c) span."""
    size = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(U[:, s > 1e-9 * s.max(initial=0.0)])


Kind = Literal[
    "sensor turned",
    "sensors turned",
    "load changed",
    "zero drifted",
    "gain changed",
    "gains changed",
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

#: Of a contact, which is told by the residual wrench.
NO_SIZE = np.zeros(0)

#: Order of causes, by the odds for them.
WEIGHT = attrgetter("weight")


@record
class Cause:
    """A possible cause, fitted by generalised least squares.

    support : index, for a sensor's cause. postures : indices, for a contact; for a step the first
    one from which on it holds, at rest, and the last where it ends again. between : s, of a step in
    motion, times between which it lies with 95 %.
    value, std : (q,), its unknowns: a turn in rad (rx, ry, rz, BCS: R_now = exp([a]×) R), of all
    sensors in turn where several did; a load's mass in kg and barycentre in m, as changes; a zero's
    change in N, where it drifts the largest of each; a gain's change as S (6,): xx, yy, zz, yz, xz,
    xy; the base's tilt in rad about x and y of the BCS; the standard deviation of more noise, of
    the zeros' wander or of a move of all zeros, N, or of the hinges' friction, N·m, per axis and
    posture. A contact has none here. gain : by how much χ² falls, with q unknowns. weight : the
    same less what as many unknowns are worth (Schwarz). p_value : that chance alone lets it fall so
    far. remaining_p : probability of the χ² that is left. size_std : of the length of value, along
    itself, to first order; noise across it makes a length near none too large. columns : (m, q),
    derivative of the residuals by its unknowns.
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
    size_std: float = np.nan
    between: tuple[float, float] | None = None
    columns: FloatArray | None = field(default=None, compare=False, repr=False)

    @property
    def explains(self) -> bool:
        """Nothing remarkable is left."""
        return self.remaining_p >= CAUSE_EXPLAINS

    @property
    def scatters(self) -> bool:
        """It is a scatter, not a change."""
        return self.kind in NOISE

    @property
    def told(self) -> bool:
        """Its size is told from none."""
        return self.p_value < CAUSE_EXPLAINS


@record
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


@record
class Model:
    """Derivative (m, q) by the unknowns, of parameters by `shape` (p, q), which gives them back."""

    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    columns: FloatArray
    shape: FloatArray | None = None


def fitted(model: Model, given: Whitened) -> Cause:
    """Fit a cause to the residuals.

    What changed is minus what would cancel it: e is linear about the estimate.
    """
    columns = given.white(model.columns)
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    U, s, Vt = np.linalg.svd(columns / size, full_matrices=False)
    seen = s > 1e-9 * s.max(initial=0.0)
    along = U[:, seen].T @ given.residual
    gain, q = float(along @ along), int(seen.sum())
    root = (Vt[seen].T / s[seen]) / size[:, None]
    if model.shape is not None:
        root = model.shape @ root
    sizes = -(root @ along), np.linalg.norm(root, axis=1)
    found = explained(given, model.kind, gain, q, model.support, model.postures, *sizes)
    along = found.value / (np.linalg.norm(found.value) or 1.0)
    size_std = float(np.linalg.norm(along @ root))
    return replace(found, size_std=size_std, columns=model.columns)


def explained(
    given: Whitened,
    kind: Kind,
    gain: float,
    unknowns: int,
    support: int | None = None,
    postures: tuple[int, ...] = (),
    value: FloatArray = NO_SIZE,
    std: FloatArray = NO_SIZE,
) -> Cause:
    """A cause of so many unknowns that lowers χ² of the residuals by `gain`; the rest as there."""
    return Cause(
        kind=kind,
        support=support,
        postures=postures,
        value=value,
        std=std,
        gain=gain,
        weight=gain - (unknowns + len(postures) * (kind in STEPS)) * given.worth,
        unknowns=unknowns,
        p_value=float(chi2_sf(gain, unknowns)),
        remaining_p=float(chi2_sf(max(given.chi2 - gain, 0.0), given.dof - unknowns)),
    )
