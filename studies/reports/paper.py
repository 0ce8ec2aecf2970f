"""The paper's figures and tables beside this rig's: number, standard error, like or unlike, why."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from studies.reports.cells import Row, mean_of, number, with_error
from studies.runs import docking, free_space
from studies.runs.accuracy import Accuracy
from studies.runs.compared_calibrations import LIKE
from studies.runs.docking import DockingStudy
from studies.runs.free_space import FreeSpaceStudy
from studies.runs.ratios import ratio
from studies.runs.sensitivity import Sweep
from tdfscal.reporting.layout import Items, Report, Section, Table

#: A number is reproduced within this share of the paper's, and is not where it lies beyond that by
#: more than two standard errors of ours.
_CLOSE = 0.25


@dataclass(frozen=True, slots=True)
class Item:
    """One number of the paper beside ours.

    figure, quantity : where it stands, and what it is. paper : as printed. here, std : ours and its
    standard error, NaN where there is none. unit. like : the same quantity of the same method under
    the same knowledge. why : what the comparison rests on, or fails for. bound : the paper's is a
    limit from below (">") or above ("<").
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
    def verdict(self) -> str:
        """Whether ours is the paper's, in a word or two."""
        if not self.like:
            return "unlike"
        if np.isnan(self.here):
            return "no result"
        beyond = abs(self.here - self.paper) - _CLOSE * abs(self.paper)
        if self.bound:
            beyond = self.paper - self.here if self.bound == ">" else self.here - self.paper
        if beyond <= 0.0:
            return "reproduced"
        vague = 0.0 if self.bound or np.isnan(self.std) else 2.0 * self.std
        return "not reproduced" if beyond > vague else "undecided"

    @property
    def numbers(self) -> tuple[str, str]:
        """The paper's number, and ours with its standard error."""
        printed = f"{self.bound} {self.paper:.4g}".strip()
        return printed, with_error(self.here, self.std)


@dataclass(frozen=True, slots=True)
class Pair:
    """Two quantities of the controlled rig that stand side by side, beside the paper's numbers.

    first : place of the first among the study's quantities. paper : arm → numbers in these units.
    scale : of the units against SI. form : of the paper's numbers.
    """

    names: tuple[str, str]
    units: tuple[str, str]
    first: int = 0
    paper: dict[str, tuple[float, float]] = field(default_factory=dict)
    scale: float = 1.0
    form: str = ".2f"


POSE = Pair(("position", "posture"), ("mm", "mrad"), 0, free_space.PAPER, 1e3, ".3f")
TRUE = Pair(("force", "torque"), ("N", "N·m"))
SEEN = Pair(("force", "torque"), ("N", "N·m"), 2, docking.PAPER)


def sentence(item: Item) -> str:
    """One sentence of an item."""
    paper, here = (f"{number} {item.unit}".rstrip() for number in item.numbers)
    return (
        f"{item.figure}, {item.quantity}: {paper} in the paper, {here} here; {item.verdict}: "
        f"{item.why}"
    )


_CELL = "the paper gives neither impedance nor moves, and deviations go with both"
_LINEAR = (
    "Eq. 24 takes the forces as free of noise and solves for 27 numbers instead of 9 angles; "
    "maximum likelihood of the same data stands below"
)
_ML = "maximum likelihood instead of Eq. 24"
_ANGLES = "what zeros, mass and barycentre leave is common to all arms"


def free_space_items(study: FreeSpaceStudy) -> list[Item]:
    """Fig. 16."""
    why = dict.fromkeys(study.names, _CELL)
    return _pair_items(study, "Fig. 16", POSE, why)


def docking_items(study: DockingStudy) -> list[Item]:
    """Figs. 17 and 18: maxima as the controller sees them, which is what the paper records."""
    items = []
    if "linear" in study.names:
        c, setup = study.names.index("linear"), study.setup
        touched, seen = study.touched[c], study.seen[c]
        for name, printed, values, unit, why in (
            ("first contact", 45.0, study.starts[c, touched, 1], "s",
             f"{1e3 * setup.gap:g} mm at {1e3 * setup.speed:g} mm/s, and the impedance's lag B/K"),
            ("largest Fz", 12.1, seen[touched, 2], "N",
             "one run there; it goes with contact stiffness and damping, which are unknown there"),
            ("largest Mx", 3.48, seen[touched, 3], "N·m",
             "one run there, and it depends on the point that moments are about"),
            ("end", 262.0, study.grid(study.result.stopped)[c, study.seated[c]], "s",
             "an engagement of 333 mm, which the stated clearance and tilt give, and the lag"),
        ):  # fmt: skip
            here = mean_of(values)
            items.append(Item("Fig. 17", f"{name}, self", printed, *here, unit, True, why))
    runs, reasons = study.arms.runs, {}
    for name in study.names:
        met = study.values(name, 0).size
        why = "contact stiffness, damping and survey of the paper's cell are unknown"
        if not met:
            why = "no run gets as far as the gears: all stop at a false force before"
        elif met < runs:
            why += f"; {runs - met} of {runs} runs stop at a false force before the gears"
        reasons[name] = why
    return items + _pair_items(study, "Fig. 18", SEEN, reasons)


