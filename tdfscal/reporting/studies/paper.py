"""The paper's figures and tables beside this rig's: number, standard error, like or unlike, why."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tdfscal.reporting.layout import Items, Report, Section, Table
from tdfscal.reporting.studies.cells import Row, mean_of, number, with_error
from tdfscal.studies import docking, free_space
from tdfscal.studies.accuracy import Accuracy
from tdfscal.studies.compared_calibrations import LIKE
from tdfscal.studies.docking import DockingStudy
from tdfscal.studies.free_space import FreeSpaceStudy
from tdfscal.studies.ratios import ratio
from tdfscal.studies.sensitivity import Sweep

#: A number is reproduced within this share of the paper's, and is not where it lies beyond that by
#: more than two standard errors of ours.
_CLOSE = 0.25


@dataclass(frozen=True, slots=True)
class Item:
    """One number of the paper beside ours.

    figure, quantity : where it stands, and what it is. paper : as printed; NaN where the text at
    hand has no number. here, std : ours and its standard error, NaN where there is none. unit.
    like : the same quantity of the same method under the same knowledge. bound : the paper's is a
    limit from below (">") or above ("<"). why : what the comparison rests on, or fails for.
    """

    figure: str
    quantity: str
    paper: float
    here: float
    std: float
    unit: str
    like: bool
    why: str
    bound: str = ""

    @property
    def reproduced(self) -> bool | None:
        """Whether ours is the paper's; None where nobody can tell."""
        if not self.like or np.isnan(self.paper) or np.isnan(self.here):
            return None
        if self.bound:
            return bool(self.here >= self.paper if self.bound == ">" else self.here <= self.paper)
        beyond = abs(self.here - self.paper) - _CLOSE * abs(self.paper)
        vague = 0.0 if np.isnan(self.std) else 2.0 * self.std
        return True if beyond <= 0.0 else False if beyond > vague else None


def verdict(item: Item) -> str:
    """In a word or two."""
    if item.reproduced is None:
        if not item.like:
            return "unlike"
        return "no result" if np.isnan(item.here) else "undecided"
    return "reproduced" if item.reproduced else "not reproduced"


def paper_said(item: Item) -> str:
    """The paper's number."""
    return "–" if np.isnan(item.paper) else f"{item.bound}{' ' * bool(item.bound)}{item.paper:.4g}"


def _here(item: Item) -> str:
    """Our number with its standard error."""
    return with_error(item.here, item.std)


def sentence(item: Item) -> str:
    """One sentence of an item."""
    unit = f" {item.unit}" if item.unit else ""
    return (
        f"{item.figure}, {item.quantity}: {paper_said(item)}{unit} in the paper, "
        f"{_here(item)}{unit} here; {verdict(item)}: {item.why}"
    )


_CELL = "the paper gives neither impedance nor moves, and deviations go with both"
_LINEAR = (
    "Eq. 24 takes the forces as free of noise and solves for 27 numbers instead of 9 angles; "
    "maximum likelihood of the same data stands below"
)
_ANGLES = "what zeros, mass and barycentre leave is common to all arms"


def free_space_items(study: FreeSpaceStudy) -> list[Item]:
    """Fig. 16."""
    items = []
    for quantity, (name, unit) in enumerate((("position", "mm"), ("posture", "mrad"))):
        for arm, paper in free_space.PAPER.items():
            if arm in study.names:
                lengths = study.length[study.names.index(arm), ..., quantity].mean(axis=0)
                mean, std = mean_of(1e3 * lengths)
                items.append(
                    Item("Fig. 16", f"{name}, {LIKE[arm]}", paper[quantity], mean, std, unit,
                         like=True, why=_CELL)
                )  # fmt: skip
        items += _ratios(study, "Fig. 16", name, quantity, free_space.PAPER)
    return items


