"""Events of a run as columns: what a fold over them takes, of an instant or of a whole run.

Every event has a number; one with a smaller number came before. Rows are in the order of events. No
object stands for an event, so that a loop which makes these columns by itself is judged the same.
"""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from phalanx.guarantee.verdict import Deadlock
from phalanx.messages.step_report import StepReport
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.rows.origin import Origin

ORIGINS = {origin: number for number, origin in enumerate(Origin)}
"""Numbers of all, in columns."""


class States(NamedTuple):
    """n states that the world reached."""

    number: Index
    t: Array
    """[s]"""
    x: Array
    """Stacked states, shape (n, n̄)."""


class Samples(NamedTuple):
    """Samples that agents i took."""

    number: Index
    i: Index
    t: Array
    """[s]"""
    truthful: Mask
    """Whether the sensors measured the true state."""


class Inputs(NamedTuple):
    """r inputs that actuators of agents i applied or, if lost, did not; with reports on them."""

    number: Index
    i: Index
    k: Index
    """Of the sample that it answers."""
    t_sample: Array
    """[s]"""
    t_apply: Array
    """When it took effect, or was due [s]."""
    lost: Mask
    origin: Index
    """Its place in the list of Origin."""
    u: Array
    """Native inputs, padded with zeros to the widest, shape (r, m)."""
    u_nom: Array
    """Nominal inputs, padded like them; NaN where they are unknown."""
    bindings: Index
    """Where the rows that it is at the bound of end in `binding`."""
    binding: Index
    """These rows, as in a StepReport, of one input after the other."""


class Aged(NamedTuple):
    """Received inputs that agents' rows used."""

    row: Index
    """Of the input that was made of it."""
    sender: Index
    age: Array
    """[s]"""


class Stated(NamedTuple):
    """c claims of broadcasts that believed receivers report."""

    row: Index
    """Of the input with whose report it came."""
    place: Index
    """Among the fates in that report."""
    sender: Index
    k: Index
    """Of the broadcast."""
    t_apply: Array
    """Claimed [s]."""
    values: Array
    """Claimed input and, by radio, state, padded as inputs are, shape (c, m + n); NaN if their
    sizes are not the sender's."""


class Track(NamedTuple):
    """The recorded states of a run, its inputs and deadlocks: what metrics are made of."""

    states: States
    inputs: Inputs
    deadlocks: list[Deadlock] | None
    """None if they are not known."""


class TrueStates(NamedTuple):
    """The true state at each input, and at the sample that it answers."""

    table: Array
    """Stacked states, shape (s, n̄)."""
    now: Index
    """Rows in the table, shape (r,)."""
    sampled: Index
    """shape (r,)"""

    def at_sample(self, row: int) -> Array:
        """Return that at the sample of one input, shape (n̄,)."""
        x: Array = self.table[self.sampled[row]]
        return x


def last_before(agents: Index, numbers: Index, of: Index, before: Index) -> Index:
    """Return the row of each agent's last event before a number, -1 if there is none; shape (q,).

    Args:
        agents: of the events, in their order, shape (n,).
        numbers: of the events, shape (n,).
        of: the agents that are asked for, shape (q,).
        before: the numbers, shape (q,).
    """
    if not len(agents):
        return np.full(len(of), -1)
    begin = min(numbers[0], before.min(initial=numbers[0]))
    span = 1 + max(numbers[-1], before.max(initial=0)) - begin
    order = np.argsort(agents, kind="stable")
    keys = agents * span + (numbers - begin)
    rows = order[np.searchsorted(keys[order], of * span + (before - begin)) - 1]
    exists = (agents[rows] == of) & (numbers[rows] < before)
    return np.where(exists, rows, -1)


def indices(numbers: Sequence[int]) -> Index:
    """Return whole numbers as a column, even if there are none."""
    return np.array(numbers, dtype=np.intp)


def inputs_of(
    events: Sequence[tuple[int, int, int, float, float, bool]],
    u: Sequence[Sequence[float]],
    reports: Sequence[StepReport],
    widths: Index,
) -> Inputs:
    """Return the columns of inputs.

    Args:
        events: the number, agent, k, t_sample [s], t_apply [s] of each, and whether it was lost.
        u: native inputs.
        reports: on the steps that made them.
        widths: m_i of each agent, shape (N,).
    """
    number, i, k, t_sample, t_apply, lost = zip(*events, strict=True) if events else [()] * 6
    fits, widest = widths[indices(i)], int(widths.max())
    bindings, origins = [r.binding for r in reports], [ORIGINS[r.origin] for r in reports]
    return Inputs(
        indices(number), indices(i), indices(k), np.array(t_sample), np.array(t_apply),
        np.array(lost, dtype=bool), indices(origins), _padded(u, fits, widest, 0.0),
        _padded([r.u_nom for r in reports], fits, widest, np.nan),
        np.cumsum(indices([*map(len, bindings)])), indices([*chain.from_iterable(bindings)]),
    )  # fmt: skip


def _padded(rows: Sequence[Sequence[float]], fits: Index, widest: int, unknown: float) -> Array:
    """Return rows padded with zeros; those that are not as long as they should be are unknown."""
    fit = np.array([*map(len, rows)], dtype=np.intp) == fits
    table = np.zeros((len(rows), widest))
    table[~fit] = unknown
    known = [row for row, is_known in zip(rows, fit.tolist(), strict=True) if is_known]
    table[(np.arange(widest) < fits[:, None]) & fit[:, None]] = [*chain.from_iterable(known)]
    return table
