"""Mutants of the mathematics and of the file checks, and whether tests of results notice them.

    python -m benchmarks.mutation [--groups WORDS] [--sample 80] [--seed 1] [--results FILE]
    python -m benchmarks.mutation --again [--groups WORDS] [--results FILE]
    python -m benchmarks.mutation --tables FILE

The first changes one thing at a time (an operator, a number, an argument, a branch) in the modules
of `GROUPS` and runs the tests of their own room; verdicts are appended to FILE, and what stands
there is not run again. The second runs what survived there again, the third writes
`benchmarks/mutation.md` from FILE. Needs the extra `mutation` (mutmut: its operators and its switch
between mutants).

The loop is ours because mutmut's keeps, from the run that times the tests, whatever these cached,
and asks of a mutant only the tests that were the first to call the function: tests that share a
fixture or a cached campaign would pass without ever seeing the mutant. Here every mutant has a
process forked before any test ran, and all tests of each file that reaches the function.
"""

from __future__ import annotations

import argparse
import difflib
import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import libcst as cst
from mutmut.mutation.file_mutation import Mutation, MutationVisitor, combine_mutations_to_source
from mutmut.mutation.mutators import mutation_operators, operator_string
from mutmut.mutation.pragma_handling import IgnoredCode

from benchmarks.mutation_table import key, latest, survivor, tables

ROOT = Path(__file__).resolve().parent.parent
STRINGS = (cst.SimpleString, cst.FormattedString, cst.ConcatenatedString)


@dataclass(frozen=True)
class Group:
    """Modules (below `tdfscal/`) and the tests of their room (below `tests/`)."""

    modules: tuple[str, ...]
    tests: tuple[str, ...]


