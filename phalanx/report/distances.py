"""Figures of distances: of all pairs over time, beside what is required."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.recording.read import Recording
from phalanx.report.envelope import draw_envelope, envelope
from phalanx.report.measures import Motion, extremes_kept, nearest
from phalanx.report.style import (
    DASHES,
    FEW,
    LIMIT,
    MOST_NAMED,
    MUTED,
    WORST,
    colours,
    legend,
    logarithmic,
    panels,
    summarises,
)
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import Swarm
from phalanx.theory.safety.composition import Pair

_MOST_PAIRS = 60


def required_distance(scenario: Scenario) -> float | None:
    """What agents keep apart [m], if the safe-set function has a radius."""
    radius = getattr(scenario.safety.safe_set_function(), "radius", None)
    return float(radius) if isinstance(radius, int | float) else None


def distances(recording: Recording, swarm: Swarm, motion: Motion) -> Figure:
    """Distances of pairs over time, by kind of pair, with what is required.

    Of many agents, how far each normal one is from the nearest; and the closest few pairs.
    """
    kinds = _pairs_by_kind(swarm)
    figure, rows = panels(len(kinds), 2.4)
    for axes, (kind, found) in zip(rows, kinds.items(), strict=True):
        logarithmic(axes)
        for value in _required(found, recording.scenario):
            axes.axhline(value, color=LIMIT, linestyle=":", linewidth=1.3)
        if summarises(recording.scenario):
            _draw_nearest(axes, found, swarm, motion)
            legend(axes, f"{kind}: from each normal agent\nto the nearest, and closest pairs")
        else:
            closest = _draw_pairs(axes, found, recording, swarm, motion)
            some = "" if len(found) == len(closest) else f", {len(closest)} closest of {len(found)}"
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


def _draw_pairs(
    axes: Axes, pairs: Sequence[Pair], recording: Recording, swarm: Swarm, motion: Motion
) -> list[Pair]:
    """Draw the closest pairs, the closest first in the legend; returns them."""
    least = {pair: float(motion.distance(pair).min()) for pair in pairs}
    closest = sorted(least, key=lambda pair: least[pair])[:_MOST_PAIRS]
    palette, label = colours(recording.scenario), swarm.safe_set.label
    for place, pair in enumerate(closest):
        distance = motion.distance(pair)
        kept = extremes_kept(distance)
        named = place < MOST_NAMED
        other = pair.obstacle if pair.b is None else pair.b
        axes.plot(
            motion.times[kept],
            distance[kept],
            color=palette[swarm.names[pair.a]] if named else MUTED,
            linestyle=DASHES[(other or 0) % len(DASHES)],
            linewidth=1.1 if named else 0.5,
            label=f"{label(pair)}, least {least[pair]:.3g} m",
            zorder=2.5 if named else 2.0,
        )
    return closest


def _draw_nearest(axes: Axes, pairs: Sequence[Pair], swarm: Swarm, motion: Motion) -> None:
    found = nearest(motion, pairs, swarm.normal, FEW)
    t = np.repeat(motion.times, found.distances.shape[1])
    drawn = envelope(t, found.distances.ravel(), len(motion.times))
    draw_envelope(axes, drawn, "#1f5fbf", "all")
    for (pair, least), colour in zip(found.closest, WORST, strict=False):
        distance = motion.distance(pair)
        kept = extremes_kept(distance)
        label = f"{swarm.safe_set.label(pair)}, least {least:.3g} m"
        axes.plot(motion.times[kept], distance[kept], color=colour, linewidth=0.9, label=label)
    # Those who are far from everybody later would press what matters into the lowest part.
    axes.set_ylim(top=1.3 * float(drawn.values[-2].max()))
