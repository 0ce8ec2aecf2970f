"""Simulated months of a rig: a campaign folder each, and what happened between them."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from tdfscal.errors import UsageError
from tdfscal.files.writers import documents
from tdfscal.files.writers.campaign import LogFormat, write_campaign
from tdfscal.simulation.months import Months


def write_months(
    played: Months, folder: Path, *, format: LogFormat, seed: int, overwrite: bool = False
) -> None:
    """Write `<date>/` with rig.yaml, log and truth.yaml per campaign, and truth.yaml of all.

    Nothing appears before all of it is written. With overwrite, folders of the same dates are
    replaced and others left alone. Raises UsageError where it cannot be written.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        try:
            for date, campaign in zip(played.dates, played.campaigns, strict=True):
                story = {"name": "months", "seed": seed}
                write_campaign(campaign, beside / date[:7], format=format, scenario=story)
            documents.write_yaml(beside / "truth.yaml", _story(played, seed))
            folder.mkdir(exist_ok=True)
            for made in beside.iterdir():
                target = folder / made.name
                if overwrite and target.is_dir():
                    shutil.rmtree(target)
                made.replace(target)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    except OSError as error:
        raise UsageError(
            f"the campaigns cannot be written ({error.strerror or error})", where=str(folder)
        ) from error


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
