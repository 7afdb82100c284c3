"""Figures over time: safety, inputs, ages of received inputs; and solve times and losses."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Step
from phalanx.report.measures import (
    LinkStatistics,
    extremes_kept,
    worst,
)
from phalanx.report.style import (
    LIMIT,
    MUTED,
    PEAK,
    colours,
    legend,
    logarithmic,
    panels,
    summarises,
)
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.swarm.units import unit_of_psi
from phalanx.theory.models.polytope import Box, constant_polytope
from phalanx.theory.models.units import units
from phalanx.theory.rows.origin import Origin

Array = NDArray[np.float64]

_MOST_LINKS = 40
_PSI_POINTS, _CROWD_PSI_POINTS = 600, 100
"""Most states at which ψ_k is evaluated; of many agents it takes longer."""
_TIME_POINTS = 600
LEAST_RATIO = 0.1
"""Where a certified time is drawn that is shorter than this share of τ: no logarithm has a 0."""


def safety(recording: Recording, largest: Array | None = None) -> Figure:
    """h_tot over time with the zero line, and a closer look if it was crossed; needs a state.

    largest: the largest h of a pair at each state, to be drawn as well.
    """
    peak = worst(recording)
    assert peak is not None
    figure, rows = panels(2 if peak.h_tot > 0.0 else 1, 3.0)
    kept = extremes_kept(recording.h_tot)
    t, h = recording.times[kept], recording.h_tot[kept]
    for axes in rows:
        axes.plot(t, h, color="#1f5fbf", linewidth=1.2, label=r"$h_{tot}$")
        if largest is not None:
            label = "largest h of a pair"
            axes.plot(recording.times, largest, color="#111111", linewidth=0.9, label=label)
        axes.axhline(0.0, color=LIMIT, linewidth=1.2)
        axes.fill_between(t, h, 0.0, where=h > 0.0, interpolate=True, color=PEAK, alpha=0.5)
        axes.plot([peak.t], [peak.h_tot], "o", color=PEAK, markersize=5)
        axes.set_ylabel(f"$h_{{tot}}$ [{unit_of_psi(recording.scenario) or 'SI'}]")
        axes.margins(x=0.01)
    rows[0].set_ylim(top=max(rows[0].get_ylim()[1], 0.06 * np.ptp(h), 0.1))
    if peak.h_tot > 0.0:
        rows[1].set_ylim(-2.0 * peak.h_tot, 1.3 * peak.h_tot)
    words = f"worst {peak.h_tot:.4g} at {peak.t:.3f} s"
    rows[0].set_title(words, loc="right", color=PEAK, fontsize=10)
    rows[-1].set_xlabel("t [s]")
    if largest is not None:
        legend(rows[0])
    return figure


def psi(recording: Recording, rows: SafetyRows) -> Figure | None:
    """The largest ψ_1 ... ψ_{q-1} over time; None where q is 1. At or below 0 it is in S_I."""
    q = rows.relative_degree
    if q == 1:
        return None
    points = _CROWD_PSI_POINTS if summarises(recording.scenario) else _PSI_POINTS
    chosen = np.unique(np.linspace(0, len(recording.states) - 1, points).astype(int))
    invariants, x = rows.invariants(), recording.x
    largest = np.array([invariants(x[k]).reshape(-1, q).max(axis=0) for k in chosen])
    figure, panes = panels(q - 1, 2.4)
    t = recording.times[chosen]
    for k, axes in enumerate(panes, start=1):
        values = largest[:, k]
        axes.plot(t, values, color="#1f5fbf", linewidth=1.2)
        axes.axhline(0.0, color=LIMIT, linewidth=1.2)
        axes.fill_between(t, values, 0.0, where=values > 0.0, color=PEAK, alpha=0.5)
        unit = unit_of_psi(recording.scenario, k) or "SI"
        axes.set_ylabel(f"largest $\\psi_{k}$ [{unit}]")
        axes.margins(x=0.01)
        at = int(values.argmax())
        words = f"largest {values[at]:.4g} at {t[at]:.3f} s"
        axes.set_title(words, loc="right", color=PEAK if values[at] > 0.0 else LIMIT, fontsize=10)
    panes[-1].set_xlabel("t [s]")
    return figure


class Curve(NamedTuple):
    """One quantity of an agent's steps."""

    label: str
    values: Array
    """shape (s,)"""
    bounds: tuple[float, ...]
    nominal: Array | None = None
    """What its law would have had, shape (s,)."""


def inputs(recording: Recording, swarm: Swarm, i: int) -> Figure:
    """Agent i's inputs beside the nominal ones, their bounds, and a mark where K_i was empty."""
    name = swarm.members[i].name
    steps = steps_by_agent(recording)[name]
    wanted = np.array([s.u_nom for s in steps]) if all(s.u_nom for s in steps) else None
    curves = input_curves(swarm, i, np.array([s.u for s in steps]), wanted)
    figure, rows = panels(len(curves), 1.9)
    applied = np.array([s.t_apply for s in steps])
    held_until = max(recording.times[-1], applied[-1])
    for curve, axes in zip(curves, rows, strict=True):
        if curve.nominal is not None:
            kept = extremes_kept(curve.nominal)
            axes.step(
                applied[kept],
                curve.nominal[kept],
                where="post",
                color=MUTED,
                linewidth=0.7,
            )
        kept = extremes_kept(curve.values)
        axes.step(
            [*applied[kept], held_until],
            [*curve.values[kept], curve.values[-1]],
            where="post",
            color=colours(recording.scenario)[name],
            linewidth=0.9,
        )
        for bound in curve.bounds:
            axes.axhline(bound, color=LIMIT, linestyle=":", linewidth=1.2)
        _mark_fallbacks(axes, steps, curve.values)
        axes.set_ylabel(curve.label)
        axes.margins(x=0.01)
        axes.set_ylim(*_shown(curve))
    rows[-1].set_xlabel("t [s]")
    rows[0].plot([], [], color=colours(recording.scenario)[name], label="applied")
    if wanted is not None:
        rows[0].plot([], [], color=MUTED, label="nominal")
    legend(rows[0], f"agent {name}")
    return figure


