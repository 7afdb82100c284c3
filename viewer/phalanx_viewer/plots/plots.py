"""The plots of a run and the marks on its timeline, and the script that draws them in a browser.

All times are in seconds.
"""

import functools
import json
from collections.abc import Callable, Iterable, Sequence, Set
from importlib.resources import files

import msgspec
import numpy as np

from phalanx.faults.commands import Condition
from phalanx.messages.frames import Frame
from phalanx.messages.step_report import QUANTITIES, Quantity, numbers_of
from phalanx.recording.curves import history, series
from phalanx.recording.curves.beliefs import braking_values
from phalanx.swarm.swarm import unit_of_psi
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin
from phalanx_viewer.feeds import Feed
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.scene.legend import Mark as SceneMark
from phalanx_viewer.scene.legend import legend

Safe = tuple[float | None, float | None]

_MOST_POINTS, _LEAST_POINTS = 400, 60
"""Points of one curve."""
_POINTS_OF_ALL = 3000
"""Points of one quantity's curves together, if there are many agents."""
_MOST_INTERVALS = 50, 200
"""Intervals of an envelope, and of a space-time diagram."""
_NEAR_PAIRS = 6
_H_TOT, _WORST_PAIRS, _DISTANCE = "h_tot", "h of the worst pairs", "Smallest distance"
_PSI, _INPUT = "ψ_{}", "Input {} and nominal"
_V, _AGES = "V of the worst pairs by radio", "Age of peers' states"
_EFFECT = "Network effect"
_STEPS = 500
"""Presses of an arrow key from the run's begin to its end."""
_UNSAFE_ABOVE_0: Safe = (None, 0.0)


class Curve(msgspec.Struct, omit_defaults=True):
    """A line in a plot, or with `to` the band between two lines."""

    t: list[float]
    y: list[float]
    to: list[float] | None = None
    """The band's other edge."""
    name: str = ""
    agent: int | None = None
    """The agent that it belongs to: bold when that is chosen."""
    role: str = ""
    """Style otherwise: "chosen" bold, "guide" dashed, by default pale."""


class Lane(msgspec.Struct):
    """One agent in a space-time diagram: a digit for each interval of the run."""

    late: str
    """Share of the broadcasts to it that came too late for its next step: 0 none, 9 all."""
    lost: str
    """Share of the broadcasts to it that were lost."""
    state: str
    """Its gravest state: a place in LANE_STATES."""
    false: str
    """1 if it sent a false broadcast, else 0."""


FALSE, RELAYED = "false", "relayed"
"""Fates in a Zoom: of a false broadcast; of a state that others brought to the chosen agent."""


class Zoom(msgspec.Struct):
    """A few control steps around the worst moment, broadcast by broadcast."""

    begin: float
    end: float
    steps: list[list[float]]
    """Times of each agent's steps."""
    broadcasts: list[tuple[int, float, int, float, str]]
    """Sender, time sent, receiver, time of arrival and fate of each; of a relayed one its first
    sender, and when the receiver sampled next."""


class Plot(msgspec.Struct):
    """One plot; times run from the run's begin to its end."""

    title: str
    unit: str
    curves: list[Curve]
    safe: tuple[float | None, float | None] = (None, None)
    """Least and largest safe value; beyond them the plot is shaded."""
    logarithmic: bool = False
    of_agents: bool = False
    """If true, the chosen agent's backup periods are shown; else all agents' faults."""
    agent: int | None = None
    """Shown only when that agent is chosen; null: always."""
    lanes: list[Lane] = []
    """A space-time diagram, instead of curves."""
    zoom: Zoom | None = None
    """The worst moment of a recorded run."""


class Period(msgspec.Struct):
    """A period in which an agent was on its backup, without authority, or not fine."""

    agent: int
    kind: str
    """An Origin or a Condition."""
    begin: float
    end: float


