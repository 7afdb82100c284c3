"""Time series: thinned, the envelope of many, those of control steps; and the lanes of agents."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from phalanx.messages.step_report import OF_ROW, QUANTITIES, Quantity
from phalanx.recording.curves.history import EMPTY_CODES, AgentSeries, History
from phalanx.swarm.swarm import Swarm, unit_of_psi
from phalanx.theory.arrays import Array, Index
from phalanx.theory.models.dynamics import units
from phalanx.theory.models.polytope import Polytope, constant_polytope
from phalanx.theory.safety.composition import FAR

QUANTILES = (0.0, 0.1, 0.5, 0.9, 1.0)
_MOST_POINTS = 1600
_MOST_INTERVALS = 300
"""More than can be distinguished in a figure."""
LEAST_HORIZON = 0.1
"""Where a certified time is drawn that is shorter than this many τ: no logarithm has a 0."""
NO_ROW = 1e-3 * FAR
"""A residual at or below this is no row's: no pair was composed, so that none had to be kept."""
LANE_STATES = ("fine", "backup", "no-authority", "silent")
"""The gravest last. Silent: no step for longer than its τ."""
_SILENT = LANE_STATES.index("silent")
_ZOOM_STEPS = 8


class Series(NamedTuple):
    """Values at times [s], shapes (s,); NaN where there is none."""

    t: Array
    y: Array

    def finite(self) -> "Series":
        """The values that are not NaN."""
        finite = np.isfinite(self.y)
        return Series(self.t[finite], self.y[finite])

    def extended(self, until: float) -> "Series":
        """The same, with the last value until a later time [s]."""
        return Series(np.append(self.t, [until] * len(self.t[-1:])), np.append(self.y, self.y[-1:]))


