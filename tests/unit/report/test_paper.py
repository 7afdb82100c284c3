"""Figures for a paper's column: nothing lies on the data, and nothing is cut off."""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

import phalanx
from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.read import read
from phalanx.report.links import link_statistics
from phalanx.report.style import drawn_for
from phalanx.report.write import draw_figures
from phalanx.scenario.load import load
from tests.unit.report.recordings import drift, record, summary_of

pytestmark = pytest.mark.slow
COLUMN = 3.45
"""[inch]"""
SIZES = {6.0, 7.0}
"""Of all texts [pt]."""


@pytest.fixture(scope="module", params=["unicycles", "formation3d"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with losses, in which K_i is empty at times and certificates run out."""
    scenario = load(request.param, ["duration=0.6", "network.loss=0.3"])
    folder = tmp_path_factory.mktemp(request.param)
    return record(folder, scenario, drift(scenario), summary_of(scenario))


def laid_out(figure: Figure) -> Figure:
    FigureCanvasAgg(figure).draw()
    return figure


def overlap(a: Bbox, b: Bbox) -> bool:
    """Return whether two boxes share more than a pixel's width."""
    both = Bbox.intersection(a, b)
    return both is not None and both.width > 1.0 and both.height > 1.0


def faults(figure: Figure) -> Iterator[str]:
    """Yield what a journal would send back."""
    panels = [axes.get_window_extent() for axes in figure.axes]
    words = {}
    for axes in figure.axes:
        titles = [axes.get_title(loc=loc) for loc in ("left", "center", "right")]
        headings = [axes.title, axes._left_title, axes._right_title]
        labels = [axes.xaxis.label, axes.yaxis.label]
        words |= {t.get_text(): t for t in (*headings, *labels) if t.get_text()}
        assert not any(titles) or words
        if legend := axes.get_legend():
            words[f"legend of {axes.get_ylabel()!r} {id(axes)}"] = legend
    boxes = {name: each.get_window_extent() for name, each in words.items()}
    for name, box in boxes.items():
        inside = Bbox.intersection(box, figure.bbox)
        if inside is None or abs(inside.width - box.width) + abs(inside.height - box.height) > 1.0:
            yield f"{name}: cut off"
        if any(overlap(box, panel) for panel in panels):
            yield f"{name}: on the data"
    for a, b in combinations(boxes, 2):
        if overlap(boxes[a], boxes[b]):
            yield f"{a}: on {b}"
    for text in figure.findobj(plt.Text):
        if text.get_text() and text.get_visible() and text.get_fontsize() not in SIZES:
            yield f"{text.get_text()}: of {text.get_fontsize()} pt"
    if figure.get_figwidth() != COLUMN:
        yield f"{figure.get_figwidth()} inches wide"


@pytest.mark.nightly
def test_figures_of_a_report_for_a_paper(run: Path):
    recording = read(run)
    with drawn_for("paper"):
        history = ReportHistory(recording)
        figures = {
            f.name: laid_out(f.figure) for f in draw_figures(history, link_statistics(recording))
        }
    assert len(figures) > 10
    assert {name: found for name, each in figures.items() if (found := list(faults(each)))} == {}
    for name, figure in figures.items():
        heights = [axes.get_window_extent().height / figure.dpi for axes in figure.axes]
        assert min(heights) > 0.4, name


def test_one_look_for_a_paper(run: Path):
    axes = phalanx.open(run).plot(style="paper")
    assert list(faults(laid_out(axes["paths"].figure))) == []
    plt.close("all")