GROUPS: dict[str, Group] = {
    "statics": Group(
        ("model/statics", "model/pose", "model/postures", "model/parameters", "model/free_forces",
         "model/zero_motion"),
        ("model", "selfcal/test_statics", "selfcal/test_supports"),
    ),
    "estimator": Group(
        ("selfcal/estimator", "selfcal/covariance", "numerics/least_squares"),
        ("numerics", "selfcal/test_estimator", "selfcal/test_covariance", "selfcal/test_statics",
         "selfcal/test_supports"),
    ),
    "rotations and registration": Group(
        ("numerics/so3", "numerics/registration", "numerics/alignment"),
        ("numerics", "tracker/test_registration"),
    ),
    "tracker": Group(
        ("trackercal/instrument", "trackercal/best_fit", "trackercal/judged_registration"),
        ("tracker/test_instrument", "tracker/test_points", "tracker/test_register",
         "tracker/test_registration"),
    ),
    "wrench": Group(
        ("wrench/contact_wrench", "wrench/kinematics", "wrench/filtering", "wrench/resampling"),
        ("wrench/test_wrench_by_hand", "wrench/test_streaming", "wrench/test_contact",
         "control/test_filtering"),
    ),
    "gate": Group(
        ("acceptance/gate", "acceptance/conformity", "acceptance/turns"),
        ("acceptance",),
    ),
    "checks of logs": Group(
        ("checks/faulty_sensors", "checks/log_against_calibration", "checks/log_against_rig",
         "checks/geometry", "checks/hinge_distances", "checks/same_rig"),
        ("checks",),
    ),
    "checks of files": Group(
        ("files/calibration/consistency", "files/rig/checks"),
        ("files/test_consistency", "files/test_rotation_checks", "files/test_rig_checks",
         "files/test_rig_file"),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change. name : as the switch knows it. change : lines before (-) and after (+)."""

    name: str
    module: str
    function: str
    change: str


def changes(path: Path) -> tuple[cst.Module, list[Mutation]]:
    """All changes of a module that count."""
    operators = [(kind, op) for kind, op in mutation_operators if op is not operator_string]
    wrapper = cst.metadata.MetadataWrapper(cst.parse_module(path.read_text(encoding="utf-8")))
    visitor = MutationVisitor(operators, IgnoredCode(set(), set(), set()))
    tree = wrapper.visit(visitor)
    wording = {id(node) for node in _wording(tree)}
    return tree, [
        each
        for each in visitor.mutations
        if isinstance(each.contained_by_top_level_function, cst.FunctionDef)
        and id(each.original_node) not in wording
        and not _of_words(each)
    ]


def mutated(tree: cst.Module, chosen: Sequence[Mutation], module: str) -> tuple[str, list[Mutant]]:
    """Source of a module with the chosen mutants and the switch between them."""
    source = combine_mutations_to_source(tree, chosen)
    body = {
        name: [each.replace(name, "") for each in _lines(source.code, span.start, span.end)]
        for name, span in source.line_span_by_function_name.items()
    }
    dotted = "tdfscal." + module.replace("/", ".")
    mutants = []
    for name in source.mutant_names:
        mangled = name.rpartition("__mutmut_")[0]
        change = _change(body[f"{mangled}__mutmut_orig"], body[name])
        function = mangled.removeprefix("x_").strip("xǁ").replace("ǁ", ".")
        mutants.append(Mutant(f"{dotted}.{name}", module, function, change))
    return source.code, mutants


def _lines(code: str, first: int, last: int) -> list[str]:
    return code.splitlines()[first - 1 : last]


def _change(before: list[str], after: list[str]) -> str:
    lines = [each for each in difflib.ndiff(before, after) if each[0] in "+-"]
    return "\n".join(f"{each[0]} {each[1:].strip()}" for each in lines)


def _below(node: cst.CSTNode) -> Iterator[cst.CSTNode]:
    yield node
    for child in node.children:
        yield from _below(child)


def _wording(tree: cst.CSTNode) -> Iterator[cst.CSTNode]:
    """Nodes that only say something: what is raised, texts with values in them, zip's guard."""
    for node in _below(tree):
        said = isinstance(node, (cst.Raise, cst.FormattedString, cst.ConcatenatedString))
        if said or _is_guard(node):
            yield from _below(node)


def _is_guard(node: cst.CSTNode) -> bool:
    return isinstance(node, cst.Arg) and bool(node.keyword and node.keyword.value == "strict")


def _of_words(mutation: Mutation) -> bool:
    """Is it a text that changes, or the guard `strict` of a zip, which never speaks?"""
    old, new = mutation.original_node, mutation.mutated_node
    if isinstance(old, (cst.Assign, cst.AnnAssign)):
        value = old.value.body if isinstance(old.value, cst.IfExp) else old.value
        return isinstance(value, STRINGS)
    if isinstance(old, cst.IfExp):
        return isinstance(old.body, STRINGS)
    if isinstance(old, cst.Call) and isinstance(new, cst.Call):
        kept = {id(arg) for arg in new.args}
        lost = [arg for arg in old.args if id(arg) not in kept]
        return any(isinstance(arg.value, STRINGS) or _is_guard(arg) for arg in lost)
    return False


def run(label: str, sample: int, seed: int, results: Path, *, again: bool = False) -> None:
    """Run a random sample of a group's mutants in a copy of the project.

    again : instead, those that survived before and that the code still has.
    """
    group, before = GROUPS[label], read(results)
    trees = {m: changes(ROOT / "tdfscal" / f"{m}.py") for m in group.modules}
    every = [(m, i) for m, (_, found) in trees.items() for i in range(len(found))]
    drawn = set(random.Random(seed).sample(every, min(sample, len(every))))
    done = {key(row) for row in before}
    lived = {key(row) for row in latest(before) if row["group"] == label and survivor(row)}
    functions = {(module, function.rpartition(".")[2]) for module, function, _ in lived}
    with TemporaryDirectory(prefix="mutation-") as folder:
        copy = Path(folder)
        for name in ("tdfscal", "tests", "schemas", "sample_data", "benchmarks", "pyproject.toml"):
            _copy(ROOT / name, copy / name)
        todo: list[dict[str, str]] = []
        for module, (tree, found) in trees.items():
            chosen = [
                each
                for i, each in enumerate(found)
                if ((module, _function(each)) in functions if again else (module, i) in drawn)
            ]
            source, mutants = mutated(tree, chosen, module)
            (copy / "tdfscal" / f"{module}.py").write_text(source, encoding="utf-8")
            rows = [vars(mutant) for mutant in mutants]
            todo += [row for row in rows if (key(row) in lived if again else key(row) not in done)]
        print(f"{label}: {len(every)} mutants, {len(todo)} to run", flush=True)
        if todo:
            about = {"group": label, "of": len(every), "seed": seed}
            job = {"about": about, "mutants": todo, "results": str(results.resolve())}
            (copy / "job.json").write_text(json.dumps(job), encoding="utf-8")
            _run_in(copy, group)


def _run_in(copy: Path, group: Group) -> None:
    tests = [f"tests/{t}" + ("" if (ROOT / "tests" / t).is_dir() else ".py") for t in group.tests]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(copy), *sys.path[1:]])}
    environment |= {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTHONDONTWRITEBYTECODE": ""}
    command = [sys.executable, "-m", "benchmarks.mutation_run", *tests]
    subprocess.run(command, cwd=copy, env=environment, check=True)


def _function(mutation: Mutation) -> str:
    function: Any = mutation.contained_by_top_level_function
    return str(function.name.value)


def _copy(source: Path, target: Path) -> None:
    if source.is_dir():
        shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
    else:
        shutil.copy(source, target)


def read(results: Path) -> list[dict[str, Any]]:
    """Verdicts that stand in a file, one JSON object a line."""
    if not results.exists():
        return []
    return [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--groups", nargs="*", default=list(GROUPS))
    parser.add_argument("--sample", type=int, default=80)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--results", type=Path, default=Path("mutation.jsonl"))
    parser.add_argument("--again", action="store_true", help="those that survived")
    parser.add_argument("--tables", type=Path, metavar="RESULTS")
    given = parser.parse_args(arguments)
    if given.tables is not None:
        page = ROOT / "benchmarks" / "mutation.md"
        page.write_text(tables(read(given.tables)), encoding="utf-8")
        return
    for label in given.groups:
        run(label, given.sample, given.seed, given.results, again=given.again)


if __name__ == "__main__":
    main()
