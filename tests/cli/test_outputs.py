"""Outputs: never over an input, all together or none."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tdfscal.files.outputs import replacing
from tdfscal.files.saving import write_text
from tests.cli.running import SAMPLES, Cli, contents

FAST = "--postures 4"
#: Every output that is one file: the command with its place, and the suffix of that place.
PLACES = [
    ("calibrate C -o OUT --trials 0", ".yaml"),
    ("calibrate C --trials 0 --html OUT -o new.yaml", ".html"),
    ("validate own.yaml C --html OUT", ".html"),
    ("apply own.yaml C -o OUT", ".csv"),
    (f"plan C -o OUT {FAST}", ".csv"),
    (f"plan C/rig.yaml -o OUT {FAST}", ".csv"),  # whose home is that of the log beside it
    ("report own.yaml --html OUT", ".html"),
    ("update own.yaml C -o OUT --trials 0", ".yaml"),
    ("monitor own.yaml C --html OUT", ".html"),
    ("init C -o OUT", ".yaml"),
    ("export own.yaml --to csv -o OUT", ".csv"),
]
#: Files that no line above may replace: inputs, and what is of another kind than its output.
KEPT = ("C/log.parquet", "C/rig.yaml", "C/tracker/moves.csv", "C/truth.yaml", "own.yaml", "log.csv")


@pytest.fixture(scope="module")
def made(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = Path(shutil.copytree(built, tmp_path_factory.mktemp("outputs") / "world"))
    (home / "campaign").rename(home / "C")
    shutil.copy(SAMPLES / "csv" / "log.csv", home)
    return home


@pytest.fixture
def home(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of inputs; figures, which take seconds, are left out of pages."""
    monkeypatch.chdir(made)
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")
    return made


def routes(target: Path, suffix: str) -> Iterator[Path]:
    """Ways to name a file: as it is, through a folder above, by a link, by another name of it."""
    yield target
    yield Path("out") / ".." / target
    soft, hard = Path(f"soft{suffix}"), Path(f"hard{suffix}")
    soft.symlink_to(target)
    os.link(target, hard)
    yield soft
    yield hard
    soft.unlink()
    hard.unlink()


@pytest.mark.parametrize(("line", "suffix"), PLACES, ids=[line for line, _ in PLACES])
def test_no_output_replaces_an_input_or_another_kind_of_file(
    line: str, suffix: str, home: Path, cli: Cli
) -> None:
    before = contents(home)
    for name in KEPT:
        if name == "own.yaml" and "own.yaml" not in line and "init" not in line:
            continue  # a result of the same kind
        for place in routes(Path(name), suffix):
            seen = cli(*(str(place) if word == "OUT" else word for word in line.split()), ends=2)
            if place.suffix == suffix:
                assert "replace" in seen.err or "same recording" in seen.err
    assert contents(home) == before


def test_two_outputs_of_one_name_are_refused(home: Path, cli: Cli) -> None:
    Path("page.html").symlink_to("both.yaml")
    seen = cli("calibrate", "C", "-o", "both.yaml", "--html", "page.html", "--trials", 0)
    Path("page.html").unlink()
    assert (seen.status, seen.out) == (2, "")
    assert "--html" in seen.err
    assert not Path("both.yaml").exists()


def test_files_named_outside_their_folder_are_kept(home: Path, tmp_path: Path, cli: Cli) -> None:
    shutil.copytree(SAMPLES / "csv", tmp_path / "C")
    (tmp_path / "C" / "tracker" / "moves.csv").rename(tmp_path / "moves.csv")
    rig = tmp_path / "C" / "rig.yaml"
    rig.write_text(rig.read_text().replace("tracker/moves.csv", "../moves.csv"))
    words = ("calibrate", tmp_path / "C", "--method", "tracker", "--trials", 0)
    kept = (tmp_path / "moves.csv").read_bytes()
    (tmp_path / "link.yaml").symlink_to("moves.csv")
    cli(*words, "-o", tmp_path / "link.yaml", ends=2)
    assert (tmp_path / "moves.csv").read_bytes() == kept


def test_files_appear_together_or_not_at_all(tmp_path: Path) -> None:
    """Also where the last of them cannot be put into its place."""
    from tdfscal.errors import UsageError
    from tdfscal.files.outputs import together

    (tmp_path / "a").write_text("before")

    def write() -> None:
        with together():
            write_text(tmp_path / "a", "after")
            write_text(tmp_path / "b", "after")
            (tmp_path / "b").mkdir()
            (tmp_path / "b" / "inside").write_text("x")

    with pytest.raises(UsageError):
        write()
    assert contents(tmp_path) == {"a": b"before", "b/inside": b"x"}
    with together():
        write_text(tmp_path / "a", "after")
        assert (tmp_path / "a").read_text() == "before"
    assert (tmp_path / "a").read_text() == "after"


def test_a_run_made_again_replaces_its_own_result_in_the_campaign(home: Path, cli: Cli) -> None:
    again = f"""plan C -o C/plan.csv {FAST}\napply own.yaml C -o C/w.mcap\ninit C -o C/r.yaml
    export own.yaml --to ros -o C/e.yaml\nexport own.yaml --to urdf -o C/e.xml
    export own.yaml --to csv -o C/e.csv\nreport own.yaml --html C/p.html
    apply own.yaml C -o C/w.csv\napply own.yaml C -o C/w.parquet""".splitlines()
    for line in again * 2:
        assert cli(*line.split()).status == 0, line
    for line in again:
        Path(line.split("-o " if "-o" in line else "--html ")[1].split()[0]).unlink()


def test_writing_that_fails_leaves_the_old_file_and_no_trace(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("old")

    def fail_half_way() -> None:
        with replacing(path) as beside:
            beside.write_text("half")
            raise RuntimeError("beside it" if beside.parent == path.parent else "elsewhere")

    with pytest.raises(RuntimeError, match="beside it"):
        fail_half_way()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
