"""Which plots there are of a run, and what is marked on its timeline."""

from collections.abc import Callable, Sequence

import numpy as np

from phalanx.arrays import Array
from phalanx.faults.commands import Condition
from phalanx.swarm.units import unit_of_psi
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import Frame
from phalanx.wire.step_report import OF_ROW, QUANTITIES, Quantity, numbers_of
from phalanx_viewer.feeds.feed import Feed
from phalanx_viewer.feeds.history import EMPTY_CODES, NOBODY_NEAR, AgentSeries, ConditionChange
from phalanx_viewer.plots.content import Content, Curve, Mark, Period, Plot
from phalanx_viewer.plots.curves import (
    Keep,
    Series,
    curve,
    envelope,
    farthest,
    highest,
    lowest,
    points_each,
)
from phalanx_viewer.plots.lanes import lanes, zoom
from phalanx_viewer.scene.model import SceneModel

Safe = tuple[float | None, float | None]

LEAST_HORIZON = 0.1
"""Where a certified time is drawn that is shorter than this many τ, for a logarithm."""
_NEAR_PAIRS = 6
_H_TOT, _WORST_PAIRS, _DISTANCE = "h_tot", "h of the worst pairs", "Smallest distance"
_STEPS = 500
"""An arrow key moves the cursor by this share of the run."""
_UNSAFE_ABOVE_0: Safe = (None, 0.0)


def content(
    feed: Feed, told: Sequence[int], seekable: bool, inputs_of: Sequence[int] | None = None
) -> Content:
    """What to draw of a feed.

    Args:
        feed: live or recorded.
        told: the agents that have curves of their own; the first one is chosen.
        seekable: whether the cursor can be moved: the end is then that of the past.
        inputs_of: the agents whose inputs are told; by default all that have curves.
    """
    model, past = feed.model, feed.history
    rows = past.swarm.rows
    begin, now = (float(rows[0, 0]), float(rows[-1, 0])) if len(rows) else (0.0, 0.0)
    end = max(now if seekable else model.scenario.duration, begin + 1e-3)
    steps = [past.agent(i) for i in range(len(model.names))]
    plots = _Plots(feed, steps, told, (begin, end, now))
    inputs = plots.of_inputs(told if inputs_of is None else inputs_of)
    return Content(
        title=f"{model.scenario.name}, seed {model.scenario.seed}",
        begin=begin,
        end=end,
        step=(end - begin) / _STEPS,
        seekable=seekable,
        agents=list(model.names),
        adversaries=model.adversary.tolist(),
        chosen=told[0],
        pair=plots.worst_pair,
        plots=plots.of_swarm() + plots.of_agents(inputs),
        periods=[
            *fault_periods(past.conditions, now),
            *(period for i in told for period in empty_periods(i, steps[i])),
        ],
        marks=_marks(feed, steps),
    )


def values_at(feed: Feed, frame: Frame, chosen: int, pair: int) -> dict[str, float | None]:
    """What the bold curves are at a frame, by plot: the curves themselves are thinned."""
    model, x, status = feed.model, np.frombuffer(frame.x, dtype="<f8"), frame.agents[chosen]
    rows = feed.history.swarm.rows
    found: dict[str, float | None] = {_WORST_PAIRS: model.values.h(pair, x)}
    if len(rows):
        row = rows[max(int(np.searchsorted(rows[:, 0], frame.t, side="right")) - 1, 0)]
        titles = [_H_TOT, _DISTANCE, *map(_psi, model.psi_levels)]
        found |= dict(zip(titles, row[1:].tolist(), strict=True))
    if status.step is None:
        return found
    horizon = model.swarm.horizon(chosen)
    for quantity, number in zip(QUANTITIES.values(), numbers_of(status.step), strict=True):
        shown = float(_plotted(quantity, np.array(number, dtype=float), horizon))
        found[quantity.title] = None if np.isnan(shown) else shown
    return found | dict(zip(map(_input, model.input_names(chosen)), status.step.u, strict=True))


