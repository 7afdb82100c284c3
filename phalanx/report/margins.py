"""The margin that rows used and the margin they needed, from recorded states and inputs."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from phalanx.arrays import Array, Mask
from phalanx.curves.history import ReportHistory
from phalanx.curves.series import Series
from phalanx.report import style
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import unit_of_psi
from phalanx.theory.margins.integrated import RowPart

_INSTANTS, _MANY_INSTANTS = 300, 24
"""Most steps of each agent at which margins are computed again."""


class MarginUse(NamedTuple):
    """Margins of the pair nearest to binding, at some steps of one agent; shapes (s,)."""

    t: Array
    """Times at which the steps' inputs took effect [s]."""
    used: Array
    """η of the agent's row at the sampled state."""
    needed: Array
    """Least η that is proven to suffice for the input that was applied; inf if none is."""

    @property
    def short(self) -> Mask:
        """True at steps that used less than is proven to suffice."""
        return self.used < self.needed

    @property
    def share(self) -> Array:
        """The margin used over the one needed, shape (s,); inf where none is needed."""
        share: Array = np.full(len(self.t), np.inf)
        np.divide(self.used, self.needed, out=share, where=self.needed > 0.0)
        return share


def margin_use(history: ReportHistory, i: int) -> MarginUse | None:
    """Normal agent i's margins at evenly chosen steps; None if it had no pair at any.

    Raises ValueError if some input bounds depend on the state, UnboundedOperationError if an
    expression has no interval extension.
    """
    rows, steps = history.values.rows.seen_by(i), history.steps[i]
    swarm = rows.swarm
    most = _MANY_INSTANTS if style.summarises(history.scenario) else _INSTANTS
    places = np.unique(np.linspace(0, len(steps) - 1, min(most, len(steps))).astype(int))
    sharing = swarm.normal if swarm.safety.pairwise and swarm.safety.joint else ()
    needing, used = rows.pair_terms_of_input(i), _used(rows, i, sharing)
    found = []
    for step in (steps[k] for k in places):
        # The newest state that was recorded up to the step's sample.
        x = history.x[max(0, int(np.searchsorted(history.times, step.t, side="right")) - 1)]
        seen = swarm.seen(i, x)
        needed = needing(x, seen, sharing, step.u)
        if not needed.others:
            continue
        # Each pair's condition without its margin: at -η a row binds.
        shares = np.where(needed.half, RowPart.HALF.value, RowPart.WHOLE.value)
        most_of_others = np.where(needed.half, 0.0, needed.most)
        nearest = int((shares * needed.unforced + most_of_others + needed.a @ step.u).argmax())
        found.append((step.t_apply, used(x, seen, nearest), needed.margin[nearest]))
    return MarginUse(*np.array(found).T) if found else None


def _used(
    rows: SafetyRows, i: int, sharing: Sequence[int]
) -> Callable[[Array, Sequence[int], int], float]:
    """Return a function (x, agents seen, the pair's place) -> η of agent i's row."""
    if rows.swarm.safety.pairwise:
        pairs = rows.pair_terms(i)
        return lambda x, seen, place: float(pairs(x, seen, sharing).margin[place])
    composed = rows.terms(i)
    return lambda x, seen, _: composed(x, seen).margin


def margins(history: ReportHistory) -> tuple[Figure, str] | None:
    """The figure of all normal agents and its caption; None without any pair."""
    swarm = history.swarm
    try:
        each = {swarm.names[i]: margin_use(history, i) for i in swarm.normal}
    except ValueError as error:
        figure, (axes,) = style.panels(1, 0.4)
        axes.set_axis_off()
        axes.text(0.0, 0.5, "margin used: the scenario's; margin needed: unknown", va="center")
        return figure, f"Margins needed are unknown: {error}."
    uses = {name: use for name, use in each.items() if use is not None}
    if not uses:
        return None
    many = style.summarises(history.scenario)
    drawn = _many_figure(uses) if many else _each_figure(history, uses)
    return drawn, _caption(history.values.rows, uses)


def _each_figure(history: ReportHistory, uses: dict[str, MarginUse]) -> Figure:
    """A panel for each agent: both margins over time."""
    figure, rows = style.over_time(len(uses), 1.9)
    unit = unit_of_psi(history.scenario, history.swarm.pairs.degree) or "SI"
    palette = style.colours(history.scenario)
    for (name, use), axes in zip(uses.items(), rows, strict=True):
        proven = np.where(np.isfinite(use.needed), use.needed, np.nan)
        axes.plot(use.t, use.used, color=style.LIMIT, linewidth=1.2, label="used")
        axes.plot(use.t, proven, color=palette[name], linewidth=1.2, label="needed")
        label = "short" if use.short.any() else None
        axes.fill_between(
            use.t, use.used, proven, where=use.short, color=style.PEAK, alpha=0.15, label=label
        )
        style.logarithmic(axes)
        axes.margins(y=0.15)
        axes.set_ylabel(f"margin [{unit}]")
        least = f"at least {use.share.min():.3g} of it used"
        counted = f"{least}, short at {use.short.sum()} of {len(use.t)} steps"
        axes.set_title(counted, loc="right", fontsize=style.current().title - 1.0)
        style.legend(axes, f"agent {name}")
    return figure


def _many_figure(uses: dict[str, MarginUse]) -> Figure:
    """Margin used over margin needed, of all agents."""
    curves = {name: Series(use.t, use.share) for name, use in uses.items()}
    figure, (axes,) = style.over_time(1, 3.0)
    style.draw_many(axes, curves, lambda y: y.min(), "normal agents", " times")
    axes.axhline(1.0, color=style.LIMIT, linewidth=1.2)
    style.logarithmic(axes)
    axes.set_ylabel("margin used / needed")
    return figure


def _caption(rows: SafetyRows, uses: dict[str, MarginUse]) -> str:
    short = sum(int(use.short.sum()) for use in uses.values())
    total = sum(len(use.t) for use in uses.values())
    row = "a row" if rows.swarm.safety.pairwise else "a row for h_tot"
    return (
        f"Margin used and margin needed: η of {row}, and the least η that is proven to suffice "
        "until the next sample, for the input that was applied and the pair nearest to binding "
        f"alone; the row used less than that at {short} of {total} steps. A run may still be "
        "guaranteed, since its certificates are of the inputs that were applied, not of the rows."
    )
