"""Weighted rigid registration, reference → measured, with full covariances of both point sets.

Model: y_j = R x_j + t_g(j), the measured y_j with covariance C_j, the reference x_j with
covariance D_j, R one rotation and t_g one translation per group (one group is the ordinary
case; a mechanism whose positioners move parallel to common axes has one group per positioner).
Profiling over the true points leaves Σ e_jᵀ S_j⁻¹ e_j with e_j = y_j − R x_j − t and the
effective covariance S_j = C_j + R D_j Rᵀ; its minimum is the maximum-likelihood estimate.
Lengths in m, rotations perturbed on the left: R_true = exp([d]×) R.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import special

from tdfscal.errors import NotConvergedError, NotIdentifiableError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile, chi2_sf
from tdfscal.numerics.rotation_fits import PRODUCT_ROUNDING, align, transposed
from tdfscal.records import FloatArray, IntArray
from tdfscal.significance import HANDEDNESS, MIRRORED

LARGEST_MEANINGFUL_STD = 0.3
"""rad; a 95 % interval wider than a radian: no linear covariance describes it any more."""


@record
class Registration:
    """A rigid transform reference → measured of N points in G groups, with its statistics.

    rotation : (3, 3), det = +1. translation : (G, 3), m.
    covariance : (3 + 3G, 3 + 3G) of (d, t_1 … t_G), rad and m.
    residual : (N, 3), m. normalised : (N, 3), residual over its own standard deviation.
    statistic : (N,), residual in its own covariance, χ² with `redundancy` (N,) degrees of freedom.
    outlier_p : (N,), probability of a statistic this large by chance, for each point alone.
    p_value : of chi2; None where the noise was estimated from these residuals.
    sigma : m, standard deviation per coordinate estimated from the residuals; None where stated.
    adjusted : (N, 3), best estimate of the true reference points, m.
    jacobian : (N, 3, 3 + 3G) of the residual. weight : (N, 3, 3), S⁻¹.
    handed : whether the mirrored set fits significantly worse, so that handedness is checked.
    """

    rotation: FloatArray
    translation: FloatArray
    covariance: FloatArray
    residual: FloatArray
    normalised: FloatArray
    statistic: FloatArray
    redundancy: IntArray
    outlier_p: FloatArray
    chi2: float
    dof: int
    p_value: float | None
    sigma: float | None
    adjusted: FloatArray
    jacobian: FloatArray
    weight: FloatArray
    handed: bool

    @property
    def rotation_covariance(self) -> FloatArray:
        """(3, 3), rad², of d with R_true = exp([d]×) R, d in the measured frame."""
        return self.covariance[:3, :3]

    @property
    def gain(self) -> FloatArray:
        """(3 + 3G, N, 3): how an error of each residual moves the parameters."""
        moves = np.einsum("pq,niq,nij->pnj", self.covariance, -self.jacobian, self.weight)
        return np.asarray(moves)


class MirroredError(NotIdentifiableError):
    """The mirror image of the reference fits, the reference does not."""

    exit_status = 3


def register(
    measured: npt.ArrayLike,
    reference: npt.ArrayLike,
    measured_cov: FloatArray | None = None,
    reference_cov: FloatArray | None = None,
    group: IntArray | None = None,
    *,
    least: float = 0.0,
) -> Registration:
    """Register one set of N points and judge the answer.

    measured, reference : (N, 3), m. measured_cov, reference_cov : (N, 3, 3), m²; with neither,
    equal isotropic noise of both sets is assumed and its size taken from the residuals.
    least : m per coordinate, below which no noise is taken from residuals, however well they fit.

    Raises
    ------
    NotIdentifiableError : the points do not determine a rotation: too few, coincident or
        collinear within their noise.
    MirroredError : the mirror image of the reference fits significantly better.
    NotConvergedError : no minimum was found.
    """
    y, x = np.asarray(measured, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    index = np.zeros(len(y), dtype=np.int64) if group is None else group
    unknown = measured_cov is None and reference_cov is None
    none = np.zeros((len(y), 3, 3))
    half = none + 0.5 * np.eye(3)  # noise of both sets alike, of unit sum
    C = half if unknown else none if measured_cov is None else measured_cov
    D = half if unknown else none if reference_cov is None else reference_cov
    groups = int(index.max()) + 1 if len(y) else 0
    dof = 3 * len(y) - 3 - 3 * groups
    if dof <= 0:
        raise NotIdentifiableError(
            Finding("registration-few", size=len(y), values={"groups": groups})
        )
    fit = align(y, x, C, D, index)
    mirror = align(y, -x, C, D, index, tolerance=1e-3)
    floor2 = _rounding(y, x) + least**2
    sigma2 = max(float(min(fit.chi2, mirror.chi2)) / dof, floor2) if unknown else 1.0
    D_turned = fit.rotation @ D @ fit.rotation.T
    weight = _inv(C + D_turned)
    rotated_error = np.einsum("nij,njk,nk->ni", D_turned, weight, fit.residual)
    J, to_origin = _jacobian(x, fit.rotation, rotated_error, np.eye(groups)[index])
    normal = np.einsum("nip,nij,njq->pq", J, weight, J)
    _refuse_undetermined(normal, D_turned, weight, sigma2)
    _refuse_mirrored(float(fit.chi2), float(mirror.chi2), dof, floor2 if unknown else 0.0)
    if not fit.converged:
        raise NotConvergedError(Finding("registration-unsettled"))
    if unknown:
        sigma2 = max(float(fit.chi2) / dof, floor2)
    back = 2 * np.eye(len(to_origin)) - to_origin
    scale = 1 / np.sqrt(np.diag(normal))
    centred = scale[:, None] * _inv(scale[:, None] * normal * scale) * scale * sigma2
    weight = weight / sigma2
    chi2 = float(fit.chi2 / sigma2)
    statistic, redundancy, normalised = _judge_points(fit.residual, J, weight, centred)
    return Registration(
        rotation=fit.rotation,
        translation=fit.translation,
        covariance=to_origin @ centred @ to_origin.T,
        residual=fit.residual,
        normalised=normalised,
        statistic=statistic,
        redundancy=redundancy,
        outlier_p=_outlier_p(
            statistic, redundancy, chi2, dof, floor2 / sigma2 if unknown else None
        ),
        chi2=chi2,
        dof=dof,
        p_value=None if unknown else float(chi2_sf(chi2, dof)),
        sigma=float(np.sqrt(sigma2)) if unknown else None,
        adjusted=x + rotated_error @ fit.rotation,
        jacobian=J @ back,
        weight=weight,
        handed=bool(mirror.chi2 - fit.chi2 > chi2_quantile(1 - HANDEDNESS, 1) * sigma2),
    )


def _jacobian(
    x: FloatArray, R: FloatArray, rotated_error: FloatArray, member: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Jacobian (N, 3, 3 + 3G) about each group's centroid, and what takes t from there to 0.

    rotated_error : (N, 3), m, of the adjusted reference points. member : (N, G), 0 or 1.
    """
    mean = (member / member.sum(axis=0)).T @ x
    lever = (x - member @ mean) @ R.T + rotated_error
    J = np.concatenate([so3.hat(lever), -np.kron(member[:, None], np.eye(3))], axis=-1)
    # t refers to the origin of the reference frame, not to the centroid.
    to_origin = np.eye(J.shape[-1])
    to_origin[3:, :3] = so3.hat(mean @ R.T).reshape(-1, 3)
    return J, to_origin