class _Plots:
    """The plots of a feed's past."""

    def __init__(
        self,
        feed: Feed,
        steps: list[AgentSeries],
        told: Sequence[int],
        times: tuple[float, float, float],
    ) -> None:
        """times: of the plots' begin and end, and how far the run has come [s]."""
        self._model, self._history = feed.model, feed.history
        self._steps, self._told, self._times = steps, told, times
        self._pairs = self._history.pairs()
        every = self._pairs.h.max(axis=0) if len(self._pairs.t) else np.zeros(1)
        self._nearest = np.argsort(every)[-_NEAR_PAIRS:].tolist()
        self.worst_pair = self._nearest[-1]

    def of_swarm(self) -> list[Plot]:
        rows, pairs = self._history.swarm.rows, self._near_pairs()
        of_h, levels = self._unit_of_psi(0), self._model.psi_levels
        psi = {k: [_bold(rows, 2 + k, highest)] for k in levels}
        return [
            Plot(_H_TOT, of_h, [_bold(rows, 1, highest)], _UNSAFE_ABOVE_0),
            Plot(_WORST_PAIRS, of_h, pairs, _UNSAFE_ABOVE_0),
            Plot(_DISTANCE, "m", [_bold(rows, 2, lowest)], self._least_distance()),
            *(Plot(_psi(k), self._unit_of_psi(k), psi[k], _UNSAFE_ABOVE_0) for k in levels),
        ]

    def _unit_of_psi(self, k: int) -> str:
        return unit_of_psi(self._model.scenario, k)

    def of_inputs(self, agents: Sequence[int]) -> list[Plot]:
        return [self._input(i, c) for i in agents for c in range(self._steps[i].u.shape[1])]

    def of_agents(self, inputs: list[Plot]) -> list[Plot]:
        plots = {name: self._of_steps(name, quantity) for name, quantity in QUANTITIES.items()}
        return [plots.pop("certified"), *inputs, *plots.values(), *self._space_time()]

    def _of_steps(self, name: str, quantity: Quantity) -> Plot:
        """A number of every agent's control steps."""
        keep = highest if quantity.safe[0] is None else lowest
        curves = self._every(
            lambda i, s: _plotted(quantity, s.numbers[name], self._model.swarm.horizon(i)), keep
        )
        return Plot(
            quantity.title, _plotted_unit(quantity, self._model), curves, quantity.safe,
            logarithmic=quantity.in_horizons, of_agents=True,
        )  # fmt: skip

    def _space_time(self) -> list[Plot]:
        """Of a run in which somebody broadcast something; live, when something was late or lost."""
        past, steps = self._history, self._steps
        fates, (begin, end, now) = past.fates(), self._times
        if not len(fates.t):
            return []
        if not past.broadcasts:  # live: a frame tells no agent's last step
            known = lanes(fates, steps, [np.inf] * len(steps), begin, end, now)
            return [Plot("Links late and lost, backup", "", [], lanes=known)]
        taus = [self._model.swarm.horizon(i) for i in range(len(steps))]
        drawn = lanes(fates, steps, taus, begin, end, now, past.broadcasts)
        worst = float(past.swarm.rows[np.argmax(past.swarm.rows[:, 1]), 0])
        only = self._told[0] if self._model.crowded else None
        near = zoom(past.broadcasts, steps, worst, now, only)
        title = "Late, lost, false; backup, silence"
        return [Plot(title, "", [], lanes=drawn, zoom=near)]

    def _least_distance(self) -> Safe:
        return (2.0 * self._model.radius if self._model.radius else None), None

    def _near_pairs(self) -> list[Curve]:
        (t, h), (*others, worst) = self._pairs, self._nearest
        if not len(t):
            return []
        label = self._model.label
        return [
            *(curve(Series(t, h[:, k]), highest, label(k)) for k in others),
            curve(Series(t, h[:, worst]), highest, label(worst), role="chosen"),
        ]

    def _every(self, of: Callable[[int, AgentSeries], Array], keep: Keep) -> list[Curve]:
        """One quantity of every agent that is told; in an envelope where there are many."""
        most = points_each(len(self._told))
        series = [Series(steps.t, of(i, steps)) for i, steps in enumerate(self._steps)]
        own = [curve(series[i], keep, agent=i, most=most) for i in self._told]
        return [*envelope(series), *own] if self._model.crowded else own

    def _input(self, i: int, c: int) -> Plot:
        """One input of one agent: applied, nominal, and its bounds."""
        steps, bounds = self._steps[i], self._model.input_bounds[i]
        most = points_each(len(self._told))
        curves = [
            curve(Series(steps.t, steps.u_nom[:, c]), farthest, "nominal", role="guide", most=most),
            curve(Series(steps.t, steps.u[:, c]), farthest, agent=i, most=most),
        ]
        safe: Safe = (None, None) if bounds is None else (float(bounds[0][c]), float(bounds[1][c]))
        name = self._model.input_names(i)[c]
        unit = self._model.input_units[i][name]
        return Plot(_input(name), unit, curves, safe, of_agents=True, agent=i)


