"""Figures of control steps: inputs, certified times, ages of û, wall times, disturbances.

Up to 12 agents are drawn one by one; more agents as an envelope, and the worst few by name.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.recording.curves.history import (
    EMPTY_CODES,
    AgentSeries,
    RecordedHistory,
    ReportHistory,
)
from phalanx.recording.curves.series import (
    InputCurve,
    Series,
    input_curves,
    input_polytope,
    step_series,
)
from phalanx.recording.disturbances import disturbances_of
from phalanx.report import style
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import EMPTY, Origin, origin_label

_TIME_POINTS = 600
_EMPTY_INTERVALS = 100
_LIGHT = "#f2a7a0"


def certified(history: RecordedHistory) -> Figure | None:
    """Draw certified times of each normal agent's inputs, in its τ; None without any."""
    if not _curves(history, "certified", history.swarm.normal):
        return None
    figure, (axes,) = style.panels(1, 3.0)
    draw_certified(axes, history)
    return figure


def draw_certified(axes: Axes, history: RecordedHistory) -> None:
    """Draw the same on given axes, with what is below τ counted."""
    swarm, palette = history.swarm, style.colours(history.scenario)
    style.style_axes(axes)
    every = _curves(history, "certified", swarm.normal)
    curves = {name: series.finite() for name, series in every.items()}
    if curves and style.summarises(history.scenario):
        style.draw_many(axes, curves, lambda y: (y.min(), y.mean()), "normal agents", " τ")
        ratios = np.concatenate([ratio for _, ratio in curves.values()])
        style.title(axes, f"{(ratios < 1.0).sum()} of {len(ratios)} inputs below τ")
    else:
        for name, (t, ratio) in curves.items():
            i, below = swarm.names.index(name), ratio < 1.0
            shortest = np.nanmin(history.agent(i).numbers["certified"]) / swarm.horizon(i)
            label = f"{name}: shortest {shortest:.3g} τ"
            style.draw_line(axes, Series(t, ratio), colour=palette[name], label=label)
            if below.any():
                label = f"{name}: below τ ({below.sum()} of {len(below)})"
                axes.scatter(
                    t[below], ratio[below], marker="x", s=22, color=style.PEAK, label=label
                )
        style.legend(axes, "agent")
    axes.axhline(1.0, color=style.LIMIT, linewidth=1.2)
    style.logarithmic(axes)
    axes.margins(x=0.01)
    axes.set_ylabel("certified time [τ]")
    axes.set_xlabel("t [s]")


def _curves(history: RecordedHistory, number: str, agents: Sequence[int]) -> dict[str, Series]:
    """A number of these agents' steps as plotted, by name; only of agents of which it is known."""
    every = step_series(history.swarm, number, {i: history.agent(i) for i in agents})
    return {history.swarm.names[i]: s for i, s in every.items() if len(s.finite().t)}


def ages(history: ReportHistory) -> Figure | None:
    """Draw ages of the û_l that each receiver used at its steps; None without any.

    With many agents, only of each one's oldest û_l.
    """
    names, palette = history.swarm.names, style.colours(history.scenario)
    curves = _curves(history, "oldest_input", range(len(names)))
    if not curves:
        return None
    if style.summarises(history.scenario):
        figure, (axes,) = style.over_time(1, 3.0)
        style.draw_many(axes, curves, lambda y: -np.nanmax(y), "receivers", " ms")
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel("age of the oldest û [ms]")
        return figure
    figure, rows = style.over_time(len(curves), 1.7)
    for receiver, axes in zip(curves, rows, strict=True):
        i = names.index(receiver)
        by_sender = [dict(step.ages) for step in history.steps[i]]
        age = 1e3 * np.array([[ages.get(l, np.nan) for l in names] for ages in by_sender])
        senders = np.flatnonzero(np.isfinite(age).any(axis=0))
        for l in sorted(senders, key=lambda l: -np.nanmax(age[:, l])):
            label = f"from {names[l]}, oldest {np.nanmax(age[:, l]):.3g} ms"
            series, colour = Series(history.agent(i).t, age[:, l]), palette[names[l]]
            style.draw_line(axes, series, colour=colour, width=0.7, alpha=0.85, label=label)
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel("age of û [ms]")
        style.legend(axes, f"received by {receiver}", most=7)
    return figure


