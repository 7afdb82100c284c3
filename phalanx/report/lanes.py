"""The space-time diagram: a lane for each agent, and what became of the broadcasts between them."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from phalanx.arrays import Array
from phalanx.recording.broadcasts import FATES, IN_TIME, LATE, LOST, Broadcast, broadcasts, window
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Step
from phalanx.report.style import MOST_NAMED, legend
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.origin import EMPTY, Origin

_SILENT = "silent"
_COLOURS = {
    IN_TIME: "#9fb2ca",
    LATE: "#e8a200",
    LOST: "#d62728",
    Origin.BACKUP: "#f97316",
    Origin.NO_AUTHORITY: "#c084fc",
    _SILENT: "#475569",
}
_MOST_INTERVALS = 400
"""Of the whole run."""
_MOST_LANES = 24
"""Of three rows each, and most names beside them."""
_WIDTH, _LANE, _MOST_HIGH = 9.0, 0.34, 7.0
"""[inch]"""


def space_time(recording: Recording, swarm: Swarm) -> Figure | None:
    """The whole run, and its worst moment in detail; None if nobody broadcast anything."""
    found = list(broadcasts(recording))
    if not found:
        return None
    lanes = _shown(found, recording, swarm)
    heights = [min(_LANE * len(swarm.names), _MOST_HIGH), _LANE * len(lanes)]
    figure = Figure(figsize=(_WIDTH, sum(heights) + 1.6), layout="constrained", facecolor="white")
    whole, zoom = figure.subplots(2, 1, height_ratios=[h + 0.3 for h in heights])
    worst = float(recording.times[int(np.argmax(recording.h_tot))])
    times = [[step.t for step in steps] for steps in steps_by_agent(recording).values()]
    begin, end = window(worst, float(recording.times[-1]), times)
    _draw_whole(whole, found, recording, swarm)
    whole.axvspan(begin, end, color="#000000", alpha=0.15, linewidth=0)
    _draw_zoom(zoom, found, recording, lanes, begin, end)
    return figure


def _draw_whole(axes: Axes, found: Sequence[Broadcast], recording: Recording, swarm: Swarm) -> None:
    """Each lane has three rows: broadcasts to it that were late, those lost, and how it did.

    Of many agents each has one row, with the gravest of the three.
    """
    steps = steps_by_agent(recording)
    count = len(swarm.names)
    end = max(recording.times[-1], max(step.t for step in recording.steps))
    intervals = int(np.clip(max(map(len, steps.values())), 20, _MOST_INTERVALS))
    edges = np.linspace(0.0, end, intervals + 1)
    image = np.ones((count, 4, intervals, 3))  # the fourth row parts the lanes
    late, lost = (_shares(found, fate, count, edges) for fate in (LATE, LOST))
    image[:, 0], image[:, 1] = _blend(_COLOURS[LATE], late), _blend(_COLOURS[LOST], lost)
    for i, of_agent in enumerate(steps.values()):
        for begin, until, kind in _periods(of_agent, swarm.horizon(i), end):
            first = np.searchsorted(edges, begin, side="right") - 1
            image[i, 2, first : np.searchsorted(edges, until)] = to_rgb(_COLOURS[kind])
    if count > _MOST_LANES:
        for row in (1, 2):
            drawn = (image[:, row] < 1.0).any(axis=-1)
            image[:, 0][drawn] = image[:, row][drawn]
        image = image[:, :1]
    axes.imshow(
        image.reshape(-1, intervals, 3),
        aspect="auto", interpolation="nearest", extent=(0.0, end, count - 0.5, -0.5),
    )  # fmt: skip
    shown = range(0, count, -(-count // _MOST_LANES))
    axes.set_yticks(list(shown), [swarm.names[i] for i in shown], fontsize=8)
    axes.set_ylabel("agent")
    axes.set_xlabel("t [s]")
    axes.spines[["top", "right"]].set_visible(False)
    told = ", ".join(f"{sum(b.fate == fate for b in found)} {fate}" for fate in FATES)
    axes.set_title(f"{len(found)} broadcasts on all links: {told}", loc="right", fontsize=10)
    handles = [Patch(color=c, label=name) for name, c in _COLOURS.items() if name != IN_TIME]
    axes.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.02), fontsize=8, frameon=False
    )


def _draw_zoom(
    axes: Axes, found: Sequence[Broadcast], recording: Recording, lanes: Sequence[int],
    begin: float, end: float,
) -> None:  # fmt: skip
    """Every control step as a dot, every broadcast as a line from its sender to its receiver."""
    place = {agent: lane for lane, agent in enumerate(lanes)}
    for i, steps in enumerate(steps_by_agent(recording).values()):
        if i in place:
            axes.axhline(place[i], color="#000000", alpha=0.25, linewidth=0.8, zorder=1)
            for colour, marker, origins in _DOTS:
                t = [s.t for s in steps if begin <= s.t <= end and s.origin in origins]
                axes.plot(t, [place[i]] * len(t), marker, color=colour, markersize=4, zorder=4)
    seen = [
        b for b in found
        if b.sender in place and b.receiver in place and begin <= b.sent <= end
    ]  # fmt: skip
    for fate in FATES:
        of_kind = [b for b in seen if b.fate == fate]
        lines = [[(b.sent, place[b.sender]), _arrival(b, place)] for b in of_kind]
        looks = {"colors": _COLOURS[fate], "linestyles": "--" if fate == LOST else "-"}
        axes.add_collection(LineCollection(lines, label=fate, linewidths=0.8, zorder=2, **looks))
    lost = [_arrival(b, place) for b in seen if b.fate == LOST]
    axes.plot(*zip(*lost, strict=True) if lost else ([], []), "x", color="#d62728", markersize=4)
    names = [name for name, _, _ in recording.scenario.roster()]
    axes.set_xlim(begin, end)
    axes.set_ylim(len(lanes) - 0.5, -0.5)
    axes.set_yticks(range(len(lanes)), [names[i] for i in lanes], fontsize=8)
    left = len(names) - len(lanes)
    axes.set_ylabel("agent" + (f", {left} more not drawn" if left else ""))
    axes.set_xlabel("t [s]")
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title("around the worst moment", loc="right", fontsize=10)
    legend(axes)


_DOTS = (
    ("#1f5fbf", "o", {Origin.QP, Origin.SOLVER_FAILED}),
    ("#8f0f2a", "o", {Origin.ATTACK}),
    (_COLOURS[Origin.BACKUP], "s", {Origin.BACKUP}),
    (_COLOURS[Origin.NO_AUTHORITY], "s", {Origin.NO_AUTHORITY}),
)


def _arrival(broadcast: Broadcast, place: dict[int, int]) -> tuple[float, float]:
    """Where its line ends: with its receiver, or half way there if it was lost."""
    begin, end = place[broadcast.sender], place[broadcast.receiver]
    return broadcast.arrival, (begin + end) / 2.0 if broadcast.fate == LOST else end


def _periods(
    steps: Sequence[Step], horizon: float, end: float
) -> Iterator[tuple[float, float, str]]:
    """When an agent was on its backup, without authority, or silent for more than its τ."""
    for k, step in enumerate(steps):
        until = steps[k + 1].t if k + 1 < len(steps) else end
        if step.origin in EMPTY:
            yield step.t, min(until, step.t + horizon), step.origin
        if until - step.t > 1.5 * horizon:
            yield step.t + horizon, until, _SILENT


def _shown(found: Sequence[Broadcast], recording: Recording, swarm: Swarm) -> list[int]:
    """Agents in the zoom: all; of many those of the worst pair, then whom most was kept from."""
    count = len(swarm.names)
    if count <= MOST_NAMED:
        return list(range(count))
    kept = np.bincount([b.receiver for b in found if b.fate != IN_TIME], minlength=count)
    label = recording.summary.worst_pair if recording.summary else ""
    pair = next((p for p in swarm.safe_set.pairs if swarm.safe_set.label(p) == label), None)
    first = [] if pair is None else [i for i in (pair.a, pair.b) if i is not None]
    others = [i for i in np.argsort(-kept, kind="stable").tolist() if i not in first]
    return sorted([*first, *others][:MOST_NAMED])


def _shares(found: Sequence[Broadcast], fate: str, count: int, edges: Array) -> Array:
    """Of the broadcasts to each agent in each interval the share with a fate, shape (count, c)."""
    sent, receiver = np.array([(b.sent, b.receiver) for b in found]).T
    bins = (edges, np.arange(count + 1) - 0.5)
    every, _, _ = np.histogram2d(sent, receiver, bins)
    these = np.array([b.fate == fate for b in found])
    of_fate, _, _ = np.histogram2d(sent[these], receiver[these], bins)
    return np.asarray(of_fate / np.maximum(every, 1.0)).T


def _blend(colour: str, share: Array) -> Array:
    """From white to a colour, with one axis more; a small share is still seen."""
    strength = np.where(share > 0.0, 0.25 + 0.75 * share, 0.0)[..., None]
    return np.asarray((1.0 - strength) + strength * np.array(to_rgb(colour)))
