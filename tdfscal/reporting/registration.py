"""A registration of two point files, as text and as a JSON document."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tdfscal.reporting.text import table, wrapped
from tdfscal.trackercal import PointRegistration

CONVENTION = "measured = rotation · reference + translation"


def render(r: PointRegistration) -> str:
    """Transform with its standard uncertainties, residual of each point, warnings."""
    lines = [
        f"{len(r.names)} points fit within {1e3 * r.rms:.3g} mm (rms)",
        "",
        CONVENTION,
        "rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
    ]
    rows = [
        (name, f"{1e3 * value:.6f}", f"{1e3 * std:.6f}", "mrad")
        for name, value, std in zip(("roll", "pitch", "yaw"), r.rpy, r.rpy_std, strict=True)
    ]
    rows += [
        (name, f"{1e3 * value:.6f}", f"{1e3 * std:.6f}", "mm")
        for name, value, std in zip(
            ("translation x", "translation y", "translation z"),
            r.translation,
            r.translation_std,
            strict=True,
        )
    ]
    lines += table(["", "value", "std. unc.", "unit"], rows)
    lines += [
        "",
        "Rotation, by rows",
        *("  " + "  ".join(f"{v:+.12f}" for v in row) for row in r.rotation),
    ]
    lines += ["", "Residuals, mm (x, y, z, length)"]
    lines += table(
        ["point", "x", "y", "z", "length"],
        [
            (name, *(f"{1e3 * v:.4f}" for v in d), f"{1e3 * np.linalg.norm(d):.4f}")
            for name, d in zip(r.names, r.residual, strict=True)
        ],
    )
    lines += ["", *_statistics(r)]
    if r.warnings:
        lines += ["", "Warnings", *(line for w in r.warnings for line in wrapped(f"- {w}"))]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _statistics(r: PointRegistration) -> list[str]:
    scale = f"Scale     1 {1e6 * (r.scale - 1):+.1f} ppm, std. unc. {1e6 * r.scale_std:.1f} ppm"
    if r.chi2 is None or r.p_value is None:
        noise = f"{1e3 * r.sigma:.3g} mm per coordinate" if r.sigma is not None else "none"
        return [f"Noise     {noise}, from the residuals ({r.dof} degrees of freedom)", scale]
    fit = f"Fit       χ² = {r.chi2:.4g} for {r.dof} degrees of freedom, p = {r.p_value:.2g}"
    return [fit, scale]


def document(r: PointRegistration, notes: Sequence[str] = ()) -> dict[str, Any]:
    """Return plain JSON values; m and rad."""
    return {
        "convention": CONVENTION,
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
        "scale_std": _finite(r.scale_std),
        "coplanar": r.coplanar,
        "rejected": [{"name": p.name, "reason": p.reason} for p in r.rejected],
        "missing": list(r.missing),
        "extra": list(r.extra),
        "warnings": [*notes, *r.warnings],
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