def docking_items(study: DockingStudy) -> list[Item]:
    """Figs. 17 and 18: maxima as the controller sees them, which is what the paper records."""
    items = []
    if "linear" in study.names:
        c = study.names.index("linear")
        starts = study.grid(np.moveaxis(study.result.phase_start, 0, -1))[c, :, 1]
        touched = study.touched[c]
        setup = study.setup
        for name, printed, values, unit, why in (
            ("first contact", 45.0, starts[touched], "s",
             f"{1e3 * setup.gap:g} mm at {1e3 * setup.speed:g} mm/s, and the impedance's lag B/K"),
            ("largest Fz", 12.1, study.seen[c, touched, 2], "N",
             "one run there; it goes with contact stiffness and damping, which are unknown there"),
            ("largest Mx", 3.48, study.seen[c, touched, 3], "N·m",
             "one run there, and it depends on the point that moments are about"),
            ("end", 262.0, study.grid(study.result.stopped)[c, study.seated[c]], "s",
             "an engagement of 333 mm, which the stated clearance and tilt give, and the lag"),
        ):  # fmt: skip
            mean, std = mean_of(values)
            items.append(Item("Fig. 17", f"{name}, self", printed, mean, std, unit, True, why))
    for quantity, (name, unit) in enumerate((("force", "N"), ("torque", "N·m"))):
        for arm, paper in docking.PAPER.items():
            if arm not in study.names:
                continue
            c = study.names.index(arm)
            values = study.average_seen[c, study.touched[c], quantity]
            mean, std = mean_of(values)
            lost = study.arms.runs - values.size
            why = "contact stiffness, damping and survey of the paper's cell are unknown"
            if not values.size:
                why = "no run gets as far as the gears: all stop at a false force before"
            elif lost:
                why += f"; {lost} of {study.arms.runs} runs stop at a false force before the gears"
            items.append(Item("Fig. 18", f"{name}, {LIKE[arm]}", paper[quantity], mean, std, unit,
                              True, why))  # fmt: skip
        items += _ratios(study, "Fig. 18", name, quantity, docking.PAPER)
    return items


def _ratios(
    study: FreeSpaceStudy | DockingStudy,
    figure: str,
    name: str,
    quantity: int,
    paper: dict[str, tuple[float, float]],
) -> list[Item]:
    """Self over tracker: by the paper's method, which is like, and by the estimator's default."""
    if not {"linear", "self", "tracker"} <= set(study.names):
        return []
    published = paper["linear"][quantity] / paper["tracker"][quantity]
    items = []
    for arm, like, why in (
        ("linear", True, _LINEAR),
        ("self", False, f"maximum likelihood instead of Eq. 24; {_ANGLES}"),
    ):
        which = {"seen": True} if isinstance(study, DockingStudy) else {}
        found = study.ratio(quantity, arm, "tracker", **which)
        label = "self/tracker" if like else "self (ML)/tracker"
        items.append(Item(figure, f"{name}, {label}", published, found.value, found.std, "",
                          like, why))  # fmt: skip
    return items


def sensitivity_items(sweep: Sweep) -> list[Item]:
    """Fig. 4."""
    force = float(sweep.force.max())
    why = "the same equations (16–19, corrected) on a rig of stated size; Table 1 is empty"
    return [
        Item("Fig. 4", f"force at {sweep.deviation[-1]:g} rad", 80.0, force, np.nan, "N",
             True, why, ">")
    ]  # fmt: skip


