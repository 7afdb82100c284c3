"""Figures of safety over time: h_tot, ψ_k where q > 1, and distances with those required."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.recording.curves.history import RecordedHistory, ReportHistory
from phalanx.recording.curves.series import Series, envelope, extremes
from phalanx.recording.read import Recording
from phalanx.report import style
from phalanx.report.style import LIMIT, NORMAL, PEAK
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import Swarm, unit_of_psi
from phalanx.theory.arrays import Array
from phalanx.theory.safety.composition import Pair

_PSI_POINTS, _MANY_PSI_POINTS = 600, 100
"""Most states at which ψ_k is evaluated; with many agents it takes longer."""
_MOST_PAIRS = 60


class Worst(NamedTuple):
    """The largest h of a pair with a normal agent in a run."""

    h: float
    t: float
    """[s]"""


def worst(recording: Recording) -> Worst | None:
    """The worst h and its time; None if no state was recorded."""
    if not recording.states:
        return None
    if recording.summary:
        return Worst(recording.summary.worst_h, recording.summary.worst_at)
    largest = recording.h
    return Worst(float(largest.max()), float(recording.times[largest.argmax()]))


def safety(history: ReportHistory) -> Figure:
    """Draw h over time, and a second panel around zero if that was crossed; needs a state."""
    peak = worst(history.recording)
    assert peak is not None
    crossed = peak.h > 0.0
    figure, rows = style.over_time(2 if crossed else 1, 3.0)
    for axes in rows:
        draw_h(axes, history)
    if crossed:
        rows[0].set_xlabel("")
        rows[1].set_ylim(-2.0 * peak.h, 1.3 * peak.h)
        rows[1].set_title("", loc="right")
    style.legend(rows[0])
    return figure


def draw_h(axes: Axes, history: ReportHistory) -> None:
    """Draw h_tot and the largest h of a pair over time, with the worst h."""
    peak = worst(history.recording)
    assert peak is not None
    style.style_axes(axes)
    states = extremes(history.h_tot)
    axes.plot(
        history.times[states], history.h_tot[states], color=NORMAL, linewidth=1.2, label="$h_{tot}$"
    )
    states = extremes(history.h)
    t, h = history.times[states], np.where(np.isfinite(history.h), history.h, np.nan)[states]
    axes.plot(t, h, color="#111111", linewidth=0.9, label="largest h of a pair")
    axes.axhline(0.0, color=LIMIT, linewidth=1.2)
    axes.fill_between(t, h, 0.0, where=h > 0.0, interpolate=True, color=PEAK, alpha=0.5)
    axes.plot([peak.t], [peak.h], "o", color=PEAK, markersize=5)
    axes.set_ylabel(f"h [{unit_of_psi(history.scenario) or 'SI'}]")
    axes.set_xlabel("t [s]")
    axes.margins(x=0.01)
    axes.set_ylim(top=max(axes.get_ylim()[1], 0.06 * np.ptp(history.h_tot[states]), 0.1))
    style.title(axes, f"worst h {peak.h:.4g} at {peak.t:.3f} s", PEAK)


def psi(history: RecordedHistory) -> Figure | None:
    """Draw the largest ψ_1 ... ψ_{q-1} over time, at or below 0 in S_I; None where q = 1."""
    levels = history.values.psi_levels
    if not levels:
        return None
    points = _MANY_PSI_POINTS if style.summarises(history.scenario) else _PSI_POINTS
    chosen = np.unique(np.linspace(0, len(history.times) - 1, points).astype(int))
    t = history.times[chosen]
    largest = np.array([history.values.higher_psi(x) for x in history.x[chosen]])
    figure, rows = style.over_time(len(levels), 2.4)
    for k, values, axes in zip(levels, largest.T, rows, strict=True):
        axes.plot(t, values, color=NORMAL, linewidth=1.2)
        axes.axhline(0.0, color=LIMIT, linewidth=1.2)
        axes.fill_between(t, values, 0.0, where=values > 0.0, color=PEAK, alpha=0.5)
        axes.set_ylabel(f"largest $\\psi_{k}$ [{unit_of_psi(history.scenario, k) or 'SI'}]")
    return figure


class Nearest(NamedTuple):
    """Smallest distances of agents, and the pairs that came closest."""

    distances: Array
    """Distance from each agent to its nearest other at each state [m], shape (s, n)."""
    closest: list[tuple[Pair, float]]
    """The pairs that came closest over the run, and their least distance [m], in this order."""


def nearest(
    history: RecordedHistory, pairs: Sequence[Pair], agents: Sequence[int], most: int
) -> Nearest:
    """Smallest distance over these pairs to each of these agents, and the `most` closest pairs.

    Keeps no pair's distances: those of all pairs would need too much memory.
    """
    least = np.empty(len(pairs))
    shortest = {l: np.full(len(history.times), np.inf) for l in agents}
    for number, pair in enumerate(pairs):
        distance = history.distance(pair)
        least[number] = distance.min()
        for l in shortest.keys() & set(pair):
            np.minimum(shortest[l], distance, out=shortest[l])
    closest = [(pairs[k], float(least[k])) for k in np.argsort(least, kind="stable")[:most]]
    return Nearest(np.array(list(shortest.values())).T, closest)


def required_distance(scenario: Scenario) -> float | None:
    """Distance that agents must keep [m], if the safe-set function has a radius."""
    radius = getattr(scenario.safety.safe_set_function, "radius", None)
    return float(radius) if isinstance(radius, int | float) else None


def distances(history: RecordedHistory) -> Figure | None:
    """Draw distances of pairs over time, by kind of pair, with the distances required.

    With many agents, each normal agent's distance from its nearest; and the closest few pairs. None
    without a pair that has a distance: one agent within limits.
    """
    kinds = _pairs_by_kind(history.swarm)
    if not kinds:
        return None
    figure, rows = style.over_time(len(kinds), 2.4)
    for axes, (kind, pairs) in zip(rows, kinds.items(), strict=True):
        style.logarithmic(axes)
        for value in _required(pairs, history.scenario):
            axes.axhline(value, color=LIMIT, linestyle=":", linewidth=1.3)
        if style.summarises(history.scenario):
            _draw_nearest(axes, pairs, history)
            style.legend(axes, f"{kind}: from each normal agent\nto the nearest, and closest pairs")
        else:
            _draw_pairs(axes, pairs, history)
            some = f", {_MOST_PAIRS} closest of {len(pairs)}" if len(pairs) > _MOST_PAIRS else ""
            style.legend(axes, f"{kind}{some}")
        axes.set_ylabel("distance [m]")
    return figure


def _required(pairs: Sequence[Pair], scenario: Scenario) -> set[float]:
    """Distances that some of these pairs must keep [m]."""
    between = required_distance(scenario)
    if between is None:
        return set()
    required = [between] * len(list(scenario.roster())) + [o.clearance for o in scenario.obstacles]
    return {required[pair.b] for pair in pairs}


def _pairs_by_kind(swarm: Swarm) -> dict[str, list[Pair]]:
    normal, agents = set(swarm.normal), len(swarm.members)
    pairs, sides = swarm.safe_set.pairs, agents + len(swarm.scenario.obstacles)
    kinds = {
        "normal–normal": [p for p in pairs if p.b in normal],
        "normal–adversary": [p for p in pairs if p.b < agents and p.b not in normal],
        "normal–obstacle": [p for p in pairs if agents <= p.b < sides],
    }
    return {kind: of_kind for kind, of_kind in kinds.items() if of_kind}


def _draw_pairs(axes: Axes, pairs: Sequence[Pair], history: RecordedHistory) -> None:
    """Draw the closest pairs, the closest first in the legend."""
    palette, swarm = style.colours(history.scenario), history.swarm
    for rank, (pair, least) in enumerate(nearest(history, pairs, (), _MOST_PAIRS).closest):
        has_name = rank < style.MOST_NAMED
        style.draw_line(
            axes, Series(history.times, history.distance(pair)),
            colour=palette[swarm.names[pair.a]] if has_name else style.MUTED,
            width=1.1 if has_name else 0.5, zorder=2.5 if has_name else 2.0,
            linestyle=style.DASHES[pair.b % len(swarm.names) % len(style.DASHES)],
            label=f"{swarm.safe_set.label(pair)}, least {least:.3g} m",
        )  # fmt: skip


def _draw_nearest(axes: Axes, pairs: Sequence[Pair], history: RecordedHistory) -> None:
    nearest_pairs = nearest(history, pairs, history.swarm.normal, style.FEW)
    band = envelope([Series(history.times, of_agent) for of_agent in nearest_pairs.distances.T])
    style.draw_envelope(axes, band, NORMAL, "all")
    for (pair, least), colour in zip(nearest_pairs.closest, style.WORST, strict=False):
        series = Series(history.times, history.distance(pair))
        label = f"{history.swarm.safe_set.label(pair)}, least {least:.3g} m"
        style.draw_line(axes, series, colour=colour, width=0.9, label=label)
    # Agents that are far from all others later would press what matters into the lowest part.
    axes.set_ylim(top=1.3 * float(band.values[-2].max()))
