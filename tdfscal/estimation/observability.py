"""What the data determine, said before any number (theory, section 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.acceptance.turns import prior_turn_std, turn_names, turn_std
from tdfscal.errors import NotConvergedError, NotIdentifiableError
from tdfscal.findings import Finding
from tdfscal.model.parameters import State
from tdfscal.model.statics import Postures, forces
from tdfscal.records import BoolArray, FloatArray, Rig

#: An angle known better than half its prior owes more to the data than to the prior.
_PRIOR_SHARE = 0.5
_CORRELATED = 0.8
#: Turning a sensor about its load is what no datum shows: within this angle it is the cause.
_ALONG_LOAD = np.radians(20.0)


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
class Weakness:
    """An angle that the data do not determine, why, and what to do."""

    angle: Angle
    cause: str
    advice: str


@dataclass(frozen=True, slots=True)
class Correlation:
    """Two angles whose errors go together."""

    a: str
    b: str
    value: float


@dataclass(frozen=True, slots=True)
class Observability:
    """The verdict: every angle, the weak ones with cause and advice, and close couples.

    undetermined : sensors that lack an axis and have an angle that the data do not determine;
    they go without a number. weak : their weaknesses last. spread : (n,), rad, angle about the mean
    load within which the loads on each sensor stay.
    """

    angles: tuple[Angle, ...]
    weak: tuple[Weakness, ...]
    correlations: tuple[Correlation, ...]
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
    def unseen(self) -> str:
        """The angles that are not determined, without a number; the first's cause stands for all.

        There is one.
        """
        names = ", ".join(self._open)
        if len(self.weak) == len(self.angles):
            names = "any angle of any sensor"
        return f"{names}; for {self.weak[0].angle.name}, {self.weak[0].cause}"

    @property
    def _open(self) -> list[str]:
        """Names of the weak angles of sensors that have to be determined."""
        return [w.angle.name for w in self.weak if w.angle.support not in self.undetermined]

    @property
    def findings(self) -> list[Finding]:
        """Sensors that go without angles although the calibration stands."""
        return [Finding("mounting-open", self.undetermined)] if self.undetermined else []

    @property
    def verdict(self) -> str:
        """One sentence on what is identified."""
        w, every = self.weakest, "every angle"
        if self.undetermined:
            every = f"every angle of a sensor but {', '.join(self.undetermined)}"
        return f"{every} is determined by the data; the weakest is {w.name}, {_mrad(w.std)}"


def require_angles(
    seen: Observability, settled: bool, iterations: int, evidence: object, data: str, more: str
) -> None:
    """Raise NotIdentifiableError or NotConvergedError where no angles can be given.

    data, more : what there is, with its verb, and what to record.
    """
    if not seen.determined.any() or not seen.identified:
        raise NotIdentifiableError(
            f"{data} not determine {seen.unseen}", hint=seen.weak[0].advice, evidence=evidence
        )
    if not settled:
        raise NotConvergedError(
            f"the estimate did not settle in {iterations} iterations",
            hint=f"check mass, hinges and nominal mounting in rig.yaml, and record {more}",
            evidence=evidence,
        )


def _mrad(std: float) -> str:
    return f"±{1e3 * std:.2g} mrad" if std < 1 else "more than ±1 rad"


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
    good = (std < limit) & (std <= _PRIOR_SHARE * prior)
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
        _couples(angles, covariance),
        spread,
        undetermined=tuple(n for n in rig.supports if n in {w.angle.support for w in weak} & lacks),
    )


def _explain(
    angle: Angle, off: float, spread: float, across: float, limit: float, moving: bool
) -> Weakness:
    """Say why an angle is weak and what would help; off : rad, its axis from the loads'."""
    longer = "move for longer" if moving else "record more postures"
    seen = "too short or too small a motion" if moving else "too few or too similar postures"
    if angle.std < limit:
        return Weakness(
            angle,
            f"its standard uncertainty, {_mrad(angle.std)}, is mostly that of its prior",
            f"{longer} or squeeze harder, or widen rpy_std to let the data speak",
        )
    if off > _ALONG_LOAD:
        return Weakness(
            angle,
            f"standard uncertainty {_mrad(angle.std)} from {seen}",
            f"{longer} with more tilt, tare the sensors, and weigh the terminal",
        )
    more = f" (they carry {across:.2g} N across it" if across >= 0.05 else " (they carry none"
    if across >= 0.05 and angle.std < 1:
        more += f"; about {_round_up(2 * across * angle.std / limit)} N would show it"
    return Weakness(
        angle,
        f"the loads on this sensor stay within {np.degrees(spread):.2g}° of one direction, and "
        "turning a sensor about its load changes nothing",
        f"squeeze the NCPs against each other so that the sensors feel sideways loads{more})",
    )


def _round_up(value: float) -> str:
    """Two significant digits, upwards."""
    digits = 10 ** (np.floor(np.log10(value)) - 1)
    return f"{np.ceil(value / digits) * digits:.0f}"


def _couples(angles: tuple[Angle, ...], covariance: FloatArray) -> tuple[Correlation, ...]:
    """Pairs of angles with a correlation above 0.8, the closest first."""
    std = np.sqrt(np.diagonal(covariance))
    R = covariance / np.outer(std, std)
    pairs = [
        Correlation(angles[a].name, angles[b].name, float(R[a, b]))
        for a, b in np.argwhere(np.triu(np.abs(R), 1) > _CORRELATED)
    ]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair.value)))
