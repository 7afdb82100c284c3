"""Figures of many agents: envelopes over all of them, and the worst few by name."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.arrays import Array
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Step
from phalanx.report.applied_inputs import input_box
from phalanx.report.control_steps import LEAST_RATIO, draw_time_shares
from phalanx.report.envelope import draw_envelope, envelope
from phalanx.report.measures import LinkStatistics, extremes_kept
from phalanx.report.style import FEW, LIMIT, MUTED, PEAK, WORST, legend, logarithmic, panels
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.origin import EMPTY, words_of

Curves = dict[str, tuple[Array, Array]]
"""Times [s] and values of each, by name."""

NORMAL, ADVERSARY = "#1f5fbf", "#d62728"
_EMPTY_INTERVALS = 100


def draw_crowd(axes: Axes, curves: Curves, worst: Sequence[str], of: str, unit: str) -> None:
    """Draw the envelope of all curves, and the worst ones over it."""
    t, values = (np.concatenate(column) for column in zip(*curves.values(), strict=True))
    each = int(np.median([len(times) for times, _ in curves.values()]))
    draw_envelope(axes, envelope(t, values, each), NORMAL, of)
    for name, colour in zip(worst, WORST, strict=False):
        t, values = curves[name]
        kept = extremes_kept(values)
        low, high = np.nanmin(values), np.nanmax(values)
        label = f"{name}: {low:.3g} to {high:.3g}{unit}"
        axes.step(t[kept], values[kept], where="post", color=colour, linewidth=0.8, label=label)
    axes.margins(x=0.01)
    legend(axes)


def inputs(recording: Recording, swarm: Swarm) -> Figure:
    """How much of their bounds normal agents use; and the steps with empty K_i, if there are."""
    steps = _normal_steps(recording, swarm)
    every = [s for of_agent in steps.values() for s in of_agent]
    figure, rows = panels(2 if any(s.origin in EMPTY for s in every) else 1, 2.6)
    curves = {}
    for i, of_agent in steps.items():
        box = input_box(swarm, i)
        if box is not None:
            u = np.array([s.u for s in of_agent])
            share = np.abs(u - (box.high + box.low) / 2.0) / ((box.high - box.low) / 2.0)
            curves[swarm.names[i]] = np.array([s.t_apply for s in of_agent]), share.max(axis=1)
    if curves:
        worst = sorted(curves, key=lambda name: -curves[name][1].mean())[:FEW]
        draw_crowd(rows[0], curves, worst, "normal agents", "")
        rows[0].axhline(1.0, color=LIMIT, linestyle=":", linewidth=1.2)
    rows[0].set_ylabel("largest share\nof an input's bound")
    for axes in rows[1:]:
        _draw_empty(axes, every)
    rows[-1].set_xlabel("t [s]")
    return figure


def _draw_empty(axes: Axes, steps: Sequence[Step]) -> None:
    """Share of the steps of each interval whose K_i was empty, by what became of it."""
    edges = np.linspace(0.0, max(s.t for s in steps), _EMPTY_INTERVALS + 1)
    total = np.maximum(np.histogram([s.t for s in steps], edges)[0], 1)
    below = np.zeros(_EMPTY_INTERVALS)
    for origin, colour in zip(EMPTY, (PEAK, "#f2a7a0"), strict=True):
        count = np.histogram([s.t for s in steps if s.origin == origin], edges)[0]
        above, label = below + 100.0 * count / total, f"{words_of(origin)} ({count.sum()} steps)"
        axes.stairs(above, edges, baseline=below, fill=True, color=colour, label=label)
        below = above
    axes.set_ylabel("steps with\nempty $K_i$ [%]")
    legend(axes, f"of {len(steps)} steps")


def certified(recording: Recording, swarm: Swarm) -> Figure | None:
    """Certified time of normal agents' inputs, in each one's τ; None where none was recorded."""
    curves = {}
    for i, steps in _normal_steps(recording, swarm).items():
        known = [(s.t_apply, s.certified) for s in steps if s.certified is not None]
        if known:
            t, proven = np.array(known).T
            curves[swarm.names[i]] = t, np.maximum(proven / swarm.horizon(i), LEAST_RATIO)
    if not curves:
        return None
    figure, (axes,) = panels(1, 3.0)
    worst = sorted(curves, key=lambda n: (curves[n][1].min(), curves[n][1].mean()))[:FEW]
    draw_crowd(axes, curves, worst, "normal agents", " τ")
    axes.axhline(1.0, color=LIMIT, linewidth=1.2)
    logarithmic(axes)
    failed = sum(_below(ratio) for _, ratio in curves.values())
    total = sum(len(ratio) for _, ratio in curves.values())
    axes.set_title(f"{failed} of {total} inputs below τ", loc="right", fontsize=10)
    axes.set_ylabel("certified time [τ]")
    axes.set_xlabel("t [s]")
    return figure


def ages(recording: Recording) -> Figure | None:
    """Age of the oldest û that each receiver had at its steps; None if nobody received any."""
    curves: Curves = {}
    for receiver, steps in steps_by_agent(recording).items():
        oldest = np.array([s.oldest_input for s in steps], dtype=float)
        if not np.isnan(oldest).all():
            curves[receiver] = np.array([s.t for s in steps]), 1e3 * oldest
    if not curves:
        return None
    figure, (axes,) = panels(1, 3.0)
    worst = sorted(curves, key=lambda name: -np.nanmax(curves[name][1]))[:FEW]
    draw_crowd(axes, curves, worst, "receivers", " ms")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("age of the oldest û [ms]")
    axes.set_xlabel("t [s]")
    return figure


def solve_times(recording: Recording, swarm: Swarm) -> Figure:
    """Share of all steps of a role, and of the slowest agents', that took longer than a time."""
    steps, normal = steps_by_agent(recording), {swarm.names[i] for i in swarm.normal}
    figure, (axes,) = panels(1, 3.2)
    for role, colour, names in (
        ("normal agents", NORMAL, [n for n in steps if n in normal]),
        ("adversaries", ADVERSARY, [n for n in steps if n not in normal]),
    ):
        draw_time_shares(axes, [s for name in names for s in steps[name]], colour, role, 2.2)
    late = {
        n: np.percentile([s.solve_time for s in found], 99) for n, found in steps.items() if found
    }
    for name, colour in zip(sorted(late, key=lambda n: -late[n]), WORST, strict=False):
        draw_time_shares(axes, steps[name], colour, name, 0.8)
    legend(axes)
    return figure


