"""Tables of `benchmarks.mutation`: by group, by module, and each survivor with its reason."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy import stats

HERE = Path(__file__).resolve().parent
Row = dict[str, Any]

INTRODUCTION = """# Mutants, and whether tests of results notice them

    python -m benchmarks.mutation --sample 60 --seed 2
    python -m benchmarks.mutation --sample 60 --seed 3 --groups estimator gate
    python -m benchmarks.mutation --again
    python -m benchmarks.mutation --tables mutation.jsonl

One operator, number, argument, assignment or branch of a function is changed (mutmut's operators),
and the tests of the module's own room run to the first that fails (`GROUPS` in `mutation.py` names
them). Drawn at random from all changes of the group with a fixed seed, 60 a group or more. Not
counted: changes of words (texts, what an error says), of `strict` in `zip`, and what mutmut leaves
alone: properties, module constants, default arguments that are no literals.

The draws are others than the one that tests had been written for (seed 1, 90 a group: a sixth of
the gate's and a quarter of the file checks' mutants are in both, of the others fewer); seed 3, of
the estimator and the gate alone, came after tests for the survivors of seed 2. `Killed at first` is
what the tests did when a draw was first run; the share of those that are not equivalent has its
95 % interval, Clopper and Pearson. For what survived then, tests of results were written since, or
needless code was deleted (`killed now`; of that share no interval can be told). Equivalent: no
result that anyone can see changes. Each survivor stands below with its reason.
"""


@dataclass(frozen=True)
class Count:
    """Verdicts of some mutants."""

    drawn: int
    first: int
    killed: int
    equivalent: int
    survived: int

    @property
    def share(self) -> str:
        """Killed at first of those that are not equivalent, with its interval."""
        n = self.drawn - self.equivalent
        if not n:
            return "–"
        interval = stats.binomtest(self.first, n).proportion_ci(0.95)
        return f"{self.first / n:.1%} ({interval.low:.0%} – {interval.high:.0%})"


def reasons() -> list[dict[str, str]]:
    """Changes that were judged, with the piece of the new line that tells them apart."""
    text = (HERE / "mutation_survivors.toml").read_text(encoding="utf-8")
    return list(tomllib.loads(text)["judged"])


def judged(row: Row, known: Iterable[dict[str, str]]) -> tuple[str, str]:
    """Kind of a survivor, `equivalent` or `left`, and the reason."""
    new = [line for line in row["change"].splitlines() if line.startswith("+")]
    for one in known:
        here = (one["module"], one["function"]) == (row["module"], row["function"])
        if here and any(one["new"] in line for line in new):
            return one["kind"], one["reason"]
    return "left", "not judged"


def survivor(row: Row) -> bool:
    return row["verdict"] in ("survived", "no test")


def key(row: Row) -> tuple[str, str, str]:
    return row["module"], row["function"], row["change"]


def latest(rows: Iterable[Row]) -> list[Row]:
    """Each mutant once, with its last verdict, and whether it was killed at first sight."""
    first: dict[tuple[str, str, str], Row] = {}
    last: dict[tuple[str, str, str], Row] = {}
    for row in rows:
        first.setdefault(key(row), row)
        last[key(row)] = row
    return [
        row | {"first": not survivor(first[name]), "of": first[name]["of"]}
        for name, row in last.items()
    ]


def count(rows: Sequence[Row], known: Sequence[dict[str, str]]) -> Count:
    left = [judged(row, known)[0] for row in rows if survivor(row)]
    same = left.count("equivalent")
    first = sum(row["first"] for row in rows)
    return Count(len(rows), first, len(rows) - len(left), same, len(left) - same)


def tables(rows: Sequence[Row]) -> str:
    """The page."""
    known, rows = reasons(), latest(rows)
    out = [INTRODUCTION]
    head = "| drawn | equivalent | killed at first | of the rest | killed now | survive |"
    out += [f"| group | mutants in all {head}", "|---|---|---|---|---|---|---|---|"]
    for group in dict.fromkeys(row["group"] for row in rows):
        here = [row for row in rows if row["group"] == group]
        out.append(_line(group, str(here[0]["of"]), count(here, known)))
    out.append(_line("all", "", count(rows, known)))
    out += ["", f"| module {head}", "|---|---|---|---|---|---|---|"]
    for module in dict.fromkeys(row["module"] for row in rows):
        here = [row for row in rows if row["module"] == module]
        out.append(_line(f"`{module}`", None, count(here, known)))
    out += ["", "## Survivors", ""]
    left = [(row, *judged(row, known)) for row in rows if survivor(row)]
    for title, kind in (("Equivalent", "equivalent"), ("Not killed", "left")):
        those = [(row, reason) for row, of, reason in left if of == kind]
        out += [f"{title} ({len(those)}):", ""]
        for row, reason in those:
            new = "; ".join(x[2:] for x in row["change"].splitlines() if x.startswith("+"))
            out.append(f"- `{row['module']}`, `{row['function']}`: `{new}`. {reason}")
        out.append("")
    return "\n".join(out).rstrip() + "\n"


def _line(name: str, of: str | None, found: Count) -> str:
    cells = [name, *([] if of is None else [of]), str(found.drawn), str(found.equivalent)]
    cells += [str(found.first), found.share, str(found.killed), str(found.survived)]
    return "| " + " | ".join(cells) + " |"
