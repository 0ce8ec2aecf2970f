"""What the data determine, said before any number (theory, section 4)."""

from __future__ import annotations

import numpy as np

from tdfscal.acceptance import prior_turn_std, turn_names, turn_std
from tdfscal.errors import NotConvergedError, NotIdentifiableError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State
from tdfscal.model.statics import Postures, forces
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.records import BoolArray, FloatArray, Rig

#: An angle known better than half its prior owes more to the data than to the prior.
PRIOR_SHARE = 0.5
#: Turning a sensor about its load is what no datum shows: within this angle it is the cause.
_ALONG_LOAD = np.radians(20.0)
#: Less than this across its load, N, and a sensor carries none.
_CARRIED = 0.05


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
        values: dict[str, Value] = {
            "angles": self._named(self._open),
            "first": first.angle.name,
            "determined": self._named(stand),
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


def load_directions(state: State, postures: Postures) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Axis (n, 3) of the loads in the BCS, their spread (n,) in rad about it, and the quadratic
    mean (n,) of the load across it, N.

    A load and its opposite have one axis. NCPs only translate, so a sensor's frame and the BCS
    see the same angles.
    """
    F = np.swapaxes(forces(state, postures.force), 0, 1)  # (n, K, 3)
    axis = np.linalg.eigh(np.swapaxes(F, 1, 2) @ F)[1][:, :, 2]
    along = (F @ axis[..., None])[..., 0]
    across = np.linalg.norm(F - along[..., None] * axis[:, None], axis=2)
    across, along = (np.sqrt(np.mean(part**2, axis=1)) for part in (across, along))
    return axis, np.arctan2(across, along), across


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
    axis, spread, across = load_directions(state, postures)
    weak = []
    for k, angle in enumerate(angles):
        if angle.identified:
            continue
        i, j = divmod(k, 3)
        off = float(np.arccos(min(1.0, abs(axis[i, j]))))
        weak.append(_explain(angle, off, spread[i], across[i], limit, moving))
    lacks = {name for name, axes in zip(rig.supports, rig.axes, strict=True) if not axes.all()}
    return Observability(
        angles,
        tuple(sorted(weak, key=lambda w: w.angle.support in lacks)),
        spread,
        undetermined=tuple(n for n in rig.supports if n in {w.angle.support for w in weak} & lacks),
    )


def _explain(
    angle: Angle, off: float, spread: float, across: float, limit: float, moving: bool
) -> Weakness:
    """Say why an angle is weak and what would help; off : rad, its axis from the loads'."""
    values: dict[str, Value] = {"moving": moving, **_size(angle.std)}
    code = "angle-along-load"
    if angle.std < limit:
        code = "angle-by-prior"
    elif off > _ALONG_LOAD:
        code = "angle-few-postures"
    else:
        enough = across >= _CARRIED and angle.std < 1
        values |= {
            "within": float(np.degrees(spread)),
            "carried": across >= _CARRIED,
            "across": across,
            "enough": f"{_round_up(2 * across * angle.std / limit)} N" if enough else "",
        }
    return Weakness(angle, Finding(code, (angle.support,), angle.std, "rad", values=values))


def _round_up(value: float) -> str:
    """Two significant digits, upwards."""
    digits = 10 ** (np.floor(np.log10(value)) - 1)
    return f"{np.ceil(value / digits) * digits:.0f}"
