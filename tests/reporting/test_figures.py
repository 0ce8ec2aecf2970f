"""Every figure: nothing cut, axes with units, a reading that says the number."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from functools import cache
from itertools import combinations
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from tdfscal.commands.calibration import load_calibration
from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.figures import drawings, style
from tdfscal.reporting.figures.space import clear_view, magnification
from tdfscal.reporting.figures.style import figure, look, raster, save, to_svg
from tests.reporting.samples import NASTY, by_hand, changed, sample, surveyed, with_load_cell

SPATIAL = {"rig"}
SELF = {"angles", "residuals", "components", "budget", "timeline", "observability", "rig", "trials"}


APART = {
    "six supports": {"angles", "budget", "observability", "rig"},
    "joint": {"methods", "survey"},
}
"""What is worth drawing of other rigs, since drawing takes its time."""
KINDS = ("self", "six supports", "tracker", "joint")


def calibration(kind: str) -> Calibration:
    if kind == "self":
        return sample(touched=True).calibration
    if kind == "six supports":
        return sample(n=6, name=NASTY).calibration
    return surveyed()[kind == "joint"]


@cache
def words(kind: str) -> dict[str, tuple[Bbox, list[tuple[str, Bbox]], list[str]]]:
    """Per figure: its bounds, the words that it shows with the pixels they take, axes' labels.

    Words are caught as they are drawn: matplotlib keeps tick labels that it never shows.
    """
    found = {}
    shown: list[tuple[str, Bbox]] = []
    draw = Text.draw

    def caught(self: Text, renderer: RendererAgg) -> None:
        if self.get_visible() and self.get_text().strip():
            shown.append((self.get_text(), self.get_window_extent(renderer)))
        draw(self, renderer)

    with look(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", caught)
        for drawing in drawings(calibration(kind)):
            if kind != "self" and drawing.name not in APART[kind]:
                continue
            fig = drawing.paint()
            FigureCanvasAgg(fig).draw()  # type: ignore[no-untyped-call]
            labels = [ax.get_xlabel() for ax in fig.axes] + [ax.get_ylabel() for ax in fig.axes]
            found[drawing.name] = (Bbox(fig.bbox.get_points()), list(shown), labels)
            shown.clear()
    return found


def test_each_method_has_its_figures() -> None:
    found = {kind: {d.name for d in drawings(calibration(kind))} for kind in KINDS}
    assert found["self"] == found["six supports"] == SELF
    assert found["tracker"] == {"angles", "budget", "observability", "rig", "survey", "trials"}
    assert found["joint"] == SELF - {"trials"} | {"methods", "survey"}


@pytest.mark.parametrize("kind", ["self", "six supports", "joint"])
def test_no_word_is_cut(kind: str) -> None:
    for name, (page, shown, _) in words(kind).items():
        assert shown
        for said, box in shown:
            assert box.x0 >= -1, f"{name}: {said}"
            assert box.y0 >= -1, f"{name}: {said}"
            assert box.x1 <= page.width + 1, f"{name}: {said}"
            assert box.y1 <= page.height + 1, f"{name}: {said}"


@pytest.mark.parametrize("kind", ["self", "six supports", "joint"])
def test_no_word_lies_on_another(kind: str) -> None:
    for name, (_, shown, _) in words(kind).items():
        if name in SPATIAL:
            continue
        for (a, first), (b, second) in combinations(shown, 2):
            common = Bbox.intersection(first, second)
            overlap = 0 if common is None else min(common.width, common.height)
            assert overlap <= 1, f"{name}: {a!r} lies on {b!r}"


@pytest.mark.parametrize("kind", ["self", "joint"])
def test_axes_name_their_units(kind: str) -> None:
    for name, (_, _, labels) in words(kind).items():
        unit = r"mrad|µm|, N$|N·m|, s\b| m$|%|std. unc."
        assert any(re.search(unit, label) for label in labels), f"{name}: {labels}"


def test_a_load_cell_has_its_place_in_the_legend_of_the_forces() -> None:
    """It draws nothing in the panels of x and y."""
    c = with_load_cell()
    (legend,) = style.to_figure({d.name: d for d in drawings(c)}["timeline"]).legends
    assert tuple(text.get_text() for text in legend.get_texts()) == c.support_names


def test_every_source_of_a_long_budget_has_a_look_of_its_own() -> None:
    c = sample().calibration
    content = c.model_dump()
    budget = content["budget"]
    budget["sources"] = [f"source {k}" for k in range(11)]
    for angle in budget["angles"]:
        each = sum(angle["variance"].values()) / 11
        angle["variance"] = dict.fromkeys(budget["sources"], each)
    (legend,) = style.to_figure(
        {d.name: d for d in drawings(Calibration.model_validate(content))}["budget"]
    ).legends
    looks = {(key.get_facecolor(), key.get_hatch()) for key in legend.get_patches()}
    assert len(looks) == 11


def test_drawing_leaves_the_settings_of_matplotlib_alone() -> None:
    before = dict(mpl.rcParams)
    to_svg(drawings(calibration("self"))[0])
    assert dict(mpl.rcParams) == before
    for module in Path(style.__file__).parent.glob("*.py"):
        assert "pyplot" not in module.read_text(encoding="utf-8")


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


def test_methods_agree_by_all_angles_together() -> None:
    """A joint calibration that was accepted at p = 0.14 with one angle of nine beyond E_n = 1."""
    c = load_calibration(Path(__file__).parents[1] / "files/reference_1_0/joint.json")
    assert c.accepted
    assert c.tracker is not None
    largest = float(str(c.tracker["largest_en"]))
    assert largest > 1
    (said,) = (d.reading for d in drawings(c) if d.name == "methods")
    assert "agree within their uncertainties" in said
    assert f"E_n = {largest:.2f}; p = 0.14" in said
    apart = {**c.tracker, "consistency_p_value": 0.0049}
    (said,) = (d.reading for d in drawings(changed(c, tracker=apart)) if d.name == "methods")
    assert said.startswith("not compatible")


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
        support["turn_std"] = np.sqrt(np.diag(C)[3 * i : 3 * i + 3]).tolist()
    weak = by_hand(content)
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
    timeline = {d.name: d for d in drawings(Calibration.model_validate(content))}["timeline"]
    assert "<b>" not in to_svg(timeline)


def test_a_notebook_shows_a_figure_without_pyplot() -> None:
    """As IPython formats it: without a picture it would print `<Figure size …>`."""
    formatter = pytest.importorskip("IPython.core.formatters").PNGFormatter()
    with look():
        shown = formatter(figure(2.0))
    assert shown.startswith(b"\x89PNG")


def test_logarithmic_axes_have_plain_numbers() -> None:
    """Names are never taken for mathematics, so that matplotlib's own powers would be raw text."""
    f = tuple(np.geomspace(0.01, 10, 20))
    with look():
        fig = figure(3.0)
        ax = fig.subplots()
        ax.plot(f, f)
        style.logarithmic(ax, "xy")
        FigureCanvasAgg(fig).draw()  # type: ignore[no-untyped-call]
        shown = [
            t.get_text() for t in fig.axes[0].get_xticklabels() + fig.axes[0].get_yticklabels()
        ]
    assert {"0.1", "1", "10"} <= set(shown)
    assert not any("$" in text for text in shown)


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
    found = {d.name: d for d in drawings(big)}
    assert len(to_svg(found["residuals"])) < 500_000
    assert len(to_svg(found["timeline"])) < 500_000


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
    for drawing in drawings(calibration("tracker"))[:1]:
        png, pdf, svg = save(drawing, tmp_path / "new" / "figures")
        assert png.read_bytes().startswith(b"\x89PNG\r\n")
        assert pdf.read_bytes().startswith(b"%PDF")
        assert ET.parse(svg).getroot().tag == "{http://www.w3.org/2000/svg}svg"
    names = {path.name for path in (tmp_path / "new" / "figures").iterdir()}
    assert names == {f"angles.{s}" for s in ("png", "pdf", "svg")}
