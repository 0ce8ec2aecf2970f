"""Calibrations side by side: do they agree within their uncertainties.

Self-calibration and laser tracker of one rig are then joined into what both say.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import constants, nominal, prior_std, vector
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.information import Contrast, gain, inverse, p_value
from tdfscal.records import ANGLES, FloatArray, Rotations
from tdfscal.significance import COVERAGE_FACTOR, DETECTION_POWER, EXPANDED_COVERAGE, INCOMPATIBLE


@record
class Comparison:
    """A against B, independent or one of them with all data of the other.

    rotation_vector : (n, 3), rad, d_i = log(X_{A,i} X_{B,i}ᵀ) in the BCS; its covariance (3n, 3n)
    is the sum of both where they are independent, their difference where one has all data of the
    other. rpy : (n, 3), rad, roll, pitch, yaw of A minus those of B, in (−π, π]; rpy_std : its
    standard uncertainty. en : (n, 3), |rpy| / (2 rpy_std).
    chi2 of all rotation vectors together, its dof (3n; fewer where little was added) and p_value.
    sensor_p : (n,), chance of as much χ² as a turn of each sensor alone takes.
    They are compatible where p_value and the least sensor_p are plausible, at one level for all
    `tests` that are judged together (Bonferroni); E_n only explains, since of nine angles one
    exceeds 1 by chance in a third of sound comparisons.
    detectable : (n, 3), rad, the smallest change of each angle alone that χ² would have seen
    with probability `significance.DETECTION_POWER`. obstacle : what makes of them no pair to be
    verified, whatever the numbers say.
    """

    names: tuple[str, str]
    supports: tuple[str, ...]
    rotation_vector: FloatArray
    covariance: FloatArray
    rpy: FloatArray
    rpy_std: FloatArray
    en: FloatArray
    chi2: float
    dof: int
    p_value: float
    sensor_p: FloatArray
    detectable: FloatArray
    obstacle: Finding | None = None
    tests: int = 1

    @property
    def compatible(self) -> bool:
        """Whether the numbers agree, whatever keeps them from being verified.

        By all differences together and by the likeliest sensor, each at half the level: the χ² of
        all angles alone would dilute one sensor's turn.
        """
        return min(self.p_value, self.alone) >= self.limit

    @property
    def verified(self) -> bool:
        """They agree, and nothing keeps them from being two results of one rig."""
        return self.compatible and self.obstacle is None

    @property
    def alone(self) -> float:
        """Chance that any sensor differs as much by itself."""
        return min(len(self.sensor_p) * float(self.sensor_p.min()), 1.0)

    @property
    def limit(self) -> float:
        """Probability below which either test finds them incompatible."""
        return INCOMPATIBLE / 2 / self.tests

    @property
    def finding(self) -> Finding:
        """Whether they agree, with the angle that departs most."""
        i, k = np.unravel_index(int(np.argmax(self.en)), self.en.shape)
        code, p = "calibrations-compatible", self.p_value
        if not self.compatible:
            code = "calibrations-incompatible-together"
            if self.alone <= self.p_value:
                code, p, i = "calibrations-incompatible", self.alone, np.argmin(self.sensor_p)
                k = np.argmax(self.en[i])
        above, difference = int(np.sum(self.en > 1)), 1e3 * float(self.rpy[i, k])
        values: dict[str, Value] = {
            "first": self.names[0],
            "second": self.names[1],
            "angle": ANGLES[k],
            "support": self.supports[int(i)],
            "difference": difference,
            "expanded": abs(difference) / max(float(self.en[i, k]), 1e-9),
            "en": float(self.en[i, k]),
            "by_chance": (1 - EXPANDED_COVERAGE) * self.en.size,
            "above": above,
            "single": above == 1,
            "of": self.en.size,
        }
        return Finding(code, self.names, p_value=p, values=values)


def judged_together(pairs: Sequence[Comparison]) -> tuple[Comparison, ...]:
    """Pairs that are judged together."""
    tests = max(sum(np.isfinite(pair.p_value) for pair in pairs), 1)
    return tuple(replace(pair, tests=tests) for pair in pairs)


@record
class Nested:
    """One of two estimates, A and B, has all data of the other, and more.

    whole : 0 where A has, 1 where B. walk : rad², variance of each turn about a BCS axis that is
    declared for the time between them.
    """

    whole: int
    walk: float = 0.0


def stated_alike(a: Calibrated, b: Calibrated) -> FloatArray:
    """Covariance (3n, 3n) of the turns of two estimates by what both take from one statement.

    A gain's tolerance, a drawing, a weighing: each estimate moves with the error by C Σ⁻¹, with C
    its covariance and Σ the statement's. Zeros count as tared in between.
    """
    (std, stated), (std_b, stated_b) = ((prior_std(x.rig), vector(nominal(x.rig))) for x in (a, b))
    alike = (
        constants(a.rig.n) & (std == std_b) & (stated == stated_b) & np.isfinite(std) & (std > 0)
    )
    turns = slice(3 * a.rig.n)
    return np.asarray((a.covariance[turns, alike] / std[alike] ** 2) @ b.covariance[alike, turns])


def compare_pair(
    a: tuple[str, Rotations],
    b: tuple[str, Rotations],
    nested: Nested | None = None,
    common: FloatArray | float = 0.0,
) -> Comparison:
    """A minus B.

    nested : where one has all recordings of the other; otherwise they share none, but errors whose
    covariance common (3n, 3n) is, as `stated_alike` says.

    Raises DataError where the supports differ or a covariance is not positive definite.
    """
    first, second = a[1], in_order_of(a[1], b[1])
    for name, rotations in (a, b):
        _require_covariance(name, rotations)
    d = so3.log(first.rotation @ np.swapaxes(second.rotation, 1, 2))
    rpy = so3.deviations(first.rotation, second.rotation)
    if nested is None:
        # Both know every turn: the one may be as sure as a reference that counts as exact.
        covariance = first.covariance + second.covariance
        less = np.zeros_like(covariance) + common + np.transpose(common)
        covariance = covariance - less
        known = seen = inverse(covariance)
        # Each by its own angles, which matters where they are far apart.
        own = rpy_std(first) ** 2 + rpy_std(second) ** 2
        std = np.sqrt(own - so3.rpy_variance(first.rotation, less))
    else:
        whole, part = (first, second) if nested.whole == 0 else (second, first)
        walked = part.covariance + nested.walk * np.eye(len(part.covariance))
        change = gain(walked, whole.covariance)
        covariance, known, seen = change.covariance, change.information, change.seen
        std = np.sqrt(so3.rpy_variance(first.rotation, covariance))
    departure = Contrast(known, known @ d.reshape(-1))
    chi2, dof = departure.chi2()
    between = Contrast(seen, np.zeros(len(seen)))
    return Comparison(
        names=(a[0], b[0]),
        supports=first.supports,
        rotation_vector=d,
        covariance=covariance,
        rpy=rpy,
        rpy_std=std,
        en=np.abs(rpy) / (COVERAGE_FACTOR * std),
        chi2=chi2,
        dof=dof,
        p_value=p_value((chi2, dof)),
        sensor_p=departure.turn_p(len(d)),
        detectable=smallest_changes(first.rotation, between, dof, INCOMPATIBLE / 2),
    )


def smallest_changes(
    rotation: FloatArray, departure: Contrast, dof: int, level: float
) -> FloatArray:
    """Smallest change (n, 3), rad, of one angle alone that a χ² sees; ∞ where none is seen.

    rotation : (n, 3, 3). dof, level : of the test; power: `significance.DETECTION_POWER`.
    """
    n = len(rotation)
    threshold = float(chi2_quantile(1 - level, dof)) if dof else np.inf
    offset = float(special.chndtrinc(threshold, dof, 1 - DETECTION_POWER)) if dof else np.inf
    turns = departure.matrix[: 3 * n, : 3 * n].reshape(n, 3, n, 3)
    information = turns[np.arange(n), :, np.arange(n)]
    turn = np.linalg.inv(so3.rpy_jacobian(rotation))  # columns: the turns that the angles are
    seen = np.einsum("iaj,iab,ibj->ij", turn, information, turn)
    least = np.divide(offset, seen, out=np.full((n, 3), np.inf), where=seen > 0)
    return np.asarray(np.sqrt(least))


def in_order_of(model: Rotations, other: Rotations) -> Rotations:
    """`other` with its supports in the order of `model`; DataError where they differ."""
    if set(model.supports) != set(other.supports) or len(model.supports) != len(other.supports):
        values: dict[str, Value] = {"others": other.supports}
        raise DataError(Finding("supports-differ", model.supports, values=values))
    order = np.array([other.supports.index(name) for name in model.supports])
    rows = (3 * order[:, None] + np.arange(3)).reshape(-1)
    return Rotations(model.supports, other.rotation[order], other.covariance[np.ix_(rows, rows)])


def rpy_std(rotations: Rotations) -> FloatArray:
    """Standard uncertainty (n, 3), rad, of roll, pitch, yaw."""
    return np.asarray(np.sqrt(so3.rpy_variance(rotations.rotation, rotations.covariance)))


def _require_covariance(name: str, rotations: Rotations) -> None:
    C = rotations.covariance
    scale = np.sqrt(np.abs(np.diag(C)))
    if not (np.all(np.isfinite(C)) and np.all(scale > 0)) or (
        np.linalg.eigvalsh(C / scale[:, None] / scale)[0] <= 1e-12
    ):
        raise DataError(Finding("covariance-singular"), where=name)


#: Rounds until two estimates are counted from what they are together; of a turn between them each
#: leaves a share of its square.
_ROUNDS = 8


@record
class Joint:
    """The joint estimate of two calibrations of the same sensors.

    test : the consistency test that comes first; its verdict gates the result: rotations of an
    inconsistent pair describe neither.
    """

    rotations: Rotations
    test: Comparison


def combine(self_calibration: Rotations, tracker: Rotations) -> Joint:
    """Add what two independent estimates say, each with its full covariance.

    Counted from what they say together, X, nothing is left: Σ C_a⁻¹ d_a = 0, with d_a stacked from
    log(X_{a,i} X_iᵀ). The covariance is (C_1⁻¹ + C_2⁻¹)⁻¹, which in no direction exceeds either
    C_a; turning the covariances from X_a to X would change it by about |d_a|/2 of itself, mrad
    here.

    Raises
    ------
    DataError : the two are not of the same supports.
    """
    test = compare_pair(("self", self_calibration), ("tracker", tracker))
    both = self_calibration, in_order_of(self_calibration, tracker)
    informations = [inverse(each.covariance) for each in both]
    covariance = inverse(informations[0] + informations[1])
    X = both[1].rotation
    for _ in range(_ROUNDS):
        away = [so3.log(each.rotation @ np.swapaxes(X, 1, 2)).ravel() for each in both]
        score = informations[0] @ away[0] + informations[1] @ away[1]
        X = so3.project(so3.exp((covariance @ score).reshape(-1, 3)) @ X)
    return Joint(Rotations(self_calibration.supports, X, covariance), test)
