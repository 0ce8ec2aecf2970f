"""The contact wrench of a log in words: how large it is, what part is motion, how it is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from tdfscal.catalogue import told
from tdfscal.catalogue.numbers import measured, when
from tdfscal.findings import Finding
from tdfscal.reporting.layout import Report, Section
from tdfscal.reporting.summaries import by_component, number, place_of
from tdfscal.reporting.traceability import certificates
from tdfscal.wrench.contact_wrench import COMPONENTS

#: Share of the noise left, from which on a filter is said to do nothing.
_IDLE = 0.95


def wrench_report(summary: dict[str, Any], findings: Sequence[Finding] = ()) -> Report:
    """Lay out the size of the wrench over all samples, with and without the calibration."""
    stops = summary["stops"]
    columns = {"rms": summary["rms"], "at stops": stops and stops["rms"],
               "uncalibrated": summary["rms_uncalibrated"], "std. unc.": summary["std"],
               "of it calibration": summary["std_calibration"]}  # fmt: skip
    given = {name: of for name, of in columns.items() if of is not None}
    shown = {name: [number(of[each]) for each in COMPONENTS] for name, of in given.items()}
    way = "without inertia" if summary["quasi_static"] else "with inertia"
    about = place_of(summary["about"])
    return Report(
        f"Contact wrench of {summary['rows']} samples",
        f"{when(summary['start'])} to {when(summary['end'])}, {way}; LCS, moments about {about}",
        claim=_filter(summary["filter"]),
        sections=(Section("", (by_component(shown), " ".join(_said(summary)))),),
        warnings=tuple(map(told, findings)),
        advice=certificates(findings),
    )


def _said(summary: dict[str, Any]) -> Iterator[str]:
    """How large the wrench is, what part is motion, how its noise is known, the zeros' age."""
    largest = summary["largest"]
    force, torque = (
        f"{measured(largest[name], 3)} {unit} at {when(largest[f'{name}_time'])}"
        for name, unit in (("force", "N"), ("torque", "N·m"))
    )
    yield f"The largest force is {force}, the largest torque {torque}."
    if summary["stops"] is not None:
        share = summary["stops"]["rows"] / summary["rows"]
        yield (
            f"{share:.0%} of the samples lie at stops (hinges below 0.2 mm/s); what is "
            "larger between the stops comes from the motion or a contact: `tdfscal validate "
            "--samples moving` tells."
        )
        if known := summary["stops"]["mean_std"]:
            sizes = (number(max(known[f"{of}{a}"] or np.inf for a in "xyz")) for of in "fm")
            yield (
                f"The mean of a stop has standard uncertainties up to {' N and '.join(sizes)} N·m: "
                "what is declared of a posture does not average out."
            )
    noise = summary["noise"] or {"dwells": 0, "windows": 0}
    known = "is as declared, for the log shows none"
    if noise["windows"]:
        known = f"was measured in {noise['windows']} short windows; slower noise is not in it"
    if noise["dwells"]:
        known = f"was measured in {noise['dwells']} static dwells of the log"
    yield f"The noise of a sample {known}."
    moved, age = summary["zeros"]["moved"], summary["zeros"]["age"]
    if moved != 0.0:
        size = "by an unknown amount" if moved is None else f"by {measured(moved)} N (std)"
        since = "are of unknown age (taken as if the log followed the calibration's at once)"
        if summary["zeros"]["age_known"]:
            order = "older" if age >= 0 else "younger"
            since = f"are {measured(abs(age) / 86400)} days {order} than the log"
        yield f"The calibration's zeros {since} and may have moved {size} by its end."


def _filter(f: dict[str, Any] | None) -> str:
    if f is None:
        return ""
    left = f["noise_left"]
    if left is None:
        return f"filter {f['kind']}: the sensors show no noise, and nothing is taken off"
    late = f"{measured(1e3 * f['delay'], 3)} ms late" if f["delay"] else "without delay"
    stays = f": noise as slow as a force that walks by {f['walk']:g} N in 1 s stays"
    said = f"leaves {100 * left:.0f} % of the sensors' noise of {measured(f['noise'], 3)} N"
    return f"filter {f['kind']}: {late}; {said}{stays if left >= _IDLE else ''}"