def _psi(k: int) -> str:
    return f"ψ_{k}"


def _input(name: str) -> str:
    return f"Input {name} and nominal"


def _plotted(quantity: Quantity, values: Array, horizon: float) -> Array:
    """A number's values as its plot shows them, of an agent with this τ [s]."""
    if quantity.in_horizons:
        return np.maximum(values / horizon, LEAST_HORIZON)
    if quantity.unit == OF_ROW:
        return np.where(values > NOBODY_NEAR, values, np.nan)
    return 1e3 * values if quantity.unit == "s" else values


def _plotted_unit(quantity: Quantity, model: SceneModel) -> str:
    if quantity.in_horizons:
        return "τ"
    return "ms" if quantity.unit == "s" else model.unit_of(quantity)


def _bold(rows: Array, column: int, keep: Keep) -> Curve:
    return curve(Series(rows[:, 0], rows[:, column]), keep, role="chosen")


def _marks(feed: Feed, steps: list[AgentSeries]) -> list[Mark]:
    """The worst moment, the first backup, violations, faults and every line of the log."""
    rows = feed.history.swarm.rows
    if not len(rows):
        return []
    worst = rows[int(np.argmax(rows[:, 1]))]
    found = [Mark(float(worst[0]), f"worst moment, h_tot = {worst[1]:.4g}", "worst")]
    backups = [s.t[s.empty == EMPTY_CODES[Origin.BACKUP]] for s in steps]
    if first := [float(t[0]) for t in backups if len(t)]:
        found.append(Mark(min(first), "first backup", "backup"))
    found += [Mark(v.first, f"{v.pair}: violated", "violation") for v in feed.violations]
    for t, agent, condition in feed.history.conditions:
        found.append(Mark(t, f"agent {feed.model.names[agent]}: {condition}", "fault"))
    return found + [Mark(line.t, line.text) for line in feed.log]


def empty_periods(agent: int, steps: AgentSeries) -> list[Period]:
    """From the step at which K_i was empty until the next at which it was not."""
    found = []
    for kind, value in EMPTY_CODES.items():
        held = np.concatenate([[False], steps.empty == value, [False]])
        edges = np.flatnonzero(np.diff(held.astype(int)))
        last = len(steps.t) - 1
        for begin, end in edges.reshape(-1, 2).tolist():
            t, until = steps.t[begin], steps.t[min(end, last)]
            found.append(Period(agent, kind, float(t), float(until)))
    return found


def fault_periods(changes: list[ConditionChange], end: float) -> list[Period]:
    """From each change of condition to the agent's next, or to the end [s]."""
    found = []
    for k, change in enumerate(changes):
        later = (c.t for c in changes[k + 1 :] if c.agent == change.agent)
        if change.condition != Condition.FINE:
            until = next(later, end)
            found.append(Period(change.agent, change.condition, change.t, until))
    return found
