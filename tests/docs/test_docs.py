"""The documentation is true: its commands run, its example computes, its tables are complete."""

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib import image
from scipy.spatial.transform import Rotation

from docs.generate import picture
from tdfscal.cli import main
from tdfscal.files.rig.reading import load_rig, parse_rig
from tdfscal.logs import read_log
from tests.docs.pages import DOCS, PAGES, anchors, blocks, commands, links, table, text
from tests.reporting.samples import sketch

RUNNABLE = ("../README", "tutorial", "howto", "python")
SAMPLES = DOCS.parent / "sample_data"


def in_process(command: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """Exit status of a `tdfscal` command line; `> FILE` is left to the capture."""
    program, *arguments = shlex.split(command.split(" > ")[0])
    assert program == "tdfscal", command
    monkeypatch.setattr(sys, "argv", ["tdfscal", *arguments])
    try:
        main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0


@pytest.fixture
def sketched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are painted for files alone, and not rendered, which has tests of its own."""
    sketch(monkeypatch)
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all pages, empty but for the reader's own campaign."""
    home = tmp_path_factory.mktemp("reader")
    (home / "campaign").mkdir()
    shutil.copy(SAMPLES / "csv" / "log.csv", home / "campaign")
    return home


@pytest.mark.usefixtures("sketched")
@pytest.mark.parametrize("page", RUNNABLE)
def test_commands_run(
    page: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All blocks of the pages in their order, in one folder, with the stated exit statuses."""
    monkeypatch.chdir(folder)
    for block in blocks(page):
        if block.language == "sh" and "venv" not in block.content:  # those are run by `.ci/run`
            for command, expected in commands(block):
                capsys.readouterr()
                status = in_process(command, monkeypatch)
                assert status == expected, f"{command}\n{capsys.readouterr().err}"
        elif block.language == "python":
            exec(compile(block.content, f"{page}.md", "exec"), {})
        elif block.language == "bash" and shutil.which("jq"):
            done = subprocess.run(["bash", "-ec", block.content], capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
            assert len(done.stdout.splitlines()) == 3


@pytest.mark.usefixtures("sketched")
def test_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cells in their order, in an empty folder; none has stored output that could be stale."""
    monkeypatch.chdir(tmp_path)
    cells = json.loads((DOCS / "notebook.ipynb").read_text(encoding="utf-8"))["cells"]
    names: dict[str, object] = {}
    for k, cell in enumerate(c for c in cells if c["cell_type"] == "code"):
        assert cell["outputs"] == []
        exec(compile("".join(cell["source"]), f"cell {k}", "exec"), names)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_site_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("pydata_sphinx_theme")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", str(DOCS), str(tmp_path / "site")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    gallery = (tmp_path / "site" / "gallery.html").read_text(encoding="utf-8")
    assert gallery.count("_images/") >= 6
    assert "Figure size" not in gallery
    assert all(
        (tmp_path / "site" / f"{page}.html").is_file() for page in (*PAGES, "notebook", "gallery")
    )


def test_yaml_blocks_are_rig_files() -> None:
    """A whole file as it stands; a single block within the tutorial's file."""
    whole = [b.content for b in blocks("tutorial") if b.language == "yaml"]
    assert len(whole) == 1
    parse_rig(whole[0].encode(), "tutorial.md")
    parts = [yaml.safe_load(b.content) for b in blocks("howto") if b.language == "yaml"]
    assert len(parts) == 5
    for part in parts:
        merged = yaml.safe_load(whole[0]) | part
        parse_rig(yaml.safe_dump(merged).encode(), "howto.md")


def test_pages_link_to_what_exists() -> None:
    assert {path.stem for path in DOCS.glob("*.md")} == set(PAGES)
    for page in PAGES:
        for link in links(page):
            path, _, anchor = link.partition("#")
            target = (DOCS / path) if path else DOCS / f"{page}.md"
            assert target.is_file(), f"{page}.md: {link}"
            if anchor:
                assert anchor in anchors(target.read_text(encoding="utf-8")), f"{page}.md: {link}"
    assert {f"{page}.md" for page in PAGES} - {"index.md"} <= set(links("index"))


def numbers(cells: list[str]) -> np.ndarray:
    return np.array([float(cell.replace("−", "-")) for cell in cells])


def rows(marker: str) -> dict[str, np.ndarray]:
    return {row[0]: numbers(row[1:4]) for row in table("conventions", marker)}


def test_worked_example_computes() -> None:
    """Recomputed from the numbers printed, by scipy's rotations; each to its last printed digit."""
    given, printed, results = (
        rows("example: given"),
        rows("example: rotation"),
        rows("example: results"),
    )
    # Capital letters: turns about the moving axes, z first; the same as fixed x, y, z.
    turn = Rotation.from_euler("ZYX", given["rpy"][::-1])
    R = np.array([printed[axis] for axis in "XYZ"])
    np.testing.assert_allclose(R, turn.as_matrix(), rtol=0, atol=0.5e-6)
    force = turn.apply(given["F_sensor"] - given["zero"])
    np.testing.assert_allclose(results["F_bcs"], force, rtol=0, atol=0.5e-3)
    np.testing.assert_allclose(
        results["d × F_bcs"], np.cross(given["d"], force), rtol=0, atol=0.5e-3
    )
    # J⁻¹ d by differences: roll, pitch, yaw of a rotation turned by a millionth of d.
    h = 1e-6
    moved = (Rotation.from_rotvec(h * given["d"]) * turn).as_euler("ZYX")[::-1]
    np.testing.assert_allclose(results["J⁻¹ d"], (moved - given["rpy"]) / h, rtol=0, atol=0.6e-6)
    assert f"{np.linalg.norm(force):.3f} N long" in text("conventions")


def test_the_documentation_is_of_a_size_that_is_read() -> None:
    pages = [*DOCS.glob("*.md"), DOCS.parent / "README.md"]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= 18_000


def test_the_picture_of_the_front_page_is_that_of_the_program(tmp_path: Path) -> None:
    """Pixel by pixel, but for how fonts are smoothed."""
    picture(tmp_path / "angles.png")
    made, shown = (image.imread(folder / "angles.png") for folder in (tmp_path, DOCS))
    assert made.shape == shown.shape
    assert np.abs(made - shown).mean() < 2e-3


@pytest.mark.parametrize("form", ["csv", "parquet", "mcap"])
def test_the_sample_campaign_is_made_by_its_command(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = [line for block in blocks("../README") for line in block.content.splitlines()]
    (command,) = [line for line in lines if f"simulate sample_data/{form}" in line]
    assert in_process(command.replace("sample_data", str(tmp_path)), monkeypatch) == 0
    for name in ("rig.yaml", "truth.yaml"):
        assert (tmp_path / form / name).read_text() == (SAMPLES / form / name).read_text()
    names = ("ncp1", "ncp2", "ncp3")
    logs = [
        read_log([folder / f"log.{form}"], load_rig(folder / "rig.yaml").log, names)
        for folder in (tmp_path / form, SAMPLES / form)
    ]
    for made, sample in zip(*(log.streams for log in logs), strict=True):
        np.testing.assert_allclose(made.value, sample.value, rtol=0, atol=1e-9)
