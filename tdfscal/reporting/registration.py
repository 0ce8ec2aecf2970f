"""A registration of two point files, laid out and as a JSON document."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tdfscal.catalogue import documents, sentence, told
from tdfscal.findings import Finding
from tdfscal.records import ANGLES
from tdfscal.reporting.layout import Facts, Report, Section, Table, chi_squared
from tdfscal.trackercal import PointRegistration

CONVENTION = "measured = rotation · reference + translation"
SCALED = "measured = scale · rotation · reference + translation"
_ANGLES = "rotation = Rz(yaw)·Ry(pitch)·Rx(roll)"


def registration_report(r: PointRegistration) -> Report:
    """Lay out the transform with its standard uncertainties, and the residual of each point."""
    values = tuple(
        (name, f"{1e3 * value:.6f}", f"{1e3 * std:.6f}", "mrad" if name in ANGLES else "mm")
        for name, value, std in zip(
            (*ANGLES, "translation x", "translation y", "translation z"),
            (*r.rpy, *r.translation),
            (*r.rpy_std, *r.translation_std),
            strict=True,
        )
    )
    rotation = tuple(tuple(f"{v:+.12f}" for v in row) for row in r.rotation)
    residuals = tuple(
        (name, *(f"{1e3 * v:.4f}" for v in (*d, np.linalg.norm(d))))
        for name, d in zip(r.names, r.residual, strict=True)
    )
    convention = f"{SCALED if r.scaled else CONVENTION}; {_ANGLES}"
    blocks = (
        Table(convention, ("", "value", "std. unc.", "unit"), values),
        Table("Rotation, by rows", ("", "", ""), rotation, left=0),
        Table("Residuals, mm", ("point", "x", "y", "z", "length"), residuals),
        Facts(_statistics(r)),
    )
    return Report(
        title=f"{len(r.names)} points fit within {1e3 * r.rms:.3g} mm (rms)",
        sections=(Section("Transform", blocks),),
        reasons=tuple(map(told, r.findings)),  # above the numbers that they concern
    )


def _statistics(r: PointRegistration) -> tuple[tuple[str, str], ...]:
    scale = f"1 {1e6 * (r.scale - 1):+.1f} ppm, std. unc. {1e6 * r.scale_std:.1f} ppm"
    scale += "" if r.scaled else " (not applied)"
    if r.chi2 is None or r.p_value is None:
        noise = f"{1e3 * r.sigma:.3g} mm per coordinate" if r.sigma is not None else "none"
        first = ("Noise", f"{noise}, from the residuals ({r.dof} degrees of freedom)")
    else:
        first = ("Fit", chi_squared(r.chi2, r.dof, r.p_value))
    return first, ("Scale", scale)


def document(r: PointRegistration, found: Sequence[Finding] = ()) -> dict[str, Any]:
    """Return plain JSON values; m and rad."""
    return {
        "convention": SCALED if r.scaled else CONVENTION,
        "rotation": r.rotation.tolist(),
        "rpy": r.rpy.tolist(),
        "rpy_std": r.rpy_std.tolist(),
        "translation": r.translation.tolist(),
        "translation_std": r.translation_std.tolist(),
        "covariance": {
            "definition": "of (d, t) with R_true = exp([d]x) · rotation, d in the measured frame; "
            "rad, m",
            "matrix": r.covariance.tolist(),
        },
        "points": [
            {"name": name, "residual": residual.tolist()}
            for name, residual in zip(r.names, r.residual, strict=True)
        ],
        "rms": r.rms,
        "chi2": r.chi2,
        "dof": r.dof,
        "p_value": r.p_value,
        "sigma": r.sigma,
        "scale": r.scale,
        "scale_std": r.scale_std if np.isfinite(r.scale_std) else None,
        "scale_estimated": r.scaled,
        "coplanar": r.coplanar,
        "rejected": [{"name": p.name, "reason": sentence(p.finding)} for p in r.rejected],
        "missing": list(r.missing),
        "extra": list(r.extra),
        "findings": documents([*found, *r.findings]),
    }
