"""What given calibrations are worth, beside the studies: in words, plain rows and JSON values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting import layout
from tdfscal.reporting.layout import Table
from tdfscal.reporting.studies import CASE, Row, posture_name
from tdfscal.studies.accuracy import Accuracy
from tdfscal.studies.wrench_error import Stake

Stakes = Mapping[str, list[Stake]]
"""Name of a calibration → its stakes, one per posture and internal force."""


def stakes_tables(supports: tuple[str, ...], stakes: Stakes) -> tuple[Table, ...]:
    """Error without each calibration and with it, and the angle that matters most."""
    header = ("terminal", "internal, N", "N before", "after", "N·m before", "after",
              "dominant contribution")  # fmt: skip
    return tuple(
        Table(
            f"{name}: error of the contact wrench that its angles take away, and the standard "
            "uncertainty that they leave",
            header,
            tuple(_row(supports, stake) for stake in found),
        )
        for name, found in stakes.items()
    )


def _row(supports: tuple[str, ...], stake: Stake) -> layout.Row:
    i, j = divmod(int(stake.force.argmax()), 3)
    return (
        posture_name(stake.rpy),
        f"{stake.internal:g}",
        *(f"{side[k]:.2f}" for k in (0, 1) for side in (stake.before, stake.after)),
        f"{ANGLES[j]} of {supports[i]}",
    )


def stake_rows(supports: tuple[str, ...], stakes: Stakes) -> Iterator[Row]:
    """Header and rows of calibrations.csv: what each angle's uncertainty costs by itself."""
    yield (
        "calibration",
        *CASE,
        "from_nominal_rad",
        "std_rad",
        "force_N",
        "torque_Nm",
    )
    for name, found in stakes.items():
        for stake in found:
            for i, support in enumerate(supports):
                for j, angle in enumerate(ANGLES):
                    numbers = (stake.off, stake.std, stake.force, stake.torque)
                    yield (
                        name,
                        *stake.rpy.tolist(),
                        stake.internal,
                        support,
                        angle,
                        *(float(values[i, j]) for values in numbers),
                    )


def stakes_document(stakes: Stakes) -> list[dict[str, Any]]:
    """The stakes as plain JSON values, SI units."""
    return [
        {
            "name": name,
            "postures": [
                {
                    "rpy": stake.rpy.tolist(),
                    "internal": stake.internal,
                    "uncalibrated": {"force": stake.before[0], "torque": stake.before[1]},
                    "calibrated_std": {"force": stake.after[0], "torque": stake.after[1]},
                }
                for stake in found
            ],
        }
        for name, found in stakes.items()
    ]


def stated_against(study: Accuracy, stated: Mapping[str, FloatArray]) -> list[str]:
    """How far each calibration, by its stated (n, 3) in rad, is from what this rig allows."""
    best = study.ranking[0]
    reached = float(best.rms.mean())
    sentences = []
    for name, std in stated.items():
        mean = float(std.mean())
        text = f"{name} states {1e3 * mean:.3g} mrad for an angle in the mean: "
        if mean > 1.1 * reached:
            text += f"{mean / reached:.3g} times what {best.name} reaches here"
        else:
            text += f"as good as {best.name} gets here ({1e3 * reached:.3g} mrad)"
        sentences.append(text)
    return sentences


def stated_document(study: Accuracy, stated: Mapping[str, FloatArray]) -> list[dict[str, Any]]:
    """The same as plain JSON values, SI units."""
    reached = float(study.ranking[0].rms.mean())
    return [
        {"name": name, "rpy_std": std.tolist(), "factor": float(std.mean() / reached)}
        for name, std in stated.items()
    ]
