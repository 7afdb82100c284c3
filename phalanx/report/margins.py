"""The margin that rows used beside the margin they needed, from recorded states and inputs."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from phalanx.arrays import Array, Mask
from phalanx.curves.history import RecordedHistory
from phalanx.curves.thinning import Series
from phalanx.recording.records import Step
from phalanx.report.style import (
    LIMIT,
    PEAK,
    colours,
    draw_crowd,
    legend,
    logarithmic,
    panels,
    summarises,
)
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import unit_of_psi
from phalanx.theory.margins.integrated import RowPart
from phalanx.theory.rows.pairs import PairTerms

_INSTANTS, _CROWD_INSTANTS = 300, 24
"""Most steps of each agent at which margins are computed again."""


class MarginUse(NamedTuple):
    """Margins of the pair that was nearest to binding, at some steps of one agent; shapes (s,)."""

    t: Array
    """When the steps' inputs took effect [s]."""
    used: Array
    """η of the agent's row, with all that it adds at the sampled state."""
    needed: Array
    """The least that is proven of the input that was applied; inf where nothing is."""

    @property
    def short(self) -> Mask:
        """Where less was used than is proven to be enough."""
        return self.used < self.needed


def margin_use(history: RecordedHistory, i: int) -> MarginUse | None:
    """Normal agent i's margins at evenly chosen steps; None if it had no pair at any.

    Raises:
        ValueError: some input bounds depend on the state.
        UnboundedOperationError: an expression has no interval extension.
    """
    rows, swarm, steps = history.values.rows, history.swarm, history.steps[i]
    most = _CROWD_INSTANTS if summarises(history.scenario) else _INSTANTS
    places = range(len(steps)) if len(steps) <= most else np.linspace(0, len(steps) - 1, most)
    sharing = swarm.normal if swarm.safety.pairwise and swarm.safety.joint else ()
    needing, used = rows.pair_terms_of_input(i), _used(rows, i, sharing)
    found = []
    for step, x in _sampled(history, [steps[int(k)] for k in places]):
        seen = swarm.seen(i, x)
        needed = needing(x, seen, sharing, step.u)
        if not needed.others:
            continue
        nearest = int(_left(needed, np.array(step.u)).argmax())
        found.append((step.t_apply, used(x, seen, nearest), needed.margin[nearest]))
    return MarginUse(*np.array(found).T) if found else None


def _used(
    rows: SafetyRows, i: int, sharing: Sequence[int]
) -> Callable[[Array, Sequence[int], int], float]:
    """(x, who is seen, the pair's place) -> η of agent i's row."""
    if rows.swarm.safety.pairwise:
        pairs = rows.pair_terms(i)
        return lambda x, seen, place: float(pairs(x, seen, sharing).margin[place])
    composed = rows.terms(i)
    return lambda x, seen, _: composed(x, seen).margin


def _sampled(history: RecordedHistory, steps: list[Step]) -> Iterator[tuple[Step, Array]]:
    """Each step with the newest state that was recorded by its sample."""
    for step in steps:
        yield step, history.x[max(0, int(np.searchsorted(history.times, step.t, side="right")) - 1)]


def _left(terms: PairTerms, u: Array) -> Array:
    """Each pair's condition without its margin; at -η a row binds, shape (r,)."""
    alone = terms.half
    shares = np.where(alone, RowPart.HALF.value, RowPart.WHOLE.value)
    left: Array = shares * terms.unforced + np.where(alone, 0.0, terms.most) + terms.a @ u
    return left


def margins(history: RecordedHistory) -> tuple[Figure, str] | None:
    """The figure of all normal agents and what it says in a sentence; None without any pair."""
    swarm = history.swarm
    try:
        each = {swarm.names[i]: margin_use(history, i) for i in swarm.normal}
    except ValueError as error:
        return _unknown(), f"Margins needed are unknown: {error}."
    uses = {name: use for name, use in each.items() if use is not None}
    if not uses:
        return None
    drawn = _of_many(uses) if summarises(history.scenario) else _of_each(history, uses)
    return drawn, _in_words(history.values.rows, uses)


def _of_each(history: RecordedHistory, uses: dict[str, MarginUse]) -> Figure:
    """A panel for each agent: both margins over time."""
    figure, panes = panels(len(uses), 1.9)
    unit = unit_of_psi(history.scenario, history.swarm.pairs.degree) or "SI"
    palette = colours(history.scenario)
    for (name, use), axes in zip(uses.items(), panes, strict=True):
        proven = np.where(np.isfinite(use.needed), use.needed, np.nan)
        axes.plot(use.t, use.used, color=LIMIT, linewidth=1.2, label="used")
        axes.plot(use.t, proven, color=palette[name], linewidth=1.2, label="needed")
        axes.fill_between(
            use.t,
            use.used,
            proven,
            where=use.short,
            color=PEAK,
            alpha=0.15,
            label="short" if use.short.any() else None,
        )
        logarithmic(axes)
        axes.margins(x=0.01, y=0.15)
        axes.set_ylabel(f"margin [{unit}]")
        axes.set_title(_counted(use), loc="right", fontsize=9)
        legend(axes, f"agent {name}")
    panes[-1].set_xlabel("t [s]")
    return figure


def _of_many(uses: dict[str, MarginUse]) -> Figure:
    """How many times the needed margin was used, over all agents."""
    curves = {name: Series(use.t, use.used / use.needed) for name, use in uses.items()}
    figure, (axes,) = panels(1, 3.0)
    worst = sorted(curves, key=lambda name: float(curves[name].y.min()))
    draw_crowd(axes, curves, worst, "normal agents", " times")
    axes.axhline(1.0, color=LIMIT, linewidth=1.2)
    logarithmic(axes)
    axes.set_ylabel("margin used / needed")
    axes.set_xlabel("t [s]")
    return figure


def _unknown() -> Figure:
    figure, (axes,) = panels(1, 0.4)
    axes.set_axis_off()
    axes.text(0.0, 0.5, "margin used: as the scenario has it; margin needed: unknown", va="center")
    return figure


def _counted(use: MarginUse) -> str:
    least = float((use.used / use.needed).min())
    return f"at least {least:.3g} of it used, short at {use.short.sum()} of {len(use.t)} steps"


def _in_words(rows: SafetyRows, uses: dict[str, MarginUse]) -> str:
    short = sum(int(use.short.sum()) for use in uses.values())
    total = sum(len(use.t) for use in uses.values())
    row = "a row" if rows.swarm.safety.pairwise else "a row for h_tot"
    return (
        f"Margin used against margin needed: η of {row} beside the least that is proven to last "
        "until the next sample, for the input that was applied and the pair nearest to binding "
        f"alone; the row used less than that at {short} of {total} steps. A run may be guaranteed "
        "all the same: its certificates are of the inputs that were applied, not of the rows."
    )
