"""Statistics of links: losses and delays on each, with those of the scenario's link model."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.network.link import LinkModel
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.report.style import FEW, LIMIT, MUTED, WORST, current, legend, panels, summarises

_MOST_LINKS = 40


@dataclass
class LinkStatistics:
    """Fates of the broadcasts on one link, with the link's model."""

    sender: str
    receiver: str
    model: LinkModel
    sent: int
    """Broadcasts of the sender."""
    lost: int
    delays: list[float]
    """Of those not lost [s]."""

    @property
    def decided(self) -> int:
        """Broadcasts whose fate the receiver decided before the run ended."""
        return self.lost + len(self.delays)

    @property
    def loss(self) -> float:
        """Share of the decided broadcasts that were lost."""
        return self.lost / self.decided

    @property
    def excess(self) -> float:
        """Losses above the model's, in standard deviations of independent losses."""
        p, n = self.model.loss, self.decided
        return float((self.lost - n * p) / np.sqrt(n * p * (1.0 - p) + 1.0))


def link_statistics(recording: Recording) -> list[LinkStatistics]:
    """Every link on which a broadcast was decided, in the scenario's order of agents."""
    steps = steps_by_agent(recording)
    decided: dict[tuple[str, str], list[float]] = defaultdict(list)
    for step in recording.steps:
        for sender, _, delay in step.fates:
            decided[sender, step.agent].append(delay)
    found, links = [], recording.scenario.links()
    for sender, receiver in ((a, b) for a in steps for b in steps if (a, b) in decided):
        delays = decided[sender, receiver]
        kept = [delay for delay in delays if delay >= 0.0]
        model = links.model(sender, receiver)
        lost = len(delays) - len(kept)
        found.append(LinkStatistics(sender, receiver, model, len(steps[sender]), lost, kept))
    return found


def losses(recording: Recording, links: Sequence[LinkStatistics]) -> Figure:
    """Draw the lost share of links with the link model's; needs a link.

    With many agents, of every link over the number of broadcasts decided on it.
    """
    many = summarises(recording.scenario)
    figure, (axes,) = panels(1, 3.0 if many else 2.6)
    (_draw_all if many else _draw_worst)(axes, links)
    return figure


def _draw_worst(axes: Axes, links: Sequence[LinkStatistics]) -> None:
    chosen = set(map(id, sorted(links, key=lambda link: -link.loss)[:_MOST_LINKS]))
    shown = [link for link in links if id(link) in chosen]
    places = np.arange(len(shown))
    asked = np.array([link.model.loss for link in shown])
    spread = 2.0 * np.sqrt(asked * (1.0 - asked) / [link.decided for link in shown])
    axes.bar(places, [100 * link.loss for link in shown], width=0.6, color=MUTED, label="lost")
    axes.errorbar(
        places, 100 * asked, yerr=100 * spread, fmt="_", color=LIMIT, markersize=14, capsize=4,
        label="link model, ±2 standard deviations of independent losses",
    )  # fmt: skip
    axes.set_xticks(places, [f"{link.sender} → {link.receiver}" for link in shown])
    axes.tick_params(axis="x", rotation=90 if len(shown) > 14 else 0, labelsize=current().small)
    axes.set_ylim(0.0, max(1.0, 1.25 * axes.get_ylim()[1]))
    axes.set_ylabel("lost broadcasts [%]")
    axes.legend(fontsize=current().small, frameon=False, loc="upper right", ncols=2)


def _draw_all(axes: Axes, links: Sequence[LinkStatistics]) -> None:
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