def _shown(curve: Curve) -> tuple[float, float]:
    """Where a curve and its bounds lie, and a little more: a nominal input may lie far outside."""
    values = [*curve.bounds, float(curve.values.min()), float(curve.values.max())]
    margin = 0.12 * (max(values) - min(values)) or 1.0
    return min(values) - margin, max(values) + margin


def input_curves(swarm: Swarm, i: int, u: Array, nominal: Array | None = None) -> list[Curve]:
    """Every component of agent i's inputs u, shape (s, m_i); before them ‖u‖_∞ if U_i is its ball.

    The norm is what the paper plots of Simulation 2.
    """
    names, box = swarm.members[i].dynamics.inputs, input_box(swarm, i)
    bounds = [(box.low[c], box.high[c]) if box else () for c in range(len(names))]
    of_input = units(swarm.members[i].dynamics).inputs
    curves = [
        Curve(
            f"{n} [{of_input[n] or 'SI'}]",
            u[:, c],
            bounds[c],
            None if nominal is None else nominal[:, c],
        )
        for c, n in enumerate(names)
    ]
    radius = box.high[0] if box else np.nan
    if box and len(names) > 1 and (box.high == radius).all() and (box.low == -radius).all():
        unit = of_input[names[0]] or "SI"
        curves.insert(0, Curve(f"‖u‖∞ [{unit}]", np.abs(u).max(axis=1), (radius,)))
    return curves


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


def _mark_fallbacks(axes: Axes, steps: list[Step], values: Array) -> None:
    origins, applied = np.array([s.origin for s in steps]), np.array([s.t_apply for s in steps])
    for origin, colour, size in (
        (Origin.NO_AUTHORITY, "#f2a7a0", 14),
        (Origin.BACKUP, "#e00000", 26),
    ):
        marked = origins == origin
        label = f"{origin} ({marked.sum()} steps)"
        places = applied[marked], values[marked]
        axes.scatter(
            *places, marker="x", s=size, linewidths=1.0, color=colour, label=label, zorder=3
        )


def input_box(swarm: Swarm, i: int) -> Box | None:
    """Agent i's bounds, if U_i is a box that does not depend on the state."""
    composed = swarm.safe_set
    A, b = swarm.members[i].dynamics.input_polytope(composed.x[composed.parts[i]])
    known = constant_polytope(A, b)
    return known.box if known else None


def ages(recording: Recording) -> Figure | None:
    """Ages of the û_l that each receiver had at its steps; None if nobody received anything."""
    names = [name for name, _, _ in recording.scenario.roster()]
    received = {}
    for receiver, steps in steps_by_agent(recording).items():
        known = [dict(s.ages) for s in steps]
        age = np.array([[each.get(name, np.nan) for name in names] for each in known])
        if np.isfinite(age).any():
            received[receiver] = np.array([s.t for s in steps]), 1e3 * age
    if not received:
        return None
    figure, rows = panels(len(received), 1.7)
    palette = colours(recording.scenario)
    for (receiver, (t, age)), axes in zip(received.items(), rows, strict=True):
        senders = np.flatnonzero(np.isfinite(age).any(axis=0))
        for l in sorted(senders, key=lambda l: -np.nanmax(age[:, l])):
            kept = extremes_kept(age[:, l])
            label = f"from {names[l]}, oldest {np.nanmax(age[:, l]):.3g} ms"
            colour = palette[names[l]]
            axes.plot(t[kept], age[kept, l], color=colour, linewidth=0.7, alpha=0.85, label=label)
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.01)
        axes.set_ylabel("age of û [ms]")
        legend(axes, f"received by {receiver}", most=7)
    rows[-1].set_xlabel("t [s]")
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


def losses(links: list[LinkStatistics]) -> Figure:
    """Lost share of the links that lost most, next to the link model's; needs a link."""
    figure, (axes,) = panels(1, 2.6)
    chosen = set(map(id, sorted(links, key=lambda link: -link.loss)[:_MOST_LINKS]))
    shown = [link for link in links if id(link) in chosen]
    places = np.arange(len(shown))
    asked = np.array([link.model.loss for link in shown])
    spread = 2.0 * np.sqrt(asked * (1.0 - asked) / [link.decided for link in shown])
    axes.bar(places, [100 * link.loss for link in shown], width=0.6, color=MUTED, label="lost")
    axes.errorbar(
        places,
        100 * asked,
        yerr=100 * spread,
        fmt="_",
        color=LIMIT,
        markersize=14,
        capsize=4,
        label="link model, ±2 standard deviations of independent losses",
    )
    axes.set_xticks(places, [f"{link.sender} → {link.receiver}" for link in shown])
    axes.tick_params(axis="x", rotation=90 if len(shown) > 14 else 0, labelsize=8)
    axes.set_ylim(0.0, max(1.0, 1.25 * axes.get_ylim()[1]))
    axes.set_ylabel("lost broadcasts [%]")
    axes.legend(fontsize=8, frameon=False, loc="upper right", ncols=2)
    return figure