class Mark(msgspec.Struct):
    """A moment worth jumping to."""

    t: float
    text: str
    kind: str = "log"
    """Its kind: "worst", "backup", "violation", "fault" or "log"."""


class Content(msgspec.Struct):
    """Everything the page's script draws."""

    title: str
    begin: float
    end: float
    step: float
    """Time by which an arrow key moves the cursor."""
    seekable: bool
    """If true, visitors can move the cursor; else it follows the run."""
    agents: list[str]
    adversaries: list[bool]
    chosen: int
    pair: int
    """The pair whose h is bold."""
    plots: list[Plot]
    periods: list[Period]
    marks: list[Mark]
    legend: list[tuple[str, str, str]]


_PARTS = ("state.js", "plots.js", "timeline.js", "legend.js")
"""Functions of one scope: each part uses those before it."""


@functools.cache
def script() -> str:
    """JavaScript that adds the panels to a page, and `phalanx` to its window.

    phalanx.show(content) draws a Content, phalanx.at({t, playing, speed}) moves the cursor, and
    phalanx.act is called with {seek: t}, {play: true or false} or {speed: factor}.
    """
    here = files(__package__)
    style = json.dumps(here.joinpath("panels.css").read_text("utf-8"))
    parts = "\n".join(here.joinpath(part).read_text("utf-8") for part in _PARTS)
    # A page that lost its connection for a while receives everything again.
    return f"if (!window.phalanx) (() => {{\nconst STYLE = {style};\n{parts}\n}})();"


def content(
    feed: Feed, curves_of: Sequence[int], seekable: bool, inputs_of: Sequence[int] | None = None,
    hidden: Set[SceneMark] = frozenset(),
) -> Content:  # fmt: skip
    """Make the plots and the timeline of a feed.

    curves_of: the agents with curves of their own; the first one is chosen. seekable: whether
    visitors can move the cursor; the plots then end where the past does. inputs_of: the agents
    whose inputs are plotted; by default those with curves. hidden: marks without a legend.
    """
    model, past = feed.model, feed.history
    rows = past.totals
    begin, now = (float(rows[0, 0]), float(rows[-1, 0])) if len(rows) else (0.0, 0.0)
    end = max(now if seekable else model.scenario.duration, begin + 1e-3)
    plots = _Plots(feed, curves_of, (begin, end, now))
    of_agents = plots.of_agents(curves_of if inputs_of is None else inputs_of)
    return Content(
        title=f"{model.scenario.name}, seed {model.scenario.seed}",
        begin=begin,
        end=end,
        step=(end - begin) / _STEPS,
        seekable=seekable,
        agents=list(model.names),
        adversaries=model.adversary.tolist(),
        chosen=curves_of[0],
        pair=plots.worst_pair,
        plots=plots.of_swarm() + of_agents,
        periods=[
            *fault_periods(past.conditions, now),
            *(period for i in curves_of for period in empty_periods(i, plots.steps[i])),
        ],
        marks=_marks(feed, plots.steps.values()),
        legend=legend(feed.marks - hidden),
    )


def values_at(feed: Feed, frame: Frame, chosen: int, pair: int) -> dict[str, float | None]:
    """Values of the bold curves at a frame, by plot: the curves themselves are thinned."""
    model, x, status = feed.model, np.frombuffer(frame.x, dtype="<f8"), frame.agents[chosen]
    values: dict[str, float | None] = {_H_TOT: frame.h_tot, _WORST_PAIRS: model.values.h(pair, x)}
    values[_DISTANCE] = history.smallest_distance(model.swarm, model.kinematics.poses(x).positions)
    psi = map(_PSI.format, model.values.psi_levels)
    values |= zip(psi, model.values.higher_psi(x).tolist(), strict=True)
    if status.step is None:
        return values
    horizon = model.swarm.horizon(chosen)
    for quantity, number in zip(QUANTITIES.values(), numbers_of(status.step), strict=True):
        value = float(series.plotted(quantity, np.array(number, dtype=float), horizon))
        values[quantity.title] = None if np.isnan(value) else value
    inputs = model.swarm.members[chosen].dynamics.inputs
    return values | dict(zip(map(_INPUT.format, inputs), status.step.u, strict=True))


