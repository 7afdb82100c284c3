"""The plots beside the scene: uPlot, redrawn a few times a second."""

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from phalanx.viewer.feeds.history import (
    History,
    certified_horizon,
    swarm_horizons,
    thinned,
    until,
)
from phalanx.viewer.scene.model import SceneModel

Array = NDArray[np.float64]
Style = dict[str, object]

_POINTS = 500
"""Most points of a curve: all are sent anew each time, and the plot has no more pixels."""
_COLOURS = ("#2563eb", "#d97706", "#16a34a", "#9333ea")
_NO_POINTS: Style = {"points": {"show": False}}
_GUIDE: Style = {"stroke": "#94a3b8", "width": 1.0, "dash": (4, 4), **_NO_POINTS}
_BACKUP: Style = {
    "stroke": "#dc2626",
    "width": 0.0,
    "points": {"show": True, "size": 6, "fill": "#dc2626"},
}


class Plots:
    """h_tot, distance, ψ and certified times of the swarm, and what the selected agent did.

    Its certified times, inputs, ages of received inputs and solve times.
    """

    def __init__(self, server: viser.ViserServer, model: SceneModel) -> None:
        self._gui, self._model = server.gui, model
        self._scales: dict[str, uplot.Scale] = {
            "x": {"time": False, "range": (0.0, model.scenario.duration)}
        }
        levels = [f"ψ_{k}" for k in model.psi_levels]
        self._h_tot = self._plot("h_tot (safe: at most 0)", ["h_tot"], guides=["0"])
        self._distance = self._plot("Smallest distance [m]", ["distance"], guides=["required"])
        self._psi = self._plot("ψ_k of the swarm", levels, guides=["0"]) if levels else None
        self._horizons = self._plot(
            "Certified for [τ]: shortest, median", ["shortest", "median"], guides=["1"]
        )
        self._horizons.scales = {**self._scales, "y": {"distr": 3}}
        self._certified = self._plot("Certified for [τ]", ["certified"], guides=["1"])
        self._certified.scales = {**self._scales, "y": {"distr": 3}}
        most = max(len(model.input_names(i)) for i in range(len(model.names)))
        self._inputs = [
            self._plot(f"u_{c + 1}", ["u"], guides=["at most", "at least"], marks=["backup"])
            for c in range(most)
        ]
        self._ages = self._plot("Age of the oldest û [ms]", ["age"])
        self._solve = self._plot("Control step [ms]", ["wall time"])

    def show(self, history: History, t: float, selected: int) -> None:
        """Redraw everything up to t [s]."""
        past = until(history.swarm.rows, t)
        steps = until(history.agent(selected), t)
        agent = thinned(steps, _POINTS)
        if len(past):
            self._show_swarm(past)
        if len(agent):
            self._show_certified(steps, selected)
            self._show_agent(agent, selected)

    def _show_swarm(self, past: Array) -> None:
        rows, horizons = thinned(past, _POINTS), swarm_horizons(past, _POINTS)
        t, zero = rows[:, 0], np.zeros(len(rows))
        self._h_tot.data = (t, rows[:, 1], zero)
        self._distance.data = (t, rows[:, 2], zero + 2.0 * self._model.radius)
        if self._psi:
            self._psi.data = (t, *rows[:, 5:].T, zero)
        self._horizons.visible = len(horizons) > 0
        if len(horizons):
            self._horizons.data = (*horizons.T, np.ones(len(horizons)))

    def _show_agent(self, rows: Array, i: int) -> None:
        t, names = rows[:, 0], self._model.input_names(i)
        for c, plot in enumerate(self._inputs):
            plot.visible = c < len(names)
            if plot.visible:
                plot.title = f"Agent {self._model.names[i]}: {names[c]}"
                self._show_input(plot, rows, c, self._limits(i, c, rows[:, 5 + c]))
        known = np.isfinite(rows[:, 2])
        self._ages.data = (t[known], 1e3 * rows[known, 2])
        self._solve.data = (t, 1e3 * rows[:, 3])

    def _show_certified(self, steps: Array, i: int) -> None:
        t, horizon = certified_horizon(steps, self._model.swarm.horizon(i), _POINTS)
        self._certified.visible = len(t) > 0  # an adversary has none
        if len(t):
            self._certified.title = f"Agent {self._model.names[i]}: certified for [τ]"
            self._certified.data = (t, horizon, np.ones(len(t)))

    def _show_input(
        self, plot: viser.GuiUplotHandle, rows: Array, c: int, limits: tuple[float, float]
    ) -> None:
        (low, high), t, u = limits, rows[:, 0], rows[:, 5 + c]
        margin = 0.1 * (high - low) + 1e-3
        plot.scales = {**self._scales, "y": {"range": (low - margin, high + margin)}}
        # All series of a plot share their times, and JSON has no number for "none": a step without
        # a backup has its mark far below the axis.
        marks = np.where(rows[:, 1] > 0.0, u, low - 1e3 * (high - low + 1.0))
        plot.data = (t, u, np.full(len(t), high), np.full(len(t), low), marks)

    def _limits(self, i: int, c: int, u: Array) -> tuple[float, float]:
        """The bounds of agent i's input c; where they vary, the extremes it took."""
        bounds = self._model.input_bounds[i]
        if bounds is None:
            return float(u.min()), float(u.max())
        return float(bounds[0][c]), float(bounds[1][c])

    def _plot(
        self, title: str, curves: list[str], guides: list[str] | None = None,
        marks: list[str] | None = None,
    ) -> viser.GuiUplotHandle:  # fmt: skip
        """A plot of curves, then dashed guides, then points alone; each a series by its name."""
        styles = [
            *((name, _curve(k)) for k, name in enumerate(curves)),
            *((name, _GUIDE) for name in guides or ()),
            *((name, _BACKUP) for name in marks or ()),
        ]
        series = [{"label": "t [s]"}, *({"label": name, **style} for name, style in styles)]
        return self._gui.add_uplot(
            tuple(np.zeros(1) for _ in series),
            tuple(series),  # type: ignore[arg-type]
            title=title,
            scales=self._scales,
            legend={"show": False},
            padding=(10, 20, 0, 0),
            height=140,
        )


def _curve(k: int) -> Style:
    return {"stroke": _COLOURS[k], "width": 1.5, **_NO_POINTS}
