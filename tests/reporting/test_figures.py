"""Every figure: no word is cut, none lies on another."""

from itertools import combinations

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.figures import drawings
from tdfscal.reporting.figures.style import look
from tests.reporting.samples import NASTY, sample, surveyed

APART = {"six supports": {"angles", "budget"}, "joint": {"survey"}}
"""What is worth drawing of other rigs, since drawing takes its time."""


def calibration(kind: str) -> Calibration:
    if kind == "self":
        return sample(touched=True).calibration
    if kind == "six supports":
        return sample(n=6, name=NASTY).calibration
    return surveyed()[1]


def words(kind: str) -> dict[str, tuple[Bbox, list[tuple[str, Bbox]]]]:
    """Per figure: its bounds, the words that it shows with the pixels they take.

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
            found[drawing.name] = (Bbox(fig.bbox.get_points()), list(shown))
            shown.clear()
    return found


@pytest.mark.parametrize("kind", ["self", "six supports", "joint"])
def test_no_word_is_cut_or_lies_on_another(kind: str) -> None:
    for name, (page, shown) in words(kind).items():
        assert shown
        for said, box in shown:
            assert min(box.x0, box.y0) >= -1, f"{name}: {said}"
            assert max(box.x1 - page.width, box.y1 - page.height) <= 1, f"{name}: {said}"
        for (a, first), (b, second) in combinations(shown, 2):
            common = Bbox.intersection(first, second)
            overlap = 0 if common is None else min(common.width, common.height)
            assert overlap <= 1, f"{name}: {a!r} lies on {b!r}"
