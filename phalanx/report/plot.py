"""One look at a run: its paths, h, inputs and certified times, as matplotlib axes."""

from collections.abc import Callable, Mapping, Sequence

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.read import Recording
from phalanx.report.paths import draw_paths, draw_scene
from phalanx.report.safety import draw_h
from phalanx.report.steps import draw_certified, draw_shares
from phalanx.report.style import WIDTH, legend

_HEIGHT, _PATHS = 2.5, 5.0
"""Of a panel, and of the paths [inch]."""


def plot(
    recording: Recording,
    panels: Sequence[str] = (),
    axes: Mapping[str, Axes] | None = None,
) -> dict[str, Axes]:
    """Draw panels of a run, of PANELS, as Run.plot says."""
    chosen = tuple(panels or axes or PANELS)
    if unknown := [name for name in chosen if name not in PANELS]:
        raise ValueError(f"panel: expected {', '.join(PANELS)}, got {unknown[0]!r}")
    if lacking := [name for name in chosen if axes is not None and name not in axes]:
        raise ValueError(f"axes: expected some for each panel, got none for {lacking[0]!r}")
    if not recording.states:
        raise ValueError(f"{recording.path}: the recording holds no state: nothing to draw")
    history = ReportHistory(recording)
    axes_by_panel = dict(axes) if axes is not None else _new_axes(chosen)
    for name in chosen:
        PANELS[name](axes_by_panel[name], history)
    return {name: axes_by_panel[name] for name in chosen}


def _new_axes(panels: Sequence[str]) -> dict[str, Axes]:
    """Make a figure with a column of these panels, which pyplot shows."""
    heights = [_PATHS if name == "paths" else _HEIGHT for name in panels]
    figure = plt.figure(
        figsize=(WIDTH, sum(heights) + 0.3), layout="constrained", facecolor="white"
    )
    rows = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)[:, 0]
    return dict(zip(panels, rows, strict=True))


def _paths(axes: Axes, history: ReportHistory) -> None:
    draw_scene(axes, history, (0, 1))
    draw_paths(axes, history, (0, 1))
    legend(axes)


def _inputs(axes: Axes, history: ReportHistory) -> None:
    draw_shares(axes, history)
    axes.set_xlabel("t [s]")


PANELS: dict[str, Callable[[Axes, ReportHistory], None]] = {
    "paths": _paths,
    "h": draw_h,
    "inputs": _inputs,
    "certified": draw_certified,
}
"""What draws each panel, by its name."""
