"""Figures of links: the space-time diagram of all broadcasts, and losses on each link."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from phalanx.network.link import LinkModel
from phalanx.recording.curves.history import FATES, IN_TIME, LATE, LOST, ReportHistory
from phalanx.recording.curves.series import LANE_STATES, lanes, zoom_window
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.report import style
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin

_MOST_LINKS = 40
_COLOURS = {
    IN_TIME: "#9fb2ca",
    LATE: "#e8a200",
    LOST: "#d62728",
    Origin.BACKUP: "#f97316",
    Origin.NO_AUTHORITY: "#c084fc",
    "silent": "#475569",
}
_MOST_INTERVALS = 400
"""Most intervals of the whole run."""
_MOST_LANES = 24
"""Most lanes of three rows each, and most agents' names on the axis."""
_LANE, _MOST_HIGH = 0.34, 7.0
"""[inch]"""
_DOTS = (
    ("#1f5fbf", "o", {*Origin} - {Origin.ATTACK, Origin.BACKUP, Origin.NO_AUTHORITY}),
    ("#8f0f2a", "o", {Origin.ATTACK}),
    (_COLOURS[Origin.BACKUP], "s", {Origin.BACKUP}),
    (_COLOURS[Origin.NO_AUTHORITY], "s", {Origin.NO_AUTHORITY}),
)


@dataclass
class LinkStatistics:
    """Fates of the broadcasts on one link, with the link's model."""

    sender: str
    receiver: str
    model: LinkModel
    broadcasts: int
    """Of the sender, decided or not."""
    lost: int
    delays: list[float]
    """Of those not lost [s]."""

    @property
    def name(self) -> str:
        return f"{self.sender} → {self.receiver}"

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
    steps, links = steps_by_agent(recording), recording.scenario.links()
    decided: dict[tuple[str, str], list[float]] = defaultdict(list)
    for step in recording.steps:
        for sender, _, delay in step.fates:
            decided[sender, step.agent].append(delay)
    statistics = []
    for a, b in ((a, b) for a in steps for b in steps if (a, b) in decided):
        delays = [delay for delay in decided[a, b] if delay >= 0.0]
        lost = len(decided[a, b]) - len(delays)
        statistics.append(LinkStatistics(a, b, links.model(a, b), len(steps[a]), lost, delays))
    return statistics


def losses(recording: Recording, links: Sequence[LinkStatistics]) -> Figure:
    """Draw the lost share of links with the link model's; needs a link.

    With many agents, of every link over the number of broadcasts decided on it.
    """
    many = style.summarises(recording.scenario)
    figure, (axes,) = style.panels(1, 3.0 if many else 2.6)
    (_draw_all if many else _draw_worst)(axes, links)
    return figure


def _draw_worst(axes: Axes, links: Sequence[LinkStatistics]) -> None:
    chosen = set(map(id, sorted(links, key=lambda link: -link.loss)[:_MOST_LINKS]))
    worst = [link for link in links if id(link) in chosen]
    positions = np.arange(len(worst))
    loss = np.array([link.model.loss for link in worst])
    spread = 2.0 * np.sqrt(loss * (1.0 - loss) / [link.decided for link in worst])
    lost = [100 * link.loss for link in worst]
    axes.bar(positions, lost, width=0.6, color=style.MUTED, label="lost")
    axes.errorbar(
        positions, 100 * loss, yerr=100 * spread, fmt="_", color=style.LIMIT, markersize=14,
        capsize=4, label="link model, ±2 standard deviations\nof independent losses",
    )  # fmt: skip
    axes.set_xticks(positions, [link.name for link in worst])
    axes.tick_params(axis="x", rotation=90 if len(worst) > 14 else 0, labelsize=style.SMALL)
    axes.set_ylim(0.0, max(1.0, axes.get_ylim()[1]))
    axes.set_ylabel("lost broadcasts [%]")
    style.legend(axes)