def losses(links: Sequence[LinkStatistics]) -> Figure:
    """Lost share of every link beside how many broadcasts were decided on it; needs a link."""
    figure, (axes,) = panels(1, 3.0)
    decided = np.array([link.decided for link in links])
    lost = np.array([100.0 * link.loss for link in links])
    axes.plot(decided, lost, ".", color=MUTED, markersize=3, alpha=0.6, label=f"{len(links)} links")
    n = np.linspace(1.0, decided.max(), 200)
    for p in sorted({link.model.loss for link in links})[:FEW]:
        spread = 200.0 * np.sqrt(p * (1.0 - p) / n)
        label = f"link model, {100 * p:.3g} %"
        (line,) = axes.plot(n, 0.0 * n + 100.0 * p, linewidth=1.2, label=label)
        band = np.maximum(100.0 * p - spread, 0.0), np.minimum(100.0 * p + spread, 100.0)
        label = "±2 standard deviations\nof independent losses"
        axes.fill_between(n, *band, color=line.get_color(), alpha=0.15, linewidth=0, label=label)
    worst = sorted(links, key=lambda link: -link.excess)[:FEW]
    for link, colour in zip(worst, WORST, strict=False):
        label = f"{link.sender} → {link.receiver}: {link.lost} of {link.decided}"
        axes.plot(link.decided, 100.0 * link.loss, "o", color=colour, markersize=4, label=label)
    axes.set_ylim(-2.0, 1.3 * max(5.0, lost.max()))
    axes.set_xlabel("broadcasts decided on a link")
    axes.set_ylabel("lost [%]")
    legend(axes)
    return figure


def _normal_steps(recording: Recording, swarm: Swarm) -> dict[int, list[Step]]:
    """Of those normal agents that made a step, by index."""
    steps = steps_by_agent(recording)
    return {i: steps[swarm.names[i]] for i in swarm.normal if steps[swarm.names[i]]}


def _below(ratio: Array) -> int:
    return int((ratio < 1.0).sum())