@record
class Extension:
    """Further parameters of a registration: value (q,), covariance (q, q)."""

    value: FloatArray
    covariance: FloatArray


def extend(fit: Registration, columns: FloatArray) -> Extension | None:
    """Estimate further linear parameters θ in y = R x + t + columns θ beside the rigid ones.

    columns : (N, 3, q), m per unit of θ. None where the points do not determine them (a
    standard uncertainty above 1).
    """
    WJ = np.einsum("nij,njp->nip", fit.weight, fit.jacobian)
    WB = np.einsum("nij,njp->nip", fit.weight, columns)
    JB = np.einsum("nip,niq->pq", WJ, columns)
    information = np.einsum("nip,niq->pq", columns, WB) - JB.T @ fit.covariance @ JB
    if np.linalg.eigvalsh(information)[0] <= 1.0:
        return None
    covariance = _inv(information)
    # The residual is orthogonal to the rigid parameters at the minimum.
    score = np.einsum("niq,ni->q", WB, fit.residual)
    return Extension(covariance @ score, covariance)


def _inv(m: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(m), dtype=np.float64)


def _rounding(y: FloatArray, x: FloatArray) -> float:
    """Variance per coordinate of numbers of double precision, m²."""
    return float(np.finfo(np.float64).eps * max(np.abs(y).max(), np.abs(x).max())) ** 2


