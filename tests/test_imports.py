"""Imports go one way, and the heavy libraries stay out of the light rooms."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "tdfscal"

HEAVY = {"pydantic", "pandas", "pyarrow", "mcap", "rosbags", "typer", "rich", "yaml", "matplotlib"}
#: The rooms from the ground up; each imports only from those before it.
ORDER = (
    "findings", "errors", "memory", "records", "significance", "numerics", "model", "simulation",
    "dwells", "clocks", "wrench", "detection", "checks", "acceptance", "estimation", "selfcal",
    "motioncal", "trackercal", "comparison", "validation", "planning", "catalogue", "files",
    "logs", "reporting", "exports", "workflows", "api", "cli",
)  # fmt: skip
#: Rooms whose folders are in order too.
SORTED = {"files", "reporting", "exports"}
OUTER = set(ORDER[ORDER.index("files") :])


def imported(path: Path) -> set[str]:
    """Dotted names that a module imports, wherever in the module."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module or "")
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def room(path: Path) -> str:
    parts = path.relative_to(PACKAGE).parts
    return parts[0].removesuffix(".py")


MODULES = sorted(PACKAGE.rglob("*.py"))
INSIDE = [m for m in MODULES if room(m) not in {"__init__", "__main__"}]


def rooms_imported(path: Path) -> set[str]:
    return {n.split(".")[1] for n in imported(path) if n.startswith("tdfscal.")} - {"__version__"}


@pytest.mark.parametrize("path", INSIDE, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_one_way(path: Path) -> None:
    assert rooms_imported(path) <= set(ORDER[: ORDER.index(room(path)) + 1])


@pytest.mark.parametrize(
    "path", [m for m in INSIDE if room(m) not in OUTER], ids=lambda p: str(p.relative_to(PACKAGE))
)
def test_steps_know_no_heavy_library(path: Path) -> None:
    assert not {n.split(".")[0] for n in imported(path)} & HEAVY


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_the_package_knows_nothing_of_studies_and_tests(path: Path) -> None:
    others = {"studies", "tests", "benchmarks"}
    assert not {n.split(".")[0] for n in imported(path)} & others


def test_no_module_lies_flat_but_the_few_that_everything_uses() -> None:
    flat = {p.stem for p in PACKAGE.glob("*.py")}
    assert flat <= {
        "__init__",
        "__main__",
        "api",
        "findings",
        "errors",
        "memory",
        "records",
        "significance",
    }


@pytest.mark.parametrize(
    "path", [m for m in MODULES if room(m) == "simulation"], ids=lambda p: p.name
)
def test_simulator_does_not_know_the_estimator(path: Path) -> None:
    names = {n.split(".")[1] for n in imported(path) if n.startswith("tdfscal.")}
    assert names <= {"simulation", "records", "errors", "numerics"}


@pytest.mark.parametrize(
    "path", [m for m in MODULES if room(m) == "numerics"], ids=lambda p: p.name
)
def test_numerics_stand_alone(path: Path) -> None:
    names = {n.split(".")[1] for n in imported(path) if n.startswith("tdfscal.")}
    assert names <= {"numerics", "records", "errors", "findings", "significance"}


def folder(path: Path) -> Path:
    return path.parent.relative_to(PACKAGE)


def folder_of(name: str) -> Path | None:
    """The folder of an imported module of the package; a package stands for itself."""
    place = PACKAGE.joinpath(*name.split(".")[1:])
    if place.is_dir():
        return place.relative_to(PACKAGE)
    return folder(place) if place.with_suffix(".py").is_file() else None


def test_no_two_folders_import_each_other() -> None:
    arrows = {
        (folder(path), target)
        for path in INSIDE
        if room(path) in SORTED
        for name in imported(path)
        if name.startswith("tdfscal.") and (target := folder_of(name)) not in (None, folder(path))
    }
    assert not {(a, b) for a, b in arrows if (b, a) in arrows}


def test_help_is_light() -> None:
    code = (
        "import sys, contextlib\n"
        "from tdfscal.cli import main\n"
        "sys.argv = ['tdfscal', '--help']\n"
        "with contextlib.suppress(SystemExit):\n"
        "    main()\n"
        "heavy = {'numpy', 'scipy', 'pandas', 'pyarrow', 'pydantic'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "calibrate" in run.stdout
