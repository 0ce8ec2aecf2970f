"""Every figure: nothing cut, axes with units, a reading that says the number."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from tdfscal.commands.calibration import load_calibration
from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.figures import drawings
from tdfscal.reporting.figures.style import figure, look, raster, save, to_svg
from tests.reporting.samples import NASTY, by_hand, changed, sample, surveyed

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


def test_files(tmp_path: Path) -> None:
    for drawing in drawings(calibration("tracker"))[:1]:
        png, pdf, svg = save(drawing, tmp_path / "new" / "figures")
        assert png.read_bytes().startswith(b"\x89PNG\r\n")
        assert pdf.read_bytes().startswith(b"%PDF")
        assert ET.parse(svg).getroot().tag == "{http://www.w3.org/2000/svg}svg"
    names = {path.name for path in (tmp_path / "new" / "figures").iterdir()}
    assert names == {f"angles.{s}" for s in ("png", "pdf", "svg")}
