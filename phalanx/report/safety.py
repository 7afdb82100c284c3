"""Figures of safety over time: h_tot, and ψ_k where q > 1."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.arrays import Array
from phalanx.curves.history import RecordedHistory
from phalanx.curves.thinning import kept
from phalanx.recording.read import Recording
from phalanx.report.history import ReportHistory
from phalanx.report.style import LIMIT, NORMAL, PEAK, current, legend, panels, summarises
from phalanx.swarm.swarm import unit_of_psi

_PSI_POINTS, _MANY_PSI_POINTS = 600, 100
"""Most states at which ψ_k is evaluated; with many agents it takes longer."""


class Worst(NamedTuple):
    """The largest h_tot of a run."""

    h_tot: float
    t: float
    """[s]"""


def worst(recording: Recording) -> Worst | None:
    """The largest h_tot and its time; None if no state was recorded."""
    if not recording.states:
        return None
    if recording.summary:
        return Worst(recording.summary.worst_h_tot, recording.summary.worst_at)
    state = max(recording.states, key=lambda s: s.h_tot)
    return Worst(state.h_tot, state.t)


def safety(history: ReportHistory, largest: Array | None = None) -> Figure:
    """Draw h_tot over time, and a second panel around zero if that was crossed; needs a state.

    largest: the largest h of a pair at each state, drawn too if given.
    """
    peak = worst(history.recording)
    assert peak is not None
    figure, rows = panels(2 if peak.h_tot > 0.0 else 1, 3.0)
    for axes in rows:
        draw_h(axes, history, peak, largest)
    if peak.h_tot > 0.0:
        rows[0].set_xlabel("")
        rows[1].set_ylim(-2.0 * peak.h_tot, 1.3 * peak.h_tot)
        rows[1].set_title("", loc="right")
    if largest is not None:
        legend(rows[0])
    return figure


def draw_h(axes: Axes, history: RecordedHistory, peak: Worst, largest: Array | None) -> None:
    """Draw h_tot over time, with its worst value; largest: as safety takes it."""
    shown = kept(history.h_tot)
    t, h = history.times[shown], history.h_tot[shown]
    axes.plot(t, h, color=NORMAL, linewidth=1.2, label=r"$h_{tot}$")
    if largest is not None:
        label = "largest h of a pair"
        axes.plot(history.times, largest, color="#111111", linewidth=0.9, label=label)
    axes.axhline(0.0, color=LIMIT, linewidth=1.2)
    axes.fill_between(t, h, 0.0, where=h > 0.0, interpolate=True, color=PEAK, alpha=0.5)
    axes.plot([peak.t], [peak.h_tot], "o", color=PEAK, markersize=5)
    axes.set_ylabel(f"$h_{{tot}}$ [{unit_of_psi(history.scenario) or 'SI'}]")
    axes.margins(x=0.01)
    axes.set_ylim(top=max(axes.get_ylim()[1], 0.06 * np.ptp(h), 0.1))
    title = f"worst {peak.h_tot:.4g} at {peak.t:.3f} s"
    axes.set_title(title, loc="right", color=PEAK, fontsize=current().title)
    axes.set_xlabel("t [s]")


def psi(history: RecordedHistory) -> Figure | None:
    """Draw the largest ψ_1 ... ψ_{q-1} over time, at or below 0 in S_I; None where q = 1."""
    levels = history.values.psi_levels
    if not levels:
        return None
    points = _MANY_PSI_POINTS if summarises(history.scenario) else _PSI_POINTS
    chosen = np.unique(np.linspace(0, len(history.times) - 1, points).astype(int))
    t = history.times[chosen]
    largest = np.array([history.values.higher_psi(x) for x in history.x[chosen]])
    figure, rows = panels(len(levels), 2.4)
    for k, values, axes in zip(levels, largest.T, rows, strict=True):
        axes.plot(t, values, color=NORMAL, linewidth=1.2)
        axes.axhline(0.0, color=LIMIT, linewidth=1.2)
        axes.fill_between(t, values, 0.0, where=values > 0.0, color=PEAK, alpha=0.5)
        unit = unit_of_psi(history.scenario, k) or "SI"
        axes.set_ylabel(f"largest $\\psi_{k}$ [{unit}]")
        axes.margins(x=0.01)
        at = int(values.argmax())
        title = f"largest {values[at]:.4g} at {t[at]:.3f} s"
        colour = PEAK if values[at] > 0.0 else LIMIT
        axes.set_title(title, loc="right", color=colour, fontsize=current().title)
    rows[-1].set_xlabel("t [s]")
    return figure
