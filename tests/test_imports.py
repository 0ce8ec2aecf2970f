"""Imports go one way, and the heavy libraries stay out of the light rooms."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "tdfscal"

HEAVY = {"pydantic", "pandas", "pyarrow", "mcap", "rosbags", "typer", "rich", "yaml", "matplotlib"}
#: The rooms from the ground up; each imports only from those before it.
ORDER = (
    "frozen", "findings", "errors", "records", "significance", "numerics", "model",
    "simulation",
    "clocks", "dwells", "wrench", "detection", "checks", "acceptance", "estimation", "selfcal",
    "motioncal", "trackercal", "comparison", "validation", "planning", "catalogue", "files",
    "logs", "reporting", "exports", "commands", "api", "cli",
)  # fmt: skip
#: Rooms whose folders are in order too.
SORTED = {"files", "reporting"}
OUTER = set(ORDER[ORDER.index("files") :])


@cache
def imported(path: Path) -> frozenset[str]:
    """Dotted names that a module imports, wherever in the module."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module or "")
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def room(path: Path) -> str:
    parts = path.relative_to(PACKAGE).parts
    return parts[0].removesuffix(".py")


MODULES = sorted(PACKAGE.rglob("*.py"))
INSIDE = [m for m in MODULES if room(m) not in {"__init__", "__main__"}]


def rooms_imported(path: Path) -> set[str]:
    return {n.split(".")[1] for n in imported(path) if n.startswith("tdfscal.")} - {"__version__"}


def libraries(path: Path) -> set[str]:
    return {n.split(".")[0] for n in imported(path)}


def test_imports_go_one_way() -> None:
    for path in INSIDE:
        assert rooms_imported(path) <= set(ORDER[: ORDER.index(room(path)) + 1]), path


def test_steps_know_no_heavy_library() -> None:
    for path in INSIDE:
        assert room(path) in OUTER or not libraries(path) & HEAVY, path


def test_the_package_knows_nothing_of_studies_and_tests() -> None:
    for path in MODULES:
        assert not libraries(path) & {"studies", "tests", "benchmarks"}, path


#: Rooms that stand by themselves: the simulator does not know the estimator.
ALONE = {
    "simulation": {"simulation", "frozen", "records", "errors", "numerics"},
    "numerics": {"numerics", "frozen", "records", "errors", "findings", "significance"},
}


def test_rooms_that_stand_alone() -> None:
    for path in MODULES:
        known = ALONE.get(room(path))
        assert known is None or rooms_imported(path) <= known, path


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


def loaded(code: str, heavy: set[str]) -> str:
    """What a program of its own prints, which is to import none of these."""
    code = f"import sys\n{code}\nsys.exit(' '.join({heavy} & set(sys.modules)) or 0)\n"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_help_is_light() -> None:
    code = "from tdfscal.cli import main\nsys.argv = ['', '--help']\n"
    code += "try: main()\nexcept SystemExit: pass"
    assert "calibrate" in loaded(code, {"numpy", "scipy", "pandas", "pyarrow", "pydantic"})


def test_calibrating_loads_no_library_that_few_logs_need() -> None:
    parts = {f"scipy.{p}" for p in ("stats", "spatial", "optimize", "interpolate", "signal")}
    loaded("import tdfscal.commands.calibrate", parts | {"pandas", "matplotlib", "mcap", "rosbags"})