def _draw_all(axes: Axes, links: Sequence[LinkStatistics]) -> None:
    decided = np.array([link.decided for link in links])
    lost = np.array([100.0 * link.loss for link in links])
    label = f"{len(links)} links"
    axes.plot(decided, lost, ".", color=style.MUTED, markersize=3, alpha=0.6, label=label)
    n = np.linspace(1.0, decided.max(), 200)
    for p in sorted({link.model.loss for link in links})[: style.FEW]:
        spread = 200.0 * np.sqrt(p * (1.0 - p) / n)
        label = f"link model, {100 * p:.3g} %"
        (line,) = axes.plot(n, 0.0 * n + 100.0 * p, linewidth=1.2, label=label)
        band = np.maximum(100.0 * p - spread, 0.0), np.minimum(100.0 * p + spread, 100.0)
        label = "±2 standard deviations\nof independent losses"
        axes.fill_between(n, *band, color=line.get_color(), alpha=0.15, linewidth=0, label=label)
    worst = sorted(links, key=lambda link: -link.excess)[: style.FEW]
    for link, colour in zip(worst, style.WORST, strict=False):
        label = f"{link.name}: {link.lost} of {link.decided}"
        axes.plot(link.decided, 100.0 * link.loss, "o", color=colour, markersize=4, label=label)
    axes.set_ylim(-2.0, 1.3 * max(5.0, lost.max()))
    axes.set_xlabel("broadcasts decided on a link")
    axes.set_ylabel("lost [%]")
    style.legend(axes)


def space_time(history: ReportHistory) -> Figure | None:
    """Draw the whole run, and its worst moment in detail; None without any broadcast."""
    if not len(history.broadcasts):
        return None
    names, agents = history.swarm.names, _zoomed_agents(history)
    heights = [min(_LANE * len(names), _MOST_HIGH), _LANE * len(agents)]
    size = style.WIDTH, sum(heights) + 1.6
    figure = Figure(figsize=size, layout="constrained", facecolor="white")
    whole, zoom = figure.subplots(2, 1, height_ratios=[h + 0.3 for h in heights])
    steps = [history.agent(i) for i in range(len(names))]
    moment = float(history.times[history.worst])
    begin, end = zoom_window(steps, moment, float(history.times[-1]), history.swarm.broadcast_every)
    _draw_whole(whole, history)
    whole.axvspan(begin, end, color="#000000", alpha=0.15, linewidth=0)
    _draw_zoom(zoom, history, agents, begin, end)
    return figure