class _Plots:
    """The plots of a feed's past."""

    def __init__(
        self, feed: Feed, curves_of: Sequence[int], times: tuple[float, float, float]
    ) -> None:
        """times: begin and end of the plots, and the latest time known of the run [s]."""
        self._model, self._past, self._radio = feed.model, feed.history, feed.radio
        self._effect = feed.effects if isinstance(feed, Replay) else {}
        self._curves_of, self._times = curves_of, times
        self.steps = {i: self._past.agent(i) for i in range(len(self._model.names))}
        points = _POINTS_OF_ALL // max(len(curves_of), 1)
        self._most = int(np.clip(points, _LEAST_POINTS, _MOST_POINTS))
        h = self._past.pairs.h
        self.worst_pair = int(np.argsort(h.max(axis=0))[-1]) if len(h) else 0

    def of_swarm(self) -> list[Plot]:
        """Plot h_tot, h of the pairs that came nearest to 0, the distance, and every ψ_k."""
        model, rows, (t, h) = self._model, self._past.totals, self._past.pairs
        scenario, radius = model.scenario, model.radius

        def bold(column: int, lowest: bool = False) -> list[Curve]:
            values = series.Series(rows[:, 0], rows[:, column])
            return [curve(values, lowest=lowest, highest=not lowest, role="chosen")]

        pairs = of_largest(t, h, model.label) if len(t) else []
        return [
            Plot(_H_TOT, unit_of_psi(scenario), bold(1), _UNSAFE_ABOVE_0),
            Plot(_WORST_PAIRS, unit_of_psi(scenario), pairs, _UNSAFE_ABOVE_0),
            *self._braking(),
            Plot(_DISTANCE, "m", bold(3, lowest=True), (2.0 * radius if radius else None, None)),
            *(
                Plot(_PSI.format(k), unit_of_psi(scenario, k), bold(3 + k), _UNSAFE_ABOVE_0)
                for k in model.values.psi_levels
            ),
        ]

    def of_agents(self, inputs_of: Sequence[int]) -> list[Plot]:
        """Plot the numbers of all agents' steps, the inputs of some, and the lanes."""
        inputs = [
            Plot(
                _INPUT.format(u.name), u.unit,
                [
                    curve(u.nominal, "nominal", role="guide", most=self._most),
                    curve(u.applied.extended(self._times[2]), agent=i, most=self._most),
                ],
                u.bounds, of_agents=True, agent=i,
            )
            for i in inputs_of
            for u in series.input_curves(self._model.swarm, i, self.steps[i])
        ]  # fmt: skip
        plots = {name: self._step_plot(name, quantity) for name, quantity in QUANTITIES.items()}
        ages = self._ages(inputs_of) + self._effects()
        return [plots.pop("certified"), *ages, *inputs, *plots.values(), *self._space_time()]

    def _step_plot(self, name: str, quantity: Quantity) -> Plot:
        """Plot a number of every agent's control steps; many agents in an envelope."""
        swarm, lowest = self._model.swarm, quantity.safe[0] is not None
        values = series.step_series(swarm, name, self.steps)
        curves = [
            curve(values[i], agent=i, most=self._most, lowest=lowest, highest=not lowest)
            for i in self._curves_of
        ]
        return Plot(
            quantity.title, series.plotted_unit(quantity, swarm),
            [*bands(list(values.values())), *curves] if self._model.crowded else curves,
            quantity.safe, logarithmic=quantity.in_horizons, of_agents=True,
        )  # fmt: skip

    def _braking(self) -> list[Plot]:
        """Plot V, which own parts keep below 0, of the pairs by radio that came nearest to that."""
        past, swarm = self._past, self._model.swarm
        if not (isinstance(past, history.RecordedHistory) and swarm.by_radio):
            return []
        t = past.pairs.t
        names, V = braking_values(swarm, past.x[np.searchsorted(past.times, t)])
        return [Plot(_V, "m", of_largest(t, V, names.__getitem__), _UNSAFE_ABOVE_0)]

    def _ages(self, of: Sequence[int]) -> list[Plot]:
        """Plot ages of the states that some agents had of their peers; the oldest is bold."""
        if self._radio is None:
            return []
        plots = []
        for i in of:
            if ages := list(self._radio.ages(i).values()):
                oldest = series.Series(ages[0].t, np.fmax.reduce([of_peer.y for of_peer in ages]))
                single = [curve(of_peer, most=self._most) for of_peer in ages]
                curves = bands(ages) if self._model.crowded else single
                curves.append(curve(oldest, "oldest", role="chosen", most=self._most))
                plots.append(Plot(_AGES, "s", curves, of_agents=True, agent=i))
        return plots

    def _effects(self) -> list[Plot]:
        """Plot the network effect of every agent's steps, if it was computed."""
        curves = [
            curve(self._effect[i], agent=i, most=self._most, lowest=False)
            for i in self._curves_of
            if i in self._effect
        ]
        return [Plot(_EFFECT, "% of U", curves, of_agents=True)] if curves else []

    def _space_time(self) -> list[Plot]:
        """Plot the space-time diagram; none without a broadcast, or live with many agents."""
        past, swarm, (begin, end, now) = self._past, self._model.swarm, self._times
        if not len(past.fates.t):
            return []
        recorded, steps = len(past.broadcasts) > 0, list(self.steps.values())
        # A live run's frames do not hold every step: no agent counts as silent.
        taus = [swarm.horizon(i) if recorded else np.inf for i in self.steps]
        late, lost, *states = series.lanes(past, steps, taus, (begin, end), now, _MOST_INTERVALS[1])
        shares = (np.ceil(9.0 * share) for share in (late, lost))
        diagram = [
            Lane(*("".join(map(str, digits.astype(int).tolist())) for digits in of_agent))
            for of_agent in zip(*shares, *states, strict=True)
        ]
        if not recorded:
            return [Plot("Links late and lost, backup", "", [], lanes=diagram)]
        title = "Late, lost, false; backup, silence"
        return [Plot(title, "", [], lanes=diagram, zoom=self._zoom(steps))]

    def _zoom(self, steps: Sequence[history.AgentSeries]) -> Zoom:
        """Plot the worst moment; with many agents, the chosen one's broadcasts alone."""
        only, rows = self._curves_of[0] if self._model.crowded else None, self._past.totals
        worst = float(rows[np.argmax(rows[:, 2]), 0])
        every_nth = self._model.swarm.broadcast_every
        begin, end = series.zoom_window(steps, worst, float(rows[-1, 0]), every_nth)
        every = self._past.broadcasts
        broadcasts = [
            (sender, t, receiver, arrival, FALSE if false else history.FATES[fate])
            for sender, receiver, t, arrival, fate, false in every[
                (begin <= every.sent) & (every.sent <= end)
            ].tolist()
            if only in (None, sender, receiver)
        ]
        chosen = self._curves_of[0]
        broadcasts += [
            (news.peer, news.said.t, chosen, news.t, RELAYED)
            for news in (self._radio.news.get(chosen, ()) if self._radio else ())
            if news.said and news.relayed and begin <= news.said.t and news.t <= end
        ]
        times = [s.sampled[(begin <= s.sampled) & (s.sampled <= end)].tolist() for s in steps]
        return Zoom(begin, end, times, broadcasts)


