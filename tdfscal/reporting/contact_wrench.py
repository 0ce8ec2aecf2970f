"""The summary of applied contact wrenches in words."""

from __future__ import annotations

from typing import Any

from tdfscal.reporting.layout import Report, Section, Table
from tdfscal.wrench.contact_wrench import COMPONENTS


def summary_report(summary: dict[str, Any]) -> Report:
    """Size of the wrench over all samples, with and without the calibration."""
    way = "quasi-static" if summary["quasi_static"] else "with inertia"
    rows = tuple(
        (
            name,
            "N" if name.startswith("f") else "N·m",
            _number(summary["rms"][name], ".3g"),
            _number(summary["rms_uncalibrated"][name], ".3g"),
            _number(summary["std"][name], ".2g"),
        )
        for name in COMPONENTS
    )
    table = Table("", ("", "", "rms", "rms uncalibrated", "std. unc."), rows, left=2)
    largest = summary["largest"]
    return Report(
        f"Contact wrench of {summary['rows']} samples",
        f"{summary['start']:.6g} to {summary['end']:.6g} s, {way}; LCS, moments about its origin",
        claim=_filter(summary["filter"]),
        sections=(
            Section(
                "",
                (
                    table,
                    f"largest: force {largest['force']:.3g} N, torque {largest['torque']:.3g} N·m",
                ),
            ),
        ),
    )


def _filter(f: dict[str, Any] | None) -> str:
    if f is None:
        return ""
    late = f"{1e3 * f['delay']:.3g} ms late" if f["delay"] else "without delay"
    return (
        f"filter {f['kind']}: {late}; leaves {100 * f['noise_left']:.0f} % of the sensors' "
        f"noise of {f['noise']:.3g} N"
    )


def _number(value: float | None, form: str) -> str:
    return "unknown" if value is None else format(value, form)
