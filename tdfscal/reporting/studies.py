"""Studies in words, tables and plain rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.layout import Block, Items, Report, Section, Table
from tdfscal.studies.accuracy import Accuracy, MethodResult, angle_names
from tdfscal.studies.sensitivity import Sweep

SHORT = {"ml": "self, ML", "linear": "self, linear", "tracker": "tracker"}
COLUMN = {"ml": "ML", "linear": "linear", "tracker": "tracker"}

Row = tuple[str | float | int, ...]
CASE = ("posture_roll", "posture_pitch", "posture_yaw", "internal_N", "support", "angle")
"""First columns of a table: which posture, internal forces and installation angle a row is of."""


def posture_name(rpy: FloatArray) -> str:
    """The terminal's posture (3,), rad, in words."""
    if not np.any(rpy):
        return "aligned"
    return "roll, pitch, yaw " + ", ".join(f"{v:g}" for v in rpy) + " rad"


def forces_name(internal: float) -> str:
    """Internal forces, N, in words."""
    return f"internal forces of {internal:g} N" if internal else "no internal forces"


def sensitivity_report(
    supports: tuple[str, ...], sweeps: list[Sweep], stakes: Sequence[Block] = ()
) -> Report:
    """Lay out the largest error of each sweep; stakes : what given calibrations are worth."""
    span = sweeps[0].deviation[-1]
    tables = tuple(
        Table(
            f"Error of the contact wrench with one angle of one sensor off by ±{span:g} rad, "
            f"{posture_name(sweep.rpy)}, {forces_name(sweep.internal)}",
            ("sensor", "angle", "force, N", "torque, N·m"),
            tuple(
                (name, ANGLES[j], f"{sweep.force[i, j].max():.2f}",
                 f"{sweep.torque[i, j].max():.2f}")
                for i, name in enumerate(supports)
                for j in range(3)
            ),
            left=2,
        )
        for sweep in sweeps
    )  # fmt: skip
    return Report("Sensitivity", sections=(Section("Sensitivity", (*tables, *stakes)),))


def sensitivity_rows(supports: tuple[str, ...], sweeps: list[Sweep]) -> Iterator[Row]:
    """Header and rows of sensitivity.csv."""
    yield (
        *CASE,
        "deviation_rad",
        "force_error_N",
        "torque_error_Nm",
    )
    for sweep in sweeps:
        for i, name in enumerate(supports):
            for j, angle in enumerate(ANGLES):
                for d, f, m in zip(
                    sweep.deviation, sweep.force[i, j], sweep.torque[i, j], strict=True
                ):
                    yield (
                        *sweep.rpy.tolist(),
                        sweep.internal,
                        name,
                        angle,
                        float(d),
                        float(f),
                        float(m),
                    )


def sensitivity_document(
    rig_name: str, supports: tuple[str, ...], sweeps: list[Sweep], files: list[str]
) -> dict[str, Any]:
    """The study as plain JSON values, SI units."""
    return {
        "format": "tdfscal-study-sensitivity/1",
        "rig": rig_name,
        "span": float(sweeps[0].deviation[-1]),
        "sweeps": [
            {
                "rpy": sweep.rpy.tolist(),
                "internal": sweep.internal,
                "supports": [
                    {
                        "name": name,
                        "force_error": sweep.force[i].max(axis=1).tolist(),
                        "torque_error": sweep.torque[i].max(axis=1).tolist(),
                    }
                    for i, name in enumerate(supports)
                ],
            }
            for sweep in sweeps
        ],
        "files": files,
    }