def _refuse_undetermined(
    normal: FloatArray, D: FloatArray, weight: FloatArray, sigma2: float
) -> None:
    """Refuse a rotation whose standard uncertainty has no meaning.

    Noise in the reference points gives even collinear points some width. The information that
    this width feigns, E([n]×ᵀ S⁻¹ [n]×) with n the remaining error of the adjusted point, is
    taken off before judging, and five times its scatter, since the fit picks the rotation that
    makes most of it.
    """
    A, B, C = normal[:3, :3], normal[:3, 3:], normal[3:, 3:]
    information = (A - B @ np.linalg.solve(C, B.T)) / sigma2
    feigned = so3.information_of_crossing(weight, D - D @ weight @ D)
    scatter = np.linalg.norm(np.trace(feigned, axis1=1, axis2=2))
    feigned = feigned.sum(axis=0) + 5 * scatter * np.eye(3)
    # So is what rounding feigns, where points without noise lie on a line.
    feigned += PRODUCT_ROUNDING * np.trace(A) / sigma2 * np.eye(3)
    values, vectors = map(np.asarray, np.linalg.eigh(information - feigned))
    smallest, direction = values[0], vectors[:, 0]
    if smallest < LARGEST_MEANINGFUL_STD**-2:
        axis = direction * np.sign(direction @ [1.0, 1e-3, 1e-6])
        facts: dict[str, Value] = {
            "axis": [f"{round(c, 3) + 0.0:.3f}" for c in axis],
            "bounded": bool(smallest > 0),
        }
        size = float(smallest**-0.5) if smallest > 0 else 0.0
        raise NotIdentifiableError(Finding("registration-open", (), size, "rad", values=facts))


def _refuse_mirrored(chi2: float, mirrored: float, dof: int, floor: float) -> None:
    """F-test, so that neither a misstated noise nor one bad point decides it.

    floor : variance below which none is told from rounding.
    """
    mirrored = max(mirrored, dof * floor)
    if mirrored < chi2 and special.fdtrc(dof, dof, chi2 / max(mirrored, 1e-300)) < MIRRORED:
        raise MirroredError(Finding("points-mirrored"))


def _judge_points(
    e: FloatArray, J: FloatArray, weight: FloatArray, cov: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Residuals in their own covariance Q = S − J cov Jᵀ, which may be rank deficient."""
    S = _inv(weight)
    root = np.asarray(np.linalg.cholesky(S), dtype=np.float64)
    J_white = np.asarray(np.linalg.solve(root, J), dtype=np.float64)
    e_white = np.linalg.solve(root, e[..., None])[..., 0]
    shown = np.eye(3) - J_white @ cov @ transposed(J_white)
    share, axes = np.linalg.eigh(shown)
    seen = share > 1e-6  # share of the noise in this direction that the residual shows
    components = np.einsum("nji,nj->ni", axes, e_white)
    statistic = np.sum(np.where(seen, components**2 / np.where(seen, share, 1.0), 0.0), axis=1)
    spread = root @ axes
    variance = np.einsum("nij,nj,nij->ni", spread, np.where(seen, share, 0.0), spread)
    normalised = np.where(variance > 0, e / np.sqrt(np.where(variance > 0, variance, 1.0)), 0.0)
    return statistic, seen.sum(axis=1), normalised


def _outlier_p(
    statistic: FloatArray,
    redundancy: IntArray,
    chi2: float,
    dof: int,
    floor: float | None = None,
) -> FloatArray:
    """Probability of each point's statistic against the stated noise and against the other points.

    Taking a point out lowers χ² by its statistic. Where the other points alone are worse than
    stated, a point must stand out from them too (F-test); where the noise was estimated
    from the residuals, from them and from its least variance `floor`, in units of theirs.
    """
    others = dof - redundancy
    safe_others, safe = np.maximum(others, 1), np.maximum(redundancy, 1)
    mean_square = np.maximum(chi2 - statistic, 1e-300) / safe_others
    against_others = special.fdtrc(safe, safe_others, statistic / safe / mean_square)
    against_others = np.where(others > 0, against_others, 1.0)
    stated = chi2_sf(statistic, safe)
    if floor is not None:
        p = np.maximum(against_others, chi2_sf(statistic / floor, safe))
    else:
        p = np.where(mean_square > 1, np.maximum(stated, against_others), stated)
    return np.where(redundancy > 0, p, 1.0)