def inputs(history: RecordedHistory, i: int) -> Figure:
    """Draw agent i's inputs, the nominal ones, their bounds, and a mark where K_i was empty."""
    steps, name = history.agent(i), history.swarm.names[i]
    curves, colour = input_curves(history.swarm, i, steps), style.colours(history.scenario)
    curves = [*_norm(history, i, curves), *curves]
    figure, rows = style.over_time(len(curves), 1.9)
    last = max(history.times[-1], steps.t[-1])
    has_nominal = bool(np.isfinite(steps.u_nom).all())
    for curve, axes in zip(curves, rows, strict=True):
        applied = curve.applied
        if has_nominal:
            style.draw_line(axes, curve.nominal, colour=style.MUTED, width=0.7, stairs=True)
        style.draw_line(axes, applied.extended(last), colour=colour[name], width=0.9, stairs=True)
        bounds = [bound for bound in curve.bounds if bound is not None]
        for bound in bounds:
            axes.axhline(bound, color=style.LIMIT, linestyle=":", linewidth=1.2)
        _mark_empty(axes, steps, applied.y)
        axes.set_ylabel(f"{curve.name} [{curve.unit or 'SI'}]")
        # A nominal input may lie far outside, and is cut off.
        low, high = (f([*bounds, *applied.y]) for f in (min, max))
        margin = 0.12 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)
    rows[0].plot([], [], color=colour[name], label="applied")
    if has_nominal:
        rows[0].plot([], [], color=style.MUTED, label="nominal")
    style.legend(rows[0], f"agent {name}")
    return figure


def _norm(history: RecordedHistory, i: int, curves: list[InputCurve]) -> list[InputCurve]:
    """The curve of ‖u‖_∞, as in the paper's Simulation 2, if U_i is a ball of that norm."""
    U, first = input_polytope(history.swarm, i), curves[0]
    if len(curves) < 2 or U is None or U.box is None:
        return []
    bounds = {*(-U.box.low).tolist(), *U.box.high.tolist()}
    if len(bounds) > 1:
        return []
    norm = np.max([np.abs(curve.applied.y) for curve in curves], axis=0)
    applied, unknown = Series(first.applied.t, norm), Series(norm[:0], norm[:0])
    return [InputCurve("‖u‖∞", first.unit, applied, unknown, (None, *bounds))]


def _mark_empty(axes: Axes, steps: AgentSeries, values: Array) -> None:
    for origin, colour, size in ((Origin.NO_AUTHORITY, _LIGHT, 14), (Origin.BACKUP, "#e00000", 26)):
        marked = steps.empty == EMPTY_CODES[origin]
        label = f"{origin_label(origin)} ({marked.sum()} steps)" if marked.any() else None
        points = steps.t[marked], values[marked]
        axes.scatter(
            *points, marker="x", s=size, linewidths=1.0, color=colour, label=label, zorder=3
        )


def inputs_of_all(history: RecordedHistory) -> Figure:
    """Draw the share of their bounds that normal agents use, and the steps with empty K_i.

    Only where U_i is a box: other polytopes have no bound of one input alone.
    """
    series = [history.agent(i) for i in history.swarm.normal]
    any_empty = any(steps.empty.any() for steps in series)
    figure, rows = style.over_time(2 if any_empty else 1, 2.6)
    draw_shares(rows[0], history)
    if any_empty:
        _draw_empty(rows[1], series)
    return figure


def draw_shares(axes: Axes, history: RecordedHistory) -> None:
    """Draw the share of their bounds that normal agents use; each by name if they are few."""
    style.style_axes(axes)
    swarm, palette, curves = history.swarm, style.colours(history.scenario), dict[str, Series]()
    for i in swarm.normal:
        U, steps = input_polytope(swarm, i), history.agent(i)
        if len(steps.t) and U and U.box:
            low, high = U.box.low, U.box.high
            share = np.abs(steps.u - (high + low) / 2.0) / ((high - low) / 2.0)
            curves[swarm.names[i]] = Series(steps.t, share.max(axis=1))
    if curves and style.summarises(history.scenario):
        style.draw_many(axes, curves, lambda y: -y.mean(), "normal agents")
    elif curves:
        for name, series in curves.items():
            label = f"{name}: {series.y.mean():.0%} on average"
            style.draw_line(axes, series, colour=palette[name], stairs=True, label=label)
        axes.margins(x=0.01)
        style.legend(axes, "agent")
    if curves:
        axes.axhline(1.0, color=style.LIMIT, linestyle=":", linewidth=1.2)
    axes.set_ylabel("largest share\nof an input's bound")


