"""The report's figures and the page's plots show the same numbers at the same times."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.plots.plots import Curve, Plot, content

import phalanx
from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.read import Recording
from phalanx.report import safety, steps

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def recording() -> Recording:
    """A run whose h has relative degree 2."""
    scenario = phalanx.load("formation3d", ["duration=0.6"])
    return phalanx.run(scenario, engine="in-process").recording


@pytest.fixture(scope="module")
def history(recording: Recording) -> ReportHistory:
    return ReportHistory(recording)


@pytest.fixture(scope="module")
def plots(recording: Recording) -> list[Plot]:
    return content(Replay(recording), range(4), seekable=True).plots


def titled(plots: list[Plot], title: str) -> Plot:
    return next(plot for plot in plots if plot.title == title)


def agree(axes: Axes, line: int, curve: Curve) -> bool:
    """True if each point of a page's curve lies on the figure's line, but for rounding."""
    t, y = (np.asarray(values, dtype=float) for values in axes.lines[line].get_data())
    at = np.abs(t[:, None] - curve.t).argmin(axis=0)
    there = np.allclose(t[at], curve.t, rtol=1e-6, atol=1e-9)
    return len(curve.t) > 5 and there and np.allclose(y[at], curve.y, rtol=1e-3, atol=1e-9)


def test_h_tot_and_every_psi_agree(history, plots) -> None:
    (h_tot,) = safety.safety(history).axes
    assert agree(h_tot, 0, titled(plots, "h_tot").curves[0])
    (psi,) = safety.psi(history).axes
    assert agree(psi, 0, titled(plots, "ψ_1").curves[0])


def test_certified_times_agree(history, plots) -> None:
    (axes,) = steps.certified(history).axes
    for i, curve in enumerate(titled(plots, "Certified for").curves[:3]):
        assert agree(axes, i, curve)


def test_inputs_applied_and_nominal_agree(history, plots) -> None:
    _, *components = steps.inputs(history, 1).axes
    mine = [plot for plot in plots if plot.agent == 1]
    for axes, plot in zip(components, mine, strict=True):
        assert agree(axes, 0, plot.curves[0])
        assert agree(axes, 1, plot.curves[1])
        dotted = [l.get_ydata()[0] for l in axes.lines if l.get_linestyle() == ":"]
        assert dotted == list(plot.safe)


def test_the_oldest_ages_agree() -> None:
    scenario = phalanx.load("unicycles", ["duration=0.6", "network.loss=0.2"])
    recording = phalanx.run(scenario, engine="in-process").recording
    panels = steps.ages(ReportHistory(recording)).axes
    plots = content(Replay(recording), range(5), seekable=True).plots
    curves = [c for c in titled(plots, "Age of the oldest received input").curves if c.t]
    assert len(panels) == len(curves) > 0
    for axes, curve in zip(panels, curves, strict=True):
        t = np.asarray(axes.lines[0].get_xdata(), dtype=float)
        oldest = np.fmax.reduce([line.get_ydata() for line in axes.lines])
        at = np.abs(t[:, None] - curve.t).argmin(axis=0)
        np.testing.assert_allclose(oldest[at], curve.y, rtol=1e-3)
