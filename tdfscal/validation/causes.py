"""What explains residual wrenches that a calibration does not: one cause at a time.

A cause is a linear model e = H a + noise of the residual wrenches of all postures; it is judged by
how far χ² falls when its q unknowns a are fitted (generalised least squares), less q ln N for N
residuals (Schwarz, Ann. Stat. 6, 1978); the posture from which a step holds is an unknown too.
Causes of few and many unknowns are so held against each other on one scale, twice the logarithm of
their odds.

Beside what may have changed since the calibration these are changes in the course of the log, a
contact in some postures, and readings that scatter more than is stated, with one unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import Literal

import numpy as np

from tdfscal.frozen import field, record
from tdfscal.model.parameters import layout
from tdfscal.model.postures import walk_modes
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.records import FloatArray
from tdfscal.selfcal.score_tests import best_variance
from tdfscal.significance import CAUSE_EXPLAINS, CAUSES_APART
from tdfscal.validation.residuals import Linearised, Whitened

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
    asked = given.ask(model.columns)
    shape = np.eye(len(asked.amount)) if model.shape is None else model.shape
    root, value = shape @ asked.root, -shape @ asked.amount
    along = value / (np.linalg.norm(value) or 1.0)
    gain, unknowns = float(asked.statistic), int(asked.unknowns)
    ends = len(model.postures) * (model.kind in STEPS)
    return Cause(
        kind=model.kind,
        support=model.support,
        postures=model.postures,
        value=value,
        std=np.linalg.norm(root, axis=1),
        size_std=float(np.linalg.norm(along @ root)),
        gain=gain,
        weight=gain - (unknowns + ends) * given.worth,
        unknowns=unknowns,
        p_value=float(chi2_sf(gain, unknowns)),
        remaining_p=float(chi2_sf(max(given.chi2 - gain, 0.0), given.dof - unknowns)),
        columns=model.columns,
    )


#: What steps on the way, and the parameters that stand for it.
_STEPPING = dict(zip(STEPS, ("rotation", "zero"), strict=True))
#: Shapes of a gain's change in S (xx, yy, zz, yz, xz, xy): of all axes alike, one by one, each by
#: itself with crosstalk.
_GAINS = (
    np.array([[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]]).T,
    *(np.eye(6)[:, [a]] for a in range(3)),
    np.eye(6)[:, :3],
    np.eye(6),
)

#: At most this share of the postures can be in contact before no cause is named.
_TOUCHED = 0.4
#: Postures up to which noise that connects them is tried, and zeros that jump and return: the work
#: grows with their cube, and with their square.
_CONNECTED = 60
#: Postures that are tried as in contact, those that a wrench explains most of.
_SUSPECTS = 20


def causes(given: Whitened) -> Causes:
    """Hold all single causes against each other."""
    models = _models(given.at)
    single = [fitted(model, given) for model in (*models, *_in_course(given))]
    contacts = _contacts(given, max(single, key=WEIGHT))
    best: dict[tuple[Kind, int | None, tuple[int, ...]], Cause] = {}
    for cause in (*single, *contacts):
        key = (cause.kind, cause.support, cause.postures)
        if key not in best or cause.weight > best[key].weight:
            best[key] = cause
    tried = len(models) + (len(given.at.own) if contacts else 0)
    found = [*best.values(), *_scatters(given)]
    # What looks alike to rounding stays in the order above.
    return Causes(tuple(sorted(found, key=lambda cause: -round(cause.weight, 6))), tried)


def unknown_columns(cause: Cause, at: Linearised) -> FloatArray:
    """Derivative (m, q) of residuals by what a cause changes; none of a zero, nor of a scatter."""
    if cause.columns is None or cause.kind == "zero drifted":
        return at.columns[:, :0]
    return cause.columns


def _models(at: Linearised) -> list[Model]:
    place, n = layout(at.sensors), at.sensors

    def by(group: str) -> FloatArray:
        return at.columns[:, place[group]]

    load = np.concatenate([by("mass"), by("barycentre")], axis=1)
    # A gain common to all sensors looks like another mass: whoever weighs the terminal knows.
    alike = by("sensitivity").reshape(-1, n, 6).sum(axis=1) @ _GAINS[0]
    found = [
        Model("load changed", None, (), load),
        Model("load changed", None, (), by("mass"), np.eye(4)[:, :1]),
        Model("gains changed", None, (), alike, _GAINS[0]),
        Model("sensors turned", None, (), by("rotation")),
    ]
    for i in range(n):
        turn, zero = (by(group)[:, 3 * i : 3 * i + 3] for group in ("rotation", "zero"))
        found += [Model("sensor turned", i, (), turn), Model("zero drifted", i, (), zero)]
        for a in range(3):
            found.append(Model("zero drifted", i, (), zero[:, [a]], np.eye(3)[:, [a]]))
    if not len(at.own):  # in motion the residual is known along these alone
        return found
    found.append(Model("base tilted", None, (), by("tilt")))
    for i in range(n):
        gain = by("sensitivity")[:, 6 * i : 6 * i + 6]
        found += [Model("gain changed", i, (), gain @ shape, shape) for shape in _GAINS]
    return found


def _in_course(given: Whitened) -> Iterator[Model]:
    """Steps of each sensor, from its likeliest posture on, and drifts of its zero or of all."""
    at = given.at
    if len(at.own) < 2:
        return
    for kind, group in _STEPPING.items():
        for i in range(at.sensors):
            begin = layout(at.sensors)[group].start + 3 * i
            columns = at.columns[:, begin : begin + 3]
            returns = group == "zero" and len(at.own) <= _CONNECTED
            run = given.likeliest_run(columns, returns=returns)
            during = np.repeat(at.course.step(*run), 6, axis=0)
            yield Model(kind, i, run, columns * during)
    by_zero = at.zero_columns.reshape(len(at.own), 6, at.sensors, 3)
    for warm, shape in at.course.drifts(at.sensors):
        drift: Kind = "zeros follow temperature" if warm else "zeros drift"
        since = shape - shape[np.argmin(at.course.time)]
        most = since[np.argmax(np.abs(since[:, :, 0]).max(axis=1))]
        for i in (None, *range(at.sensors)):
            own = slice(None) if i is None else slice(i, i + 1)
            columns = np.einsum("kbna,kng->kbnga", by_zero[:, :, own], shape[:, own])
            back = np.kron(block_diagonal(*most[own, None]), np.eye(3))
            yield Model(drift, i, (), columns.reshape(len(at.columns), -1), np.asarray(back))


def _scatters(given: Whitened) -> list[Cause]:
    """More noise than is stated: of all forces (1/f too), of one sensor, of moments (friction).

    That all zeros moved once, as a tare does it, and that they wander is noise along their columns
    that connects the postures.
    """
    at, K, n = given.at, len(given.at.own), given.at.sensors
    found = [_scatter(given, "zeros moved", None, at.zero_columns[None])]
    if not K:
        return found
    zero = at.zero_columns.reshape(K, 6, n, 3)
    found += [
        _scatter(given, "noise grown", None, zero.reshape(K, 6, -1)),
        *(_scatter(given, "noise grown", i, zero[:, :, i]) for i in range(n)),
        _scatter(given, "hinges stick", None, at.own[:, :, 3:]),
    ]
    if 1 < K <= _CONNECTED:
        span = max(float(np.ptp(at.course.time)), 1e-9)
        modes = walk_modes(span**-0.5, at.course.time)[0]
        walk = np.einsum("kanj,kg->kagnj", zero, modes).reshape(1, 6 * K, -1)
        found.append(_scatter(given, "zeros wander", None, walk))
    return found


def _scatter(given: Whitened, kind: Kind, support: int | None, columns: FloatArray) -> Cause:
    """A variance along columns (G, m / G, c); it explains where, beside it, nothing stands out."""
    rows = columns.shape[:2]
    common = given.common.reshape(*rows, -1)
    theta, gain = best_variance(columns, given.residual.reshape(rows), common)
    size = np.sqrt(theta)
    rest = given.scattered(size * columns) if theta > 0 else given
    models, alone = _models(rest.at), rest.wrenches
    asked = [rest.ask(model.columns) for model in models]
    p = [float(chi2_sf(rest.chi2, rest.dof))]
    p += [len(models) * float(chi2_sf(of.statistic, max(int(of.unknowns), 1))) for of in asked]
    p += (len(alone.unknowns) * chi2_sf(alone.statistic, np.maximum(alone.unknowns, 1))).tolist()
    return Cause(
        kind=kind,
        support=support,
        postures=(),
        value=np.array([size]),
        std=np.array([size / np.sqrt(2.0 * max(given.dof, 1))]),
        gain=gain,
        weight=gain - given.worth,
        unknowns=1,
        p_value=float(chi2_sf(gain, 1)) / 2,
        # Three questions, each at its own level.
        remaining_p=min(1.0, 3 * min(p)),
    )


def _touching(own: FloatArray, postures: Sequence[int]) -> Model:
    """A contact wrench in each of c postures; its size is told by the residual wrenches."""
    columns = np.zeros((len(own), 6, len(postures), 6))
    for place, k in enumerate(postures):
        columns[k, :, place] = own[k]
    wrenches = columns.reshape(6 * len(own), -1)
    return Model("contact", None, tuple(postures), wrenches, np.zeros((0, wrenches.shape[1])))


def _contacts(given: Whitened, rival: Cause) -> list[Cause]:
    """Contact in one posture each; where none explains all, in more of them, one by one."""
    own = given.at.own
    if len(own) < 2:
        return []
    suspects = np.argsort(given.wrenches.statistic)[::-1][:_SUSPECTS].tolist()
    found = [fitted(_touching(own, [k]), given) for k in suspects]
    best = max(found, key=WEIGHT)
    while not best.explains and not rival.explains:
        touched = best.postures
        more = [sorted([*touched, k]) for k in suspects if k not in touched]
        if not more or len(touched) + 1 > _TOUCHED * len(own):
            break
        best = max((fitted(_touching(own, each), given) for each in more), key=WEIGHT)
        found.append(best)
    return found
