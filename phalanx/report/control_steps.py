"""Figures of control steps: how long their inputs are certified, and the wall time they took."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Step
from phalanx.report.measures import extremes_kept
from phalanx.report.style import LIMIT, PEAK, colours, legend, logarithmic, panels
from phalanx.swarm.swarm import Swarm

_TIME_POINTS = 600
LEAST_RATIO = 0.1
"""Where a certified time is drawn that is shorter than this share of τ: no logarithm has a 0."""


def certified(recording: Recording, swarm: Swarm) -> Figure | None:
    """Certified time of each normal agent's inputs, in its τ; None where none was recorded."""
    figure, (axes,) = panels(1, 3.0)
    palette, steps = colours(recording.scenario), steps_by_agent(recording)
    for i in swarm.normal:
        name = swarm.names[i]
        known = [(s.t_apply, s.certified) for s in steps[name] if s.certified is not None]
        if not known:
            continue
        t, proven = np.array(known).T
        ratio = np.maximum(proven / swarm.horizon(i), LEAST_RATIO)
        kept, below = extremes_kept(ratio), ratio < 1.0
        label = f"{name}: shortest {proven.min() / swarm.horizon(i):.3g} τ"
        axes.plot(t[kept], ratio[kept], color=palette[name], linewidth=0.8, label=label)
        if below.any():
            label = f"{name}: below τ ({below.sum()} of {len(below)})"
            axes.scatter(t[below], ratio[below], marker="x", s=22, color=PEAK, label=label)
    if not axes.lines:
        return None
    axes.axhline(1.0, color=LIMIT, linewidth=1.2)
    logarithmic(axes)
    axes.margins(x=0.01)
    axes.set_ylabel("certified time [τ]")
    axes.set_xlabel("t [s]")
    legend(axes, "agent")
    return figure


def solve_times(recording: Recording) -> Figure:
    """Share of each agent's steps that took longer than a wall time; needs a step."""
    figure, (axes,) = panels(1, 3.2)
    palette = colours(recording.scenario)
    for name, steps in steps_by_agent(recording).items():
        draw_time_shares(axes, steps, palette[name], name, 1.3)
    legend(axes, "agent")
    return figure


def draw_time_shares(
    axes: Axes, steps: Sequence[Step], colour: str, name: str, width: float
) -> None:
    """Draw what share of these steps, if there are any, took longer than a wall time."""
    if not steps:
        return
    taken = np.sort([1e3 * s.solve_time for s in steps])
    longer = 1.0 - np.arange(len(taken)) / len(taken)
    middle, late = np.percentile(taken, [50, 99])
    label = f"{name}: median {middle:.3g}, 99 % {late:.3g} ms"
    # The slowest step, and ever fewer of those that are ever faster: the axis is logarithmic.
    kept = np.unique(len(taken) - np.geomspace(1, len(taken), _TIME_POINTS).astype(int))
    axes.plot(taken[kept], longer[kept], color=colour, linewidth=width, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda share, _: f"{100 * share:g} %")
    axes.xaxis.set_major_formatter(lambda ms, _: f"{ms:g}")
    axes.set_xlabel("wall time of a step [ms]")
    axes.set_ylabel("steps that took at least this long")
