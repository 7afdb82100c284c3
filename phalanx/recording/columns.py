"""Events of a run as columns: what a fold over them takes, of an instant or of a whole run.

Every event has a number; one with a smaller number came before. Rows are in the order of events. No
object stands for an event, so that a loop which makes these columns by itself is judged alike.
"""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from phalanx.messages.step_report import StepReport
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.rows.origin import Origin

_ORIGINS = {origin: number for number, origin in enumerate(Origin)}


class States(NamedTuple):
    """States that the world reached."""

    number: Index
    """Of each event, shape (n,)."""
    t: Array
    """[s], shape (n,)"""
    x: Array
    """Stacked states, shape (n, n̄)."""


class Samples(NamedTuple):
    """Samples that agents took."""

    number: Index
    """shape (s,)"""
    i: Index
    """Of its agent, shape (s,)."""
    t: Array
    """[s], shape (s,)"""
    truthful: Mask
    """Whether its sensors measured the true state, shape (s,)."""


class Inputs(NamedTuple):
    """Inputs that actuators applied or, if lost, did not; with their agents' reports."""

    number: Index
    """shape (r,)"""
    i: Index
    """Of its agent, shape (r,)."""
    k: Index
    """Of the sample that it answers, shape (r,)."""
    t_sample: Array
    """[s], shape (r,)"""
    t_apply: Array
    """When it took effect, or was due [s]; shape (r,)."""
    lost: Mask
    """shape (r,)"""
    origin: Index
    """Number of each in the list of Origin, shape (r,)."""
    u: Array
    """Native inputs, padded with zeros, shape (r, m)."""
    u_nom: Array
    """Nominal inputs, padded like them, shape (r, m); NaN where they are unknown."""
    bindings: Index
    """Last index of each in `binding`, shape (r,)."""
    binding: Index
    """Whose rows each input is at the bound of, one after the other; as in a StepReport."""


class Aged(NamedTuple):
    """Received inputs that rows used."""

    row: Index
    """Of the input that the row made, shape (a,)."""
    sender: Index
    """shape (a,)"""
    age: Array
    """[s], shape (a,)"""


class Stated(NamedTuple):
    """Claims of broadcasts that receivers report, and that count."""

    row: Index
    """Of the input with whose report it came, shape (c,)."""
    sender: Index
    """shape (c,)"""
    k: Index
    """Number of the broadcast, shape (c,)."""
    t_apply: Array
    """Claimed [s], shape (c,)."""
    values: Array
    """Claimed input and, by radio, state, padded as the inputs are; NaN if their sizes are not the
    sender's; shape (c, m + n)."""


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
    u: Sequence[Sequence[float] | Array],
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
    fits = np.arange(widths.max()) < widths[indices(i)][:, None]
    inputs, wishes = np.zeros(fits.shape), np.full(fits.shape, np.nan)
    inputs[fits] = list(chain.from_iterable(u))
    stated = [report.u_nom for report in reports]
    known = indices([len(u_nom) for u_nom in stated]) == widths[indices(i)]
    wishes[known], bindings = 0.0, [report.binding for report in reports]
    wishes[fits & known[:, None]] = list(
        chain.from_iterable(
            [w for w, is_known in zip(stated, known.tolist(), strict=True) if is_known]
        )
    )
    return Inputs(
        indices(number), indices(i), indices(k), np.array(t_sample), np.array(t_apply),
        np.array(lost, dtype=bool), indices([_ORIGINS[report.origin] for report in reports]),
        inputs, wishes, np.cumsum(indices(list(map(len, bindings)))),
        indices(list(chain.from_iterable(bindings))),
    )  # fmt: skip