def accuracy_report(study: Accuracy, stated: Sequence[str] = ()) -> Report:
    """Lay out Table 2 of this rig; stated : how given calibrations compare, in sentences."""
    rig, options, survey = study.setup.rig, study.setup.options, study.setup.survey
    header = ["sensor", "angle"]
    for result in study.results:
        header += [f"{COLUMN[result.method]} mean", "std"]
    rows = []
    for i, j, name, angle in angle_names(rig):
        row = [name, angle]
        for result in study.results:
            row += [f"{1e3 * result.mean[i, j]:.4f}", f"{1e3 * result.std[i, j]:.4f}"]
        rows.append(tuple(row))
    left_out = (f"{SHORT[name]} is left out: {why}" for name, why in study.left_out.items())
    caption = "Error of the installation angles, mrad: mean and standard deviation"
    blocks = (
        Table(caption, tuple(header), tuple(rows), left=2),
        Items(study.verdict, (*map(_judged, study.results), *left_out, *stated)),
    )
    return Report(
        title=f"Accuracy of {rig.name}",
        subtitle=f"{study.setup.runs} simulated campaigns of {len(study.command)} postures, tilt "
        f"{np.rad2deg(options.tilt):g}°, internal forces {options.squeeze:g} N; tracker "
        f"{survey.distance:g} m away, {len(survey.targets)} targets per sensor",
        sections=(Section("Accuracy", blocks),),
    )


def _judged(result: MethodResult) -> str:
    """Bias and honesty of one method."""
    worst = float(np.abs(result.bias).max())
    text = f"{result.name}: " + ("unbiased" if result.unbiased else "biased")
    text += f", the largest mean is {worst:.1f} standard errors"
    if result.stated is not None:
        ratio = result.std / result.stated
        text += f"; scatter is {ratio.min():.2f} to {ratio.max():.2f} times the stated"
    if result.failed:
        text += f"; no result in {result.failed} campaigns"
    return text


def accuracy_rows(study: Accuracy) -> Iterator[Row]:
    """Header and rows of accuracy.csv: Table 2."""
    yield (
        "method",
        "support",
        "angle",
        "runs",
        "failed",
        "mean_rad",
        "std_rad",
        "rms_rad",
        "standard_error_rad",
        "mean_in_standard_errors",
        "stated_std_rad",
    )
    for result in study.results:
        runs = len(result.error)
        for i, j, name, angle in angle_names(study.setup.rig):
            std = float(result.std[i, j])
            yield (
                result.method,
                name,
                angle,
                runs,
                result.failed,
                float(result.mean[i, j]),
                std,
                float(result.rms[i, j]),
                std / runs**0.5,
                float(result.bias[i, j]),
                "" if result.stated is None else float(result.stated[i, j]),
            )


def histogram_rows(study: Accuracy) -> Iterator[Row]:
    """Header and rows of histograms.csv: Figs. 7–9 and 12–14 as numbers."""
    yield "method", "support", "angle", "low_rad", "high_rad", "count"
    for result in study.results:
        for i, j, name, angle in angle_names(study.setup.rig):
            counts, edges = result.histogram(i, j)
            for b in range(len(counts)):
                yield (
                    result.method,
                    name,
                    angle,
                    float(edges[b]),
                    float(edges[b + 1]),
                    int(counts[b]),
                )


def error_rows(study: Accuracy) -> Iterator[Row]:
    """Header and rows of errors.csv: every campaign."""
    names = [f"{name}.{angle}" for _, _, name, angle in angle_names(study.setup.rig)]
    yield ("method", "run", *names)
    for result in study.results:
        for run, row in enumerate(result.error.reshape(len(result.error), -1).tolist()):
            yield (result.method, run, *row)


def accuracy_document(study: Accuracy, files: list[str]) -> dict[str, Any]:
    """The study as plain JSON values, SI units."""
    rig = study.setup.rig
    best = study.ranking[0]
    return {
        "format": "tdfscal-study-accuracy/1",
        "rig": rig.name,
        "runs": study.setup.runs,
        "seed": study.setup.seed,
        "postures": len(study.command),
        "methods": [
            {
                "method": result.method,
                "name": result.name,
                "failed": result.failed,
                "unbiased": result.unbiased,
                "mean_rms": float(result.rms.mean()),
                "factor": float(result.rms.mean() / best.rms.mean()),
                "supports": [
                    {
                        "name": name,
                        "mean": result.mean[i].tolist(),
                        "std": result.std[i].tolist(),
                        "stated_std": None if result.stated is None else result.stated[i].tolist(),
                    }
                    for i, name in enumerate(rig.supports)
                ],
            }
            for result in study.results
        ],
        "left_out": study.left_out,
        "best": best.method,
        "verdict": study.verdict,
        "files": files,
    }
