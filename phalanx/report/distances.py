"""Figures of the distances of all pairs over time, with the distances required."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.arrays import Array
from phalanx.curves.history import RecordedHistory
from phalanx.curves.thinning import Series, envelope
from phalanx.report import style
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import Swarm
from phalanx.theory.safety.composition import Pair

_MOST_PAIRS = 60


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
    for place, pair in enumerate(pairs):
        distance = history.distance(pair)
        least[place] = distance.min()
        for l in pair:
            if l in shortest:
                np.minimum(shortest[l], distance, out=shortest[l])
    order = np.argsort(least, kind="stable")[:most]
    closest = [(pairs[k], float(least[k])) for k in order]
    return Nearest(np.array(list(shortest.values())).T, closest)


def required_distance(scenario: Scenario) -> float | None:
    """Distance that agents must keep [m], if the safe-set function has a radius."""
    radius = getattr(scenario.safety.safe_set_function, "radius", None)
    return float(radius) if isinstance(radius, int | float) else None


def distances(history: RecordedHistory) -> Figure:
    """Distances of pairs over time, by kind of pair, with the distances required.

    With many agents, each normal agent's distance from its nearest; and the closest few pairs.
    """
    kinds = _pairs_by_kind(history.swarm)
    figure, rows = style.panels(len(kinds), 2.4)
    for axes, (kind, found) in zip(rows, kinds.items(), strict=True):
        style.logarithmic(axes)
        for value in _required(found, history.scenario):
            axes.axhline(value, color=style.LIMIT, linestyle=":", linewidth=1.3)
        if style.summarises(history.scenario):
            _draw_nearest(axes, found, history)
            style.legend(axes, f"{kind}: from each normal agent\nto the nearest, and closest pairs")
        else:
            shown = _draw_pairs(axes, found, history)
            some = "" if len(found) == shown else f", {shown} closest of {len(found)}"
            style.legend(axes, f"{kind}{some}")
        axes.set_ylabel("distance [m]")
        axes.margins(x=0.01)
    rows[-1].set_xlabel("t [s]")
    return figure


def _required(pairs: Sequence[Pair], scenario: Scenario) -> set[float]:
    """Distances that some of these pairs must keep [m]."""
    between = required_distance(scenario)
    if between is None:
        return set()
    distances = [between] * len(list(scenario.roster())) + [o.clearance for o in scenario.obstacles]
    return {distances[pair.b] for pair in pairs}


def _pairs_by_kind(swarm: Swarm) -> dict[str, list[Pair]]:
    normal = set(swarm.normal)
    pairs, agents = swarm.safe_set.pairs, len(swarm.members)
    sides = agents + len(swarm.scenario.obstacles)
    kinds = {
        "normal–normal": [p for p in pairs if p.b in normal],
        "normal–adversary": [p for p in pairs if p.b < agents and p.b not in normal],
        "normal–obstacle": [p for p in pairs if agents <= p.b < sides],
    }
    return {kind: found for kind, found in kinds.items() if found}


def _draw_pairs(axes: Axes, pairs: Sequence[Pair], history: RecordedHistory) -> int:
    """Draw the closest pairs, the closest first in the legend; return their number."""
    closest = nearest(history, pairs, (), _MOST_PAIRS).closest
    palette, swarm = style.colours(history.scenario), history.swarm
    for place, (pair, least) in enumerate(closest):
        named = place < style.MOST_NAMED
        style.draw_line(
            axes,
            Series(history.times, history.distance(pair)),
            colour=palette[swarm.names[pair.a]] if named else style.MUTED,
            width=1.1 if named else 0.5,
            linestyle=style.DASHES[pair.b % len(swarm.names) % len(style.DASHES)],
            label=_pair_label(swarm, pair, least),
            zorder=2.5 if named else 2.0,
        )
    return len(closest)


def _draw_nearest(axes: Axes, pairs: Sequence[Pair], history: RecordedHistory) -> None:
    found = nearest(history, pairs, history.swarm.normal, style.FEW)
    drawn = envelope([Series(history.times, of_agent) for of_agent in found.distances.T])
    style.draw_envelope(axes, drawn, style.NORMAL, "all")
    for (pair, least), colour in zip(found.closest, style.WORST, strict=False):
        series = Series(history.times, history.distance(pair))
        label = _pair_label(history.swarm, pair, least)
        style.draw_line(axes, series, colour=colour, width=0.9, label=label)
    # Agents that are far from all others later would press what matters into the lowest part.
    axes.set_ylim(top=1.3 * float(drawn.values[-2].max()))


def _pair_label(swarm: Swarm, pair: Pair, least: float) -> str:
    return f"{swarm.safe_set.label(pair)}, least {least:.3g} m"