def extremes(
    y: Array, most: int = _MOST_POINTS, *, highest: bool = True, lowest: bool = True
) -> Index:
    """Choose the values of y, shape (s,), through which it is drawn, by index; NaN is a gap.

    most: number of values kept. highest, lowest: whether the largest, the smallest value of every
    block is kept, so that each peak is seen.
    """
    if len(y) <= most:
        return np.arange(len(y))
    size = -(-len(y) // ((most - 2) // (highest + lowest)))
    blocks = np.minimum(np.arange(-(-len(y) // size) * size), len(y) - 1).reshape(-1, size)
    values, rows = y[blocks], np.arange(len(blocks))
    chosen = [np.array([0, len(y) - 1])]
    if highest:
        chosen.append(blocks[rows, np.where(np.isnan(values), -np.inf, values).argmax(axis=1)])
    if lowest:
        chosen.append(blocks[rows, np.where(np.isnan(values), np.inf, values).argmin(axis=1)])
    return np.unique(np.concatenate(chosen))


class Envelope(NamedTuple):
    """Quantiles of all values in each interval of time; an interval without values is left out."""

    edges: Array
    """Where the intervals begin and end [s], shape (b, 2)."""
    values: Array
    """By QUANTILES, shape (5, b); each is one of the values, not interpolated."""


def envelope(curves: Sequence[Series], most: int = _MOST_INTERVALS) -> Envelope:
    """Compute the envelope of many curves in at most `most` intervals.

    An interval holds two values of each curve, about: with one, clocks that jitter would leave a
    curve out of some.
    """
    finite = [s.finite() for s in curves] or [Series(np.zeros(0), np.zeros(0))]
    t, values = (np.concatenate(c) for c in zip(*finite, strict=True))
    if not len(t):
        return Envelope(np.zeros((0, 2)), np.zeros((len(QUANTILES), 0)))
    intervals = max(1, min(int(np.median([len(s.t) for s in curves])) // 2, most))
    edges = np.linspace(t.min(), t.max(), intervals + 1)
    at = (intervals / max(np.ptp(t), 1e-9) * (t - t.min())).astype(np.int16)
    interval = np.minimum(at, intervals - 1)
    # Of small integers a stable sort is a radix sort, and a few ranks need no sorted values.
    order = np.argsort(interval, kind="stable")
    filled, begin = np.unique(interval[order], return_index=True)

    def ranked(of_interval: Array) -> Array:
        """The values nearest to QUANTILES."""
        ranks = np.round(np.array(QUANTILES) * (len(of_interval) - 1)).astype(int)
        values: Array = np.partition(of_interval, ranks)[ranks]
        return values

    quantiles = [ranked(of_interval) for of_interval in np.split(values[order], begin[1:])]
    return Envelope(np.stack([edges[filled], edges[filled + 1]], axis=1), np.array(quantiles).T)


def step_series(swarm: Swarm, name: str, steps: Mapping[int, AgentSeries]) -> dict[int, Series]:
    """A number of these agents' control steps over time, in the plot's unit."""
    return {
        i: Series(s.t, plotted(QUANTITIES[name], s.numbers[name], swarm.horizon(i)))
        for i, s in steps.items()
    }


def plotted(quantity: Quantity, values: Array, horizon: float) -> Array:
    """Convert values to the unit of their plot, for an agent with this τ [s]."""
    if quantity.in_horizons:
        return np.maximum(values / horizon, LEAST_HORIZON)
    if quantity.unit == OF_ROW:
        return np.where(values > NO_ROW, values, np.nan)
    return 1e3 * values if quantity.unit == "s" else values


def plotted_unit(quantity: Quantity, swarm: Swarm) -> str:
    """Unit of the number's plot."""
    if quantity.in_horizons:
        return "τ"
    return "ms" if quantity.unit == "s" else unit_of(quantity, swarm)


def unit_of(quantity: Quantity, swarm: Swarm) -> str:
    """Unit of a number as it is recorded; "" if it has none, or none is known."""
    of_row = quantity.unit == OF_ROW
    return unit_of_psi(swarm.scenario, swarm.pairs.degree) if of_row else quantity.unit


class InputCurve(NamedTuple):
    """One component of an agent's inputs."""

    name: str
    unit: str
    applied: Series
    nominal: Series
    """NaN where it is unknown."""
    bounds: tuple[float | None, float | None]
    """Least and largest; None where they vary."""


def input_curves(swarm: Swarm, i: int, steps: AgentSeries) -> list[InputCurve]:
    """Every component of agent i's inputs."""
    dynamics, polytope = swarm.members[i].dynamics, input_polytope(swarm, i)
    unknown = [(None, None)] * len(dynamics.inputs)
    bounds = [(min(c), max(c)) for c in polytope.corners.T.tolist()] if polytope else unknown
    input_units = units(dynamics).inputs
    return [
        InputCurve(
            name,
            input_units[name],
            Series(steps.t, steps.u[:, c]),
            Series(steps.t, steps.u_nom[:, c]),
            bounds[c],
        )
        for c, name in enumerate(dynamics.inputs)
    ]


def input_polytope(swarm: Swarm, i: int) -> Polytope | None:
    """Agent i's U_i; None where it depends on the state."""
    x = swarm.safe_set.x[swarm.safe_set.parts[i]]
    return constant_polytope(*swarm.members[i].dynamics.input_polytope(x))


class Lanes(NamedTuple):
    """Every agent's lane over the same intervals of time; each of shape (N, c)."""

    late: Array
    """Share of the broadcasts to it that came too late for its next step."""
    lost: Array
    """Share of the broadcasts to it that were lost."""
    state: Index
    """Its gravest state, as an index in LANE_STATES."""
    false: Array
    """1 where it sent a false broadcast, else 0."""


def lanes(
    history: History, steps: Sequence[AgentSeries], taus: Sequence[float],
    span: tuple[float, float], now: float, most: int,
) -> Lanes:  # fmt: skip
    """Compute every agent's lane over a span of time, in so many intervals at most.

    taus: longest time without a step before each agent counts as silent. now: the latest time known
    of the run. All times in [s].
    """
    intervals = int(np.clip(max(len(s.t) for s in steps), 1, most))
    shape, (begin, end) = (len(steps), intervals), span

    def counted(agents: Array, t: Array, counts: Array) -> Array:
        at = np.clip(intervals * (t - begin) / (end - begin), 0, intervals - 1).astype(int)
        cells = intervals * agents.astype(int) + at
        sums = np.bincount(cells, counts, shape[0] * intervals).reshape(shape)
        return sums.astype(float)

    fates = history.fates
    total, late, lost = (
        counted(fates.receiver, fates.t, counts) for counts in (fates.total, fates.late, fates.lost)
    )
    false = history.broadcasts[history.broadcasts.false]
    edges = np.linspace(begin, end, intervals + 1)
    return Lanes(
        late / np.maximum(total, 1.0),
        lost / np.maximum(total, 1.0),
        np.array([_states(s, tau, edges, now) for s, tau in zip(steps, taus, strict=True)]),
        np.minimum(counted(false.sender, false.sent, np.ones(len(false))), 1.0),
    )


def zoom_window(
    steps: Sequence[AgentSeries], worst: float, end: float, every: int = 1
) -> tuple[float, float]:
    """Begin and end of a few control steps around the worst moment of a run, or at its end [s].

    every: steps from one broadcast to the next.
    """
    gaps = [float(np.median(np.diff(s.sampled))) for s in steps if len(s.sampled) > 1]
    width = max(_ZOOM_STEPS, 2 * every) * max(gaps, default=1.0)
    begin = max(min(worst - width / 2.0, end - width), 0.0)
    return begin, begin + width


def _states(steps: AgentSeries, tau: float, edges: Array, now: float) -> Index:
    """Find the gravest state in each interval, as an index in LANE_STATES."""
    states = np.zeros(len(edges) - 1, dtype=np.intp)
    until = np.append(steps.sampled[1:], now)
    for k in np.flatnonzero((steps.empty > 0.0) | (until - steps.sampled > 1.5 * tau)):
        begin, end, code = steps.sampled[k], until[k], steps.empty[k]
        if code:
            kind = next(kind for kind, value in EMPTY_CODES.items() if value == code)
            _mark(states, edges, begin, min(end, begin + tau), LANE_STATES.index(kind))
        if end - begin > 1.5 * tau:
            _mark(states, edges, begin + tau, end, _SILENT)
    return states


def _mark(states: Index, edges: Array, begin: float, end: float, state: int) -> None:
    first = max(int(np.searchsorted(edges, begin, side="right")) - 1, 0)
    cells = slice(first, max(int(np.searchsorted(edges, end)), first + 1))
    states[cells] = np.maximum(states[cells], state)