def curve(
    values: series.Series, name: str = "", *, agent: int | None = None, role: str = "",
    most: int = _MOST_POINTS, highest: bool = True, lowest: bool = True,
) -> Curve:  # fmt: skip
    """Thin a series to a curve through its largest values, its smallest, or both."""
    t, y = values.finite()
    indices = series.extremes(y, most, highest=highest, lowest=lowest)
    return Curve(numbers(t[indices], 7), numbers(y[indices], 4), name=name, agent=agent, role=role)


def of_largest(t: Array, values: Array, name_of: Callable[[int], str]) -> list[Curve]:
    """Curves of the pairs, columns of values (s, pairs), that came largest; that one is bold."""
    *others, largest = np.argsort(values.max(axis=0))[-_NEAR_PAIRS:].tolist()
    return [
        curve(series.Series(t, values[:, k]), name_of(k), lowest=False, role=role)
        for k, role in [*((k, "") for k in others), (largest, "chosen")]
    ]


def bands(curves: Sequence[series.Series]) -> list[Curve]:
    """Many agents' bands, least to largest and 10 to 90 %, and their median."""
    edges, quantiles = series.envelope(curves, _MOST_INTERVALS[0])
    if not len(edges):
        return []
    times = numbers(edges.ravel(), 7)
    least, low, middle, high, most = (numbers(q, 4) for q in np.repeat(quantiles, 2, axis=1))
    return [
        Curve(times, least, most, "all agents"),
        Curve(times, low, high, "10 to 90 %"),
        Curve(times, middle, name="median"),
    ]