def accuracy_items(study: Accuracy) -> list[Item]:
    """Figs. 7–9, 12–14, Tables 2 and 3."""
    items = []
    methods = {result.method: result for result in study.results}
    for method, figure, like in (
        ("linear", "Figs. 7–9", True), ("ml", "Figs. 7–9", False), ("tracker", "Figs. 12–14", True),
    ):  # fmt: skip
        if method in methods:
            own = methods[method]
            name = {"linear": "self", "ml": "self (ML)", "tracker": "tracker"}
            share = np.abs(own.mean) / own.std
            items.append(
                Item(figure, f"|mean| / σ, {name[method]}", 1.0,
                     float(share.max()), 1.0 / np.sqrt(len(own.error)), "", like,
                     'the paper has means "much smaller than" σ and no numbers; here '
                     f"σ is {1e3 * own.std.mean():.3g} mrad", "<")
            )  # fmt: skip
    if "tracker" in methods:
        reference = methods["tracker"]
        for method, like, why in (
            ("linear", True, _LINEAR),
            ("ml", False, "maximum likelihood instead of Eq. 24"),
        ):
            if method in methods:
                self_name = "self" if like else "self (ML)"
                a, b = (np.mean(m.error**2, axis=(1, 2)) for m in (methods[method], reference))
                size = min(len(a), len(b))
                square = ratio(a[:size], b[:size])
                value = float(np.sqrt(square.value))
                items.append(
                    Item("Table 2", f"σ, {self_name} − tracker", -30.1, 100.0 * (value - 1.0),
                         100.0 * square.std / (2.0 * value), "%", like, why)
                )  # fmt: skip
                pair = (m.error[:size] for m in (methods[method], reference))
                first, second = pair
                apart = np.abs(first - second).max(axis=(1, 2))
                mean, std = mean_of(1e3 * apart)
                items.append(
                    Item("Table 3", f"|{self_name} − tracker|", 1.0, mean,
                         std, "mrad", like, "one rig there, campaigns of many rigs here", "<")
                )  # fmt: skip
    return items


@dataclass(frozen=True, slots=True)
class Paper:
    """The paper's numbers beside a rig's; runs : in Sect. 5, campaigns : in Sect. 4."""

    rig: str
    seed: int
    runs: int
    campaigns: int
    items: tuple[Item, ...]


def report(paper: Paper) -> Report:
    """One table, paper against here, and the verdict of each line with its reason."""
    items = paper.items
    reasons = list(dict.fromkeys(i.why for i in items))
    short = {"reproduced": "yes", "not reproduced": "no"}
    rows = tuple(
        (i.figure, i.quantity + (f", {i.unit}" if i.unit else ""), paper_said(i), _here(i),
         short.get(verdict(i), verdict(i)), str(reasons.index(i.why) + 1))
        for i in items
    )  # fmt: skip
    counted = [i.reproduced for i in items]
    held, failed = counted.count(True), counted.count(False)
    blocks = (
        f"{held} numbers are reproduced (within {100 * _CLOSE:g} % of the paper's, or within its "
        f"bound), {failed} are not (beyond that by more than two standard errors of ours). Unlike: "
        "of another method or with other knowledge than the paper's.",
        Table("Paper against here, ± standard error",
              ("where", "what", "paper", "here", "reproduced", "why"), rows, left=2),
        Items("Why", tuple(f"{k + 1}: {why}" for k, why in enumerate(reasons))),
    )  # fmt: skip
    return Report(
        title=f"The paper's figures and tables: {paper.rig}",
        subtitle=f"{paper.campaigns} campaigns for Sect. 4, {paper.runs} runs for Sect. 5",
        sections=(Section("Paper against here", blocks),),
    )


def document(paper: Paper, files: list[str]) -> dict[str, Any]:
    """The comparison as plain JSON values."""
    return {
        "format": "tdfscal-study-paper/1",
        "rig": paper.rig,
        "seed": paper.seed,
        "runs": paper.runs,
        "campaigns": paper.campaigns,
        "items": list(_rows(paper)),
        "files": files,
    }


def tables(paper: Paper) -> dict[str, Iterable[Row]]:
    """One row per number of the paper."""
    return {"paper.csv": _rows(paper)}


def _rows(paper: Paper) -> Iterator[Row]:
    for item in paper.items:
        yield {
            "figure": item.figure,
            "quantity": item.quantity,
            "unit": item.unit,
            "bound": item.bound,
            "paper": number(item.paper),
            "here": number(item.here),
            "standard_error": number(item.std),
            "like": "like" if item.like else "unlike",
            "verdict": verdict(item),
            "why": item.why,
        }