def _pair_items(
    study: FreeSpaceStudy | DockingStudy, figure: str, pair: Pair, why: dict[str, str]
) -> list[Item]:
    """Both quantities of each calibration, and self over tracker: by the paper's method, which is
    like, and by the estimator's default.
    """
    items = []
    for k, (name, unit) in enumerate(zip(pair.names, pair.units, strict=True)):
        for arm, paper in pair.paper.items():
            if arm in study.names:
                here = mean_of(pair.scale * study.values(arm, pair.first + k))
                quantity = f"{name}, {LIKE[arm]}"
                items.append(Item(figure, quantity, paper[k], *here, unit, True, why[arm]))
        if not {"linear", "self", "tracker"} <= set(study.names):
            continue
        published = pair.paper["linear"][k] / pair.paper["tracker"][k]
        for arm, label, like, reason in (
            ("linear", "self/tracker", True, _LINEAR),
            ("self", "self (ML)/tracker", False, f"{_ML}; {_ANGLES}"),
        ):
            found = study.ratio(pair.first + k, arm, "tracker")
            quantity = f"{name}, {label}"
            items.append(
                Item(figure, quantity, published, found.value, found.std, "", like, reason)
            )
    return items


def sensitivity_items(sweep: Sweep) -> list[Item]:
    """Fig. 4."""
    force, quantity = float(sweep.force.max()), f"force at {sweep.deviation[-1]:g} rad"
    why = "the same equations (16–19, corrected) on a rig of stated size; Table 1 is empty"
    return [Item("Fig. 4", quantity, 80.0, force, np.nan, "N", True, why, ">")]


def accuracy_items(study: Accuracy) -> list[Item]:
    """Figs. 7–9, 12–14, Tables 2 and 3."""
    items = []
    methods = {result.method: result for result in study.results}
    names = {"linear": "self", "ml": "self (ML)", "tracker": "tracker"}
    for method, name in names.items():
        if method in methods:
            own = methods[method]
            share = float((np.abs(own.mean) / own.std).max())
            why = (
                'the paper has means "much smaller than" σ and no numbers; here '
                f"σ is {1e3 * own.std.mean():.3g} mrad"
            )
            figure = "Figs. 12–14" if method == "tracker" else "Figs. 7–9"
            error = 1.0 / np.sqrt(len(own.error))
            quantity = f"|mean| / σ, {name}"
            items.append(Item(figure, quantity, 1.0, share, error, "", method != "ml", why, "<"))
    if "tracker" not in methods:
        return items
    for method, why in (("linear", _LINEAR), ("ml", _ML)):
        if method in methods:
            pair = methods[method].error, methods["tracker"].error
            first, second = (error[: min(map(len, pair))] for error in pair)
            square = ratio(*(np.mean(error**2, axis=(1, 2)) for error in (first, second)))
            value = float(np.sqrt(square.value))
            here = 100.0 * (value - 1.0), 100.0 * square.std / (2.0 * value)
            quantity, like = f"σ, {names[method]} − tracker", method == "linear"
            items.append(Item("Table 2", quantity, -30.1, *here, "%", like, why))
            apart = mean_of(1e3 * np.abs(first - second).max(axis=(1, 2)))
            quantity = f"|{names[method]} − tracker|"
            rigs = "one rig there, campaigns of many rigs here"
            items.append(Item("Table 3", quantity, 1.0, *apart, "mrad", like, rigs, "<"))
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
    verdicts = [i.verdict for i in items]
    held, failed = verdicts.count("reproduced"), verdicts.count("not reproduced")
    short = {"reproduced": "yes", "not reproduced": "no"}
    rows = tuple(
        (i.figure, f"{i.quantity}, {i.unit}".removesuffix(", "), *i.numbers,
         short.get(i.verdict, i.verdict), str(reasons.index(i.why) + 1))
        for i in items
    )  # fmt: skip
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


def document(paper: Paper) -> dict[str, Any]:
    """The comparison as plain JSON values."""
    return {
        "rig": paper.rig,
        "seed": paper.seed,
        "runs": paper.runs,
        "campaigns": paper.campaigns,
        "items": list(_rows(paper)),
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
            "paper": item.paper,
            "here": number(item.here),
            "standard_error": number(item.std),
            "like": "like" if item.like else "unlike",
            "verdict": item.verdict,
            "why": item.why,
        }
