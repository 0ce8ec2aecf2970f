"""Every figure: nothing cut, axes with units, a reading that says the number."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from reporting.samples import NASTY, changed, sample, surveyed
from tdfscal.files.calibration import Calibration
from tdfscal.reporting.figures import drawings, write_figures
from tdfscal.reporting.figures.rig import clear_view, magnification
from tdfscal.reporting.figures.style import Drawing, figure, raster, to_svg

SELF = {"angles", "residuals", "budget", "timeline", "observability", "rig", "trials"}


def calibrations() -> dict[str, Calibration]:
    tracker, joint = surveyed()
    return {
        "self": sample(touched=True).calibration,
        "six supports": sample(n=6, name=NASTY.replace('"', "")).calibration,
        "tracker": tracker,
        "joint": joint,
    }


@pytest.fixture(scope="module", params=["self", "six supports", "tracker", "joint"])
def drawn(request: pytest.FixtureRequest) -> tuple[Drawing, ...]:
    return drawings(calibrations()[request.param])


def words(fig: Figure) -> Iterator[str]:
    for ax in fig.axes:
        yield from (ax.get_xlabel(), ax.get_ylabel())


def test_each_method_has_its_figures() -> None:
    found = {kind: {d.name for d in drawings(c)} for kind, c in calibrations().items()}
    assert found["self"] == found["six supports"] == SELF
    assert found["tracker"] == {"angles", "budget", "observability", "rig", "survey"}
    assert found["joint"] == SELF - {"trials"} | {"methods", "survey"}


def test_nothing_is_cut(drawn: tuple[Drawing, ...]) -> None:
    for drawing in drawn:
        fig = drawing.paint()
        canvas = FigureCanvasAgg(fig)
        canvas.draw()
        box = fig.get_tightbbox(canvas.get_renderer())
        width, height = fig.get_size_inches()
        slack = 0.02  # inches: half of a stroke's width and antialiasing
        assert box.x0 > -slack, drawing.name
        assert box.y0 > -slack, drawing.name
        assert box.x1 < width + slack, drawing.name
        assert box.y1 < height + slack, drawing.name


def test_axes_name_their_units(drawn: tuple[Drawing, ...]) -> None:
    for drawing in drawn:
        fig = drawing.paint()
        said = " ".join(words(fig))
        for ax in fig.axes:
            said += " " + getattr(ax, "get_zlabel", lambda: "")()
        unit = r"mrad|µm|, N\b|N·m|, s\b|, m\b|%"
        assert re.search(unit, said), f"{drawing.name}: {said}"


def test_svg_is_sound_and_its_identifiers_are_its_own(drawn: tuple[Drawing, ...]) -> None:
    seen: set[str] = set()
    for drawing in drawn:
        svg = to_svg(drawing)
        root = ET.fromstring(svg)
        own = {e.get("id", "") for e in root.iter()} - {""}
        assert own
        assert not own & seen, drawing.name
        seen |= own
        used = set(re.findall(r"url\(#([^)]+)\)", svg)) | set(re.findall(r'href="#([^"]+)"', svg))
        assert used <= own, drawing.name
        assert not list(root.iter("{http://www.w3.org/2000/svg}script"))


def test_the_same_drawing_twice_is_the_same_to_the_byte() -> None:
    for drawing in drawings(sample(touched=True).calibration):
        assert to_svg(drawing) == to_svg(drawing)


def test_drawing_leaves_pyplot_and_its_settings_alone() -> None:
    before = dict(plt.rcParams)
    to_svg(drawings(sample().calibration)[0])
    assert plt.get_fignums() == []
    assert dict(plt.rcParams) == before


def test_readings_say_the_number() -> None:
    c = sample(touched=True).calibration
    said = {d.name: d.reading for d in drawings(c)}
    i, j = np.unravel_index(int(c.rpy_std.argmax()), (3, 3))
    name = ("Roll", "Pitch", "Yaw")[j]
    assert said["angles"].startswith(
        f"{name} of support_{i + 1} is known to {1e3 * c.rpy_std.max():.2g} mrad"
    )
    assert "11 of 12 dwells are in the fit" in said["timeline"]
    assert "1 had to be rejected" in said["timeline"]
    assert c.validation is not None
    assert f"{c.validation.force.rms_before:.3g} N" in said["residuals"]
    assert all(text.endswith(".") for text in said.values())


def test_weakest_direction_is_that_of_the_covariance() -> None:
    """One sensor made weak about a known axis by hand."""
    c = sample().calibration
    axis = np.array([0.6, 0.0, 0.8])
    C = 1e-8 * np.eye(9)
    C[3:6, 3:6] += (4e-3**2) * np.outer(axis, axis)
    content = c.model_dump()
    content["covariance"]["matrix"] = C.tolist()
    for i, support in enumerate(content["supports"]):
        J = _rpy_jacobian(c.rotation[i])
        std = np.sqrt(np.diag(J @ C[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] @ J.T))
        support["rpy_std"] = std.tolist()
    weak = Calibration.model_validate(content)
    said = next(d.reading for d in drawings(weak) if d.name == "observability")
    assert "a turn of support_2 about an axis 37° from Z of the BCS: 4 mrad" in said
    assert "by a factor of 40" in said


def _rpy_jacobian(R: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    h = 1e-6
    columns = []
    for e in np.eye(3):
        ahead, behind = (
            (Rotation.from_rotvec(s * h * e) * Rotation.from_matrix(R)).as_euler("xyz")
            for s in (1, -1)
        )
        columns.append((ahead - behind) / (2 * h))
    return np.stack(columns, axis=1)


def test_text_from_files_is_never_taken_for_mathematics() -> None:
    c = sample(touched=True).calibration
    content = c.model_dump()
    content["fit"]["rejected"][0]["reason"] = r"$\frac{1}{ <b>x_2$ \undefined"
    for drawing in drawings(Calibration.model_validate(content)):
        assert "<b>" not in to_svg(drawing)


def test_many_postures_stay_small() -> None:
    c = sample().calibration
    table = c.model_dump()["postures"]
    n = 4000
    start = np.arange(n) * 5.0
    rng = np.random.default_rng(0)
    wide = {key: np.exp(rng.normal(size=(n, 3))) for key in table if "force" in key}
    wide |= {key: np.exp(rng.normal(size=(n, 3))) for key in table if "moment" in key}
    big = changed(
        c, postures=table | wide | {"index": np.arange(n), "start": start, "end": start + 3.0}
    )
    assert raster(n)
    size = sum(len(to_svg(d)) for d in drawings(big))
    assert size < 2_000_000


@pytest.mark.parametrize(
    ("largest", "factor"), [(0.0, 1), (0.43, 1), (0.2, 2), (0.02, 20), (1e-3, 200), (4.4e-4, 500)]
)
def test_magnification_is_round_and_shows_25_degrees_at_most(largest: float, factor: int) -> None:
    assert magnification(largest) == factor
    assert factor == 1 or factor * largest <= np.radians(25)


def test_view_hides_no_point_behind_another() -> None:
    """Seen along the line of two points they would fall into one."""
    azimuth = np.radians(-45)
    line = np.array([np.cos(azimuth), np.sin(azimuth), np.tan(np.radians(24))])
    points = np.array([[0.0, 0.0, 0.0], line, [1.0, 1.0, 0.0]])
    assert abs(clear_view(points) + 45) >= 20


def test_files(tmp_path: Path) -> None:
    paths = write_figures(sample().calibration, tmp_path / "new" / "figures")
    assert {p.name for p in paths} == {f"{name}.{s}" for name in SELF for s in ("png", "svg")}
    for path in paths:
        if path.suffix == ".png":
            assert path.read_bytes().startswith(b"\x89PNG\r\n")
        else:
            ET.parse(path)


def test_an_empty_figure_has_the_width_of_a_page() -> None:
    assert figure(2.0).get_size_inches().tolist() == [7.3, 2.0]