def numbers(values: Array, digits: int) -> list[float]:
    """Round to significant digits: a plot shows no more, and the page loads sooner."""
    with np.errstate(divide="ignore"):
        size = np.floor(np.log10(np.abs(values)))
    unit = 10.0 ** (np.where(np.isfinite(size), size, 0.0) - digits + 1)
    rounded: list[float] = (np.round(values / unit) * unit).round(12).tolist()
    return rounded


def _marks(feed: Feed, steps: Iterable[history.AgentSeries]) -> list[Mark]:
    """Mark the worst moment, the first backup, violations, faults and every line of the log."""
    rows, names = feed.history.totals, feed.model.names
    if not len(rows):
        return []
    worst = rows[int(np.argmax(rows[:, 2]))]
    marks = [Mark(float(worst[0]), f"worst moment, h = {worst[2]:.4g}", "worst")]
    backups = [s.t[s.empty == history.EMPTY_CODES[Origin.BACKUP]] for s in steps]
    if first := [float(t[0]) for t in backups if len(t)]:
        marks.append(Mark(min(first), "first backup", "backup"))
    marks += [Mark(v.first, f"{v.pair}: violated", "violation") for v in feed.violations]
    for t, agent, condition in feed.history.conditions:
        marks.append(Mark(t, f"agent {names[agent]}: {condition}", "fault"))
    return marks + [Mark(line.t, line.text) for line in feed.log]


def empty_periods(agent: int, steps: history.AgentSeries) -> list[Period]:
    """Periods from a step with empty K_i until the next step without."""
    periods = []
    for kind, value in history.EMPTY_CODES.items():
        mask = np.concatenate([[False], steps.empty == value, [False]])
        edges = np.flatnonzero(np.diff(mask.astype(int)))
        last = len(steps.t) - 1
        for begin, end in edges.reshape(-1, 2).tolist():
            t, until = steps.t[begin], steps.t[min(end, last)]
            periods.append(Period(agent, kind, float(t), float(until)))
    return periods


def fault_periods(changes: Sequence[history.ConditionChange], end: float) -> list[Period]:
    """Periods from each change of condition to the agent's next, or to the end [s]."""
    periods = []
    for k, change in enumerate(changes):
        later = (c.t for c in changes[k + 1 :] if c.agent == change.agent)
        if change.condition != Condition.FINE:
            until = next(later, end)
            periods.append(Period(change.agent, change.condition, change.t, until))
    return periods
