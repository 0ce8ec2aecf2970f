"""Simulated months of a rig: a campaign folder each, and what happened between them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tdfscal.files.outputs import make_folder, together
from tdfscal.files.writers import documents
from tdfscal.files.writers.campaign import LogFormat, write_campaign
from tdfscal.simulation.months import Months


def write_months(
    played: Months, folder: Path, *, format: LogFormat, seed: int, overwrite: bool = False
) -> None:
    """Write `<date>/` with rig.yaml, log and truth.yaml per campaign, and truth.yaml of all.

    Nothing appears before all of it is written. With overwrite, what `simulate` wrote for the same
    dates is replaced. Raises UsageError where it cannot be written.
    """
    with together():
        make_folder(folder)
        for date, campaign in zip(played.dates, played.campaigns, strict=True):
            story = {"name": "months", "seed": seed}
            place = folder / date[:7]
            write_campaign(campaign, place, format=format, scenario=story, overwrite=overwrite)
        documents.write_yaml(folder / "truth.yaml", _story(played, seed))


def _story(played: Months, seed: int) -> dict[str, Any]:
    rig = played.campaigns[0].rig
    return {
        "format": "tdfscal-truth/1",
        "scenario": {"name": "months", "seed": seed},
        "walk": rig.drift.angle,
        "campaigns": [date[:7] for date in played.dates],
        "steps": [
            {
                "campaign": played.dates[step.month][:7],
                "support": rig.supports[step.sensor],
                "turn": list(step.turn),
            }
            for step in played.steps
        ],
    }
