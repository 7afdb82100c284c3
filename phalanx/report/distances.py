"""Figures of distances: of all pairs over time, beside what is required."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.arrays import Array
from phalanx.curves.history import RecordedHistory
from phalanx.curves.thinning import Series, envelope
from phalanx.report.style import (
    DASHES,
    FEW,
    LIMIT,
    MOST_NAMED,
    MUTED,
    NORMAL,
    WORST,
    colours,
    draw_envelope,
    draw_line,
    legend,
    logarithmic,
    panels,
    summarises,
)
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import Swarm
from phalanx.theory.safety.composition import Pair

_MOST_PAIRS = 60


class Nearest(NamedTuple):
    """How near others came to agents."""

    distances: Array
    """From each agent to whatever was nearest at each state [m], shape (s, n)."""
    closest: list[tuple[Pair, float]]
    """The pairs that came closest over the run, and how close [m], the closest first."""


def nearest(
    history: RecordedHistory, pairs: Sequence[Pair], agents: Sequence[int], most: int
) -> Nearest:
    """What of these pairs came nearest to these agents, and the `most` closest pairs.

    A pair's distances are made, used and dropped: those of all pairs would be too many to keep.
    """
    least = np.empty(len(pairs))
    shortest = {l: np.full(len(history.times), np.inf) for l in agents}
    for place, pair in enumerate(pairs):
        distance = history.distance(pair)
        least[place] = distance.min()
        for l in (pair.a, pair.b):
            if l in shortest:
                np.minimum(shortest[l], distance, out=shortest[l])
    order = np.argsort(least, kind="stable")[:most]
    closest = [(pairs[k], float(least[k])) for k in order]
    return Nearest(np.array(list(shortest.values())).T, closest)


def required_distance(scenario: Scenario) -> float | None:
    """What agents keep apart [m], if the safe-set function has a radius."""
    radius = getattr(scenario.safety.safe_set_function, "radius", None)
    return float(radius) if isinstance(radius, int | float) else None


def distances(history: RecordedHistory) -> Figure:
    """Distances of pairs over time, by kind of pair, with what is required.

    Of many agents, how far each normal one is from the nearest; and the closest few pairs.
    """
    kinds = _pairs_by_kind(history.swarm)
    figure, rows = panels(len(kinds), 2.4)
    for axes, (kind, found) in zip(rows, kinds.items(), strict=True):
        logarithmic(axes)
        for value in _required(found, history.scenario):
            axes.axhline(value, color=LIMIT, linestyle=":", linewidth=1.3)
        if summarises(history.scenario):
            _draw_nearest(axes, found, history)
            legend(axes, f"{kind}: from each normal agent\nto the nearest, and closest pairs")
        else:
            shown = _draw_pairs(axes, found, history)
            some = "" if len(found) == shown else f", {shown} closest of {len(found)}"
            legend(axes, f"{kind}{some}")
        axes.set_ylabel("distance [m]")
        axes.margins(x=0.01)
    rows[-1].set_xlabel("t [s]")
    return figure


def _required(pairs: Sequence[Pair], scenario: Scenario) -> set[float]:
    """Distances that some of these pairs must keep [m]."""
    between = required_distance(scenario)
    if between is None:
        return set()
    return {
        between if pair.obstacle is None else scenario.obstacles[pair.obstacle].clearance
        for pair in pairs
    }


def _pairs_by_kind(swarm: Swarm) -> dict[str, list[Pair]]:
    normal = set(swarm.normal)
    pairs, obstacles = swarm.safe_set.pairs, len(swarm.scenario.obstacles)
    kinds = {
        "normal–normal": [p for p in pairs if p.b in normal],
        "normal–adversary": [p for p in pairs if p.b is not None and p.b not in normal],
        "normal–obstacle": [p for p in pairs if p.obstacle is not None and p.obstacle < obstacles],
    }
    return {kind: found for kind, found in kinds.items() if found}


def _draw_pairs(axes: Axes, pairs: Sequence[Pair], history: RecordedHistory) -> int:
    """Draw the closest pairs, the closest first in the legend; returns how many."""
    every = {pair: history.distance(pair) for pair in pairs}
    closest = sorted(pairs, key=lambda pair: float(every[pair].min()))[:_MOST_PAIRS]
    palette, swarm = colours(history.scenario), history.swarm
    for place, pair in enumerate(closest):
        named = place < MOST_NAMED
        other = pair.obstacle if pair.b is None else pair.b
        draw_line(
            axes,
            Series(history.times, every[pair]),
            colour=palette[swarm.names[pair.a]] if named else MUTED,
            width=1.1 if named else 0.5,
            linestyle=DASHES[(other or 0) % len(DASHES)],
            label=_least(swarm, pair, float(every[pair].min())),
            zorder=2.5 if named else 2.0,
        )
    return len(closest)


def _draw_nearest(axes: Axes, pairs: Sequence[Pair], history: RecordedHistory) -> None:
    found = nearest(history, pairs, history.swarm.normal, FEW)
    drawn = envelope([Series(history.times, of_agent) for of_agent in found.distances.T])
    draw_envelope(axes, drawn, NORMAL, "all")
    for (pair, least), colour in zip(found.closest, WORST, strict=False):
        series, label = (
            Series(history.times, history.distance(pair)),
            _least(history.swarm, pair, least),
        )
        draw_line(axes, series, colour=colour, width=0.9, label=label)
    # Those who are far from everybody later would press what matters into the lowest part.
    axes.set_ylim(top=1.3 * float(drawn.values[-2].max()))


def _least(swarm: Swarm, pair: Pair, least: float) -> str:
    return f"{swarm.safe_set.label(pair)}, least {least:.3g} m"