def _draw_empty(axes: Axes, series: Sequence[AgentSeries]) -> None:
    """Draw the share of each interval's steps whose K_i was empty, by the input's origin."""
    t, empty = (np.concatenate([getattr(s, name) for s in series]) for name in ("sampled", "empty"))
    edges = np.linspace(0.0, t.max(), _EMPTY_INTERVALS + 1)
    total = np.maximum(np.histogram(t, edges)[0], 1)
    below = np.zeros(_EMPTY_INTERVALS)
    for origin, colour in zip(EMPTY, (style.PEAK, _LIGHT), strict=True):
        count = np.histogram(t[empty == EMPTY_CODES[origin]], edges)[0]
        above = below + 100.0 * count / total
        label = f"{origin_label(origin)} ({count.sum()} steps)"
        axes.stairs(above, edges, baseline=below, fill=True, color=colour, label=label)
        below = above
    axes.set_ylabel("steps with\nempty $K_i$ [%]")
    style.legend(axes, f"of {len(t)} steps")


def solve_times(history: RecordedHistory) -> Figure:
    """Draw the share of each agent's steps that took longer than a wall time; needs a step.

    With many agents, of all steps of a role, and of the slowest agents' steps.
    """
    names, normal = history.swarm.names, set(history.swarm.normal)
    every = [1e3 * history.agent(i).numbers["solve_time"] for i in range(len(names))]
    figure, (axes,) = style.panels(1, 3.2)
    if not style.summarises(history.scenario):
        palette = style.colours(history.scenario)
        for name, times in zip(names, every, strict=True):
            _draw_time_shares(axes, times, palette[name], name, 1.3)
        style.legend(axes, "agent")
        return figure
    roles = ("normal agents", style.NORMAL, True), ("adversaries", style.ADVERSARY, False)
    for role, colour, is_normal in roles:
        of_role = [times for i, times in enumerate(every) if (i in normal) == is_normal]
        _draw_time_shares(axes, np.concatenate([*of_role, []]), colour, role, 2.2)
    late = {i: np.percentile(times, 99) for i, times in enumerate(every) if len(times)}
    slowest = sorted(late, key=lambda i: -late[i])[: style.FEW]
    for i, colour in zip(slowest, style.WORST, strict=False):
        _draw_time_shares(axes, every[i], colour, names[i], 0.8)
    style.legend(axes)
    return figure


def _draw_time_shares(axes: Axes, times: Array, colour: str, name: str, width: float) -> None:
    """Draw the share of steps that took at least a wall time; times: of each [ms], shape (s,)."""
    if not len(times):
        return
    times = np.sort(times)
    longer = 1.0 - np.arange(len(times)) / len(times)
    middle, late = np.percentile(times, [50, 99])
    label = f"{name}: median {middle:.3g}, 99 % {late:.3g} ms"
    # Every slow step, and fewer and fewer of the faster ones: the axis is logarithmic.
    samples = np.unique(len(times) - np.geomspace(1, len(times), _TIME_POINTS).astype(int))
    axes.plot(times[samples], longer[samples], color=colour, linewidth=width, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda share, _: f"{100 * share:g} %")
    axes.xaxis.set_major_formatter(lambda ms, _: f"{ms:g}")
    axes.set_xlabel("wall time of a step [ms]")
    axes.set_ylabel("steps that took at least this long")


def disturbances(history: ReportHistory) -> Figure | None:
    """Draw the disturbance that each agent needed, against its declared bound.

    None without an interval to explain.
    """
    swarm, palette = history.swarm, style.colours(history.scenario)
    every = zip(swarm.names, disturbances_of(history.recording, swarm), strict=True)
    curves = {
        name: Series(needed.t, np.where(np.isfinite(needed.size), needed.size, np.nan))
        for name, needed in every
        if len(needed.t)
    }
    if not curves:
        return None
    figure, (axes,) = style.over_time(1, 3.0)
    if style.summarises(history.scenario):
        style.draw_many(axes, curves, lambda y: -np.nanmax(y), "agents")
    else:
        for name, curve in curves.items():
            style.draw_line(axes, curve, colour=palette[name], stairs=True, label=name)
        style.legend(axes)
    for bound in {group.disturbance.bound for group in swarm.groups}:
        axes.axhline(bound, color=style.LIMIT, linewidth=1.2)
    axes.set_ylabel("disturbance needed")
    return figure
