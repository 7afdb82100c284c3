"""Figures of links: the age of received inputs, and lost broadcasts."""

import numpy as np
from matplotlib.figure import Figure

from phalanx.recording.read import Recording, steps_by_agent
from phalanx.report.measures import LinkStatistics, extremes_kept
from phalanx.report.style import LIMIT, MUTED, colours, legend, panels

_MOST_LINKS = 40


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
