"""The summary of applied contact wrenches in words."""

from __future__ import annotations

from typing import Any

from tdfscal.reporting.layout import Block, Report, Section, Table
from tdfscal.wrench.contact_wrench import COMPONENTS

#: Units of time, s, from where they are used.
_UNITS = ((86400.0, "days"), (3600.0, "h"), (60.0, "min"))
#: Share of the noise from which on a filter is said to do nothing.
_IDLE = 0.95


def summary_report(summary: dict[str, Any]) -> Report:
    """Size of the wrench over all samples, with and without the calibration."""
    columns = {"rms": "rms", "at stops": "stops", "uncalibrated": "rms_uncalibrated",
               "std. unc.": "std", "of it calibration": "std_calibration"}  # fmt: skip
    stops = summary["stops"]
    parts = {column: summary[column] for column in columns.values() if column != "stops"}
    if stops is None:
        del columns["at stops"]
    else:
        parts["stops"] = stops["rms"]
    rows = tuple(
        (
            name,
            "N" if name.startswith("f") else "N·m",
            *(_number(parts[column][name], ".3g") for column in columns.values()),
        )
        for name in COMPONENTS
    )
    header = ("", "", *columns)
    largest, point = summary["largest"], summary["about"]
    blocks: tuple[Block, ...] = (
        Table("", header, rows, left=2),
        *_stops(summary),
        _noise(summary["noise"]),
        *_zeros(summary["zeros"]),
        f"largest: force {largest['force']:.3g} N, torque {largest['torque']:.3g} N·m",
    )
    way = "quasi-static" if summary["quasi_static"] else "with inertia"
    place = f"({', '.join(f'{x:g}' for x in point)}) m" if any(point) else "its origin"
    return Report(
        f"Contact wrench of {summary['rows']} samples",
        f"{summary['start']:.6g} to {summary['end']:.6g} s, {way}; LCS, moments about {place}",
        claim=_filter(summary["filter"]),
        sections=(Section("", blocks),),
    )


def _stops(summary: dict[str, Any]) -> tuple[str, ...]:
    """What part of a free wrench is motion."""
    if summary["stops"] is None:
        return ()
    share = summary["stops"]["rows"] / summary["rows"]
    return (
        f"{share:.0%} of the samples lie at stops (hinges below 0.2 mm/s). Where nothing touches, "
        "what the wrench has more between them is the motion's.",
    )


def _filter(f: dict[str, Any] | None) -> str:
    if f is None:
        return ""
    left = f["noise_left"]
    if left is None:
        return f"filter {f['kind']}: the sensors show no noise, and nothing is taken off"
    late = f"{1e3 * f['delay']:.3g} ms late" if f["delay"] else "without delay"
    told = f"filter {f['kind']}: {late}; leaves {100 * left:.0f} % of the sensors' noise of "
    told += f"{f['noise']:.3g} N"
    if left < _IDLE:
        return told
    return (
        f"{told}: it does next to nothing, since the noise is as slow as a force that walks by "
        f"{f['walk']:g} N in 1 s"
    )


def _noise(noise: dict[str, Any] | None) -> str:
    if noise is not None and None in noise["std"].values():
        return "noise of a sample: unknown, for so few samples do not show it; nor is u_ known"
    if noise is None or not (noise["dwells"] or noise["windows"]):
        return "noise of a sample: as declared; the log shows none"
    if noise["dwells"]:
        return f"noise of a sample: measured in {noise['dwells']} static dwells of the log"
    return (
        f"noise of a sample: measured in {noise['windows']} short windows, for the beginning of "
        "the log holds no static dwell; slower noise is not in it"
    )


def _zeros(zeros: dict[str, Any]) -> tuple[str, ...]:
    moved = zeros["moved"]
    if moved == 0.0:
        return ()
    size = "by an unknown amount" if moved is None else f"by {moved:.2g} N (std)"
    since = f"held {_span(zeros['age'])} the log began, and"
    if not zeros["age_known"]:
        since = "are of unknown age, here as if the log followed the calibration's, and"
    return (f"the calibration's zeros {since} may have moved {size} by its end",)


def _span(seconds: float) -> str:
    size, unit = next(((size, unit) for size, unit in _UNITS if abs(seconds) >= size), (1.0, "s"))
    return f"{abs(seconds) / size:.2g} {unit} {'before' if seconds >= 0 else 'after'}"


def _number(value: float | None, form: str) -> str:
    return "unknown" if value is None else format(value, form)