def _draw_whole(axes: Axes, history: ReportHistory) -> None:
    """Draw each lane as three rows: broadcasts to it that were late, those lost, its state.

    With many agents each has one row, with the gravest of the three.
    """
    swarm, count = history.swarm, len(history.swarm.names)
    end = max(history.times[-1], max(step.t for step in history.recording.steps))
    steps, taus = zip(*((history.agent(i), swarm.horizon(i)) for i in range(count)), strict=True)
    late, lost, state, _ = lanes(history, steps, taus, (0.0, end), end, _MOST_INTERVALS)
    intervals = late.shape[1]
    image = np.ones((count, 4, intervals, 3))  # the fourth row separates the lanes
    image[:, 0], image[:, 1] = _blend(_COLOURS[LATE], late), _blend(_COLOURS[LOST], lost)
    image[:, 2] = np.array([(1.0, 1.0, 1.0), *(to_rgb(_COLOURS[s]) for s in LANE_STATES[1:])])[
        state
    ]
    if count > _MOST_LANES:
        for row in (1, 2):
            coloured = (image[:, row] < 1.0).any(axis=-1)
            image[:, 0][coloured] = image[:, row][coloured]
        image = image[:, :1]
    axes.imshow(
        image.reshape(-1, intervals, 3),
        aspect="auto", interpolation="nearest", extent=(0.0, end, count - 0.5, -0.5),
    )  # fmt: skip
    ticks = range(0, count, -(-count // _MOST_LANES))
    axes.set_yticks(list(ticks), [swarm.names[i] for i in ticks], fontsize=style.SMALL)
    axes.set_ylabel("agent")
    axes.set_xlabel("t [s]")
    axes.spines[["top", "right"]].set_visible(False)
    fates = np.bincount(history.broadcasts.fate, minlength=len(FATES))
    counts = ", ".join(f"{count} {fate}" for count, fate in zip(fates, FATES, strict=True))
    style.title(axes, f"{fates.sum()} broadcasts on all links: {counts}")
    marks = [Patch(color=c, label=name) for name, c in _COLOURS.items() if name != IN_TIME]
    style.legend(axes, handles=marks)


def _draw_zoom(
    axes: Axes, history: ReportHistory, agents: Sequence[int], begin: float, end: float
) -> None:
    """Draw every control step as a dot, every broadcast as a line from sender to receiver."""
    names = history.swarm.names
    lane_of = np.zeros(len(names))
    for lane, i in enumerate(agents):
        lane_of[i] = lane
        axes.axhline(lane, color="#000000", alpha=0.25, linewidth=0.8, zorder=1)
        for colour, marker, origins in _DOTS:
            t = [s.t for s in history.steps[i] if begin <= s.t <= end and s.origin in origins]
            axes.plot(t, [lane] * len(t), marker, color=colour, markersize=4, zorder=4)
    every = history.broadcasts
    inside = every[(begin <= every.sent) & (every.sent <= end)]
    inside = inside[np.isin(inside.sender, agents) & np.isin(inside.receiver, agents)]
    for code, fate in enumerate(FATES):
        of_fate = inside[inside.fate == code]
        begins, ends, dashes = lane_of[of_fate.sender], lane_of[of_fate.receiver], "-"
        if fate == LOST:  # a line half way to its receiver
            ends, dashes = (begins + ends) / 2.0, "--"
            axes.plot(of_fate.arrival, ends, "x", color=_COLOURS[LOST], markersize=4)
        tails, heads = (of_fate.sent, begins), (of_fate.arrival, ends)
        segments = np.stack([np.column_stack(tails), np.column_stack(heads)], axis=1)
        axes.add_collection(
            LineCollection(
                list(segments), linewidths=0.8, zorder=2, colors=_COLOURS[fate], linestyles=dashes,
                label=fate,
            )
        )  # fmt: skip
    axes.set_xlim(begin, end)
    axes.set_ylim(len(agents) - 0.5, -0.5)
    axes.set_yticks(range(len(agents)), [names[i] for i in agents], fontsize=style.SMALL)
    omitted = len(names) - len(agents)
    axes.set_ylabel("agent" + (f", {omitted} more not drawn" if omitted else ""))
    axes.set_xlabel("t [s]")
    axes.spines[["top", "right"]].set_visible(False)
    style.title(axes, "around the worst moment")
    style.legend(axes)


def _zoomed_agents(history: ReportHistory) -> list[int]:
    """Agents in the zoom: all; of many the worst pair's, then those that missed most broadcasts."""
    count = len(history.swarm.names)
    if count <= style.MOST_NAMED:
        return list(range(count))
    every = history.broadcasts
    missed = np.bincount(every.receiver[every.fate != FATES.index(IN_TIME)], minlength=count)
    first = [i for i in history.worst_pair if i < count]
    others = [i for i in np.argsort(-missed, kind="stable").tolist() if i not in first]
    return sorted([*first, *others][: style.MOST_NAMED])


def _blend(colour: str, share: Array) -> Array:
    """Blend white with a colour, with one axis more; a small share is still visible."""
    strength = np.where(share > 0.0, 0.25 + 0.75 * share, 0.0)[..., None]
    return np.asarray((1.0 - strength) + strength * np.array(to_rgb(colour)))
