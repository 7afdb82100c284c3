"""The plots beside the scene: uPlot, redrawn a few times a second."""

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from phalanx.viewer.feeds.history import History, thinned, until
from phalanx.viewer.scene.model import SceneModel

Array = NDArray[np.float64]

_POINTS = 500
_COLOURS = ("#2563eb", "#d97706", "#16a34a", "#9333ea")
_BACKUP = "#dc2626"
_GUIDE = {"stroke": "#94a3b8", "width": 1.0, "dash": (4, 4)}


class Plots:
    """h_tot, distance, ψ, and the chosen agent's inputs, ages and solve times."""

    def __init__(self, server: viser.ViserServer, cast: SceneModel) -> None:
        self._gui, self._cast = server.gui, cast
        self._scales: dict[str, uplot.Scale] = {
            "x": {"time": False, "range": (0.0, cast.scenario.duration)}
        }
        levels = [f"ψ_{k}" for k in range(1, len(cast.swarm.chain.psi))]
        self._h_tot = self._plot("h_tot (safe: at most 0)", ["h_tot", "0"], guides=1)
        self._distance = self._plot("Smallest distance [m]", ["distance", "required"], guides=1)
        self._psi = self._plot("ψ_k of the swarm", [*levels, "0"], guides=1) if levels else None
        most = max(len(m.dynamics.inputs) for m in cast.swarm.members)
        self._inputs = [
            self._plot(f"u_{c + 1}", ["u", "at most", "at least", "backup"], guides=2)
            for c in range(most)
        ]
        self._ages = self._plot("Age of the oldest û [ms]", ["age"])
        self._solve = self._plot("Control step [ms]", ["wall time"])

    def show(self, history: History, t: float, selected: int) -> None:
        """Redraw everything up to t [s]."""
        self._show_swarm(thinned(until(history.swarm.rows, t), _POINTS))
        self._show_agent(thinned(until(history.agent(selected), t), _POINTS), selected)

    def _show_swarm(self, rows: Array) -> None:
        if not len(rows):
            return
        t, zero = rows[:, 0], np.zeros(len(rows))
        self._h_tot.data = (t, rows[:, 1], zero)
        self._distance.data = (t, rows[:, 2], zero + 2.0 * self._cast.radius)
        if self._psi:
            self._psi.data = (t, *rows[:, 3:].T, zero)

    def _show_agent(self, rows: Array, i: int) -> None:
        if not len(rows):
            return
        t, backup = rows[:, 0], rows[:, 1] > 0.0
        dynamics = self._cast.swarm.members[i].dynamics
        for c, plot in enumerate(self._inputs):
            plot.visible = c < len(dynamics.inputs)
            if plot.visible:
                u = rows[:, 4 + c]
                low, high = self._limits(i, c, u)
                marks = np.where(backup, u, low - 1e3 * (high - low + 1.0))
                plot.data = (t, u, np.full(len(t), high), np.full(len(t), low), marks)
                self._frame(plot, f"Agent {self._cast.names[i]}: {dynamics.inputs[c]}", low, high)
        heard = np.isfinite(rows[:, 2])
        self._ages.data = (t[heard], 1e3 * rows[heard, 2])
        self._solve.data = (t, 1e3 * rows[:, 3])

    def _limits(self, i: int, c: int, u: Array) -> tuple[float, float]:
        """The bounds of agent i's input c; where they vary, the extremes it took."""
        bounds = self._cast.bounds[i]
        if bounds is None:
            return float(u.min()), float(u.max())
        return float(bounds[0][c]), float(bounds[1][c])

    def _frame(self, plot: viser.GuiUplotHandle, title: str, low: float, high: float) -> None:
        """Backups are marked by points, and a step without one has its point out of sight."""
        plot.title = title
        margin = 0.1 * (high - low) + 1e-3
        plot.scales = {**self._scales, "y": {"range": (low - margin, high + margin)}}

    def _plot(self, title: str, names: list[str], guides: int = 0) -> viser.GuiUplotHandle:
        """A plot; its last series are `guides` dashed lines, and then marks if named backup."""
        series: list[dict[str, object]] = [{"label": "t [s]"}]
        marks = names[-1] == "backup"
        lines = len(names) - guides - marks
        for k, name in enumerate(names):
            if marks and k == len(names) - 1:
                style: dict[str, object] = {
                    "stroke": _BACKUP,
                    "width": 0.0,
                    "points": {"show": True, "size": 6, "fill": _BACKUP},
                }
            elif k >= lines:
                style = {**_GUIDE, "points": {"show": False}}
            else:
                style = {"stroke": _COLOURS[k], "width": 1.5, "points": {"show": False}}
            series.append({"label": name, **style})
        empty = tuple(np.zeros(1) for _ in series)
        return self._gui.add_uplot(
            empty,
            tuple(series),  # type: ignore[arg-type]
            title=title,
            scales=self._scales,
            legend={"show": False},
            padding=(10, 20, 0, 0),
            height=140,
        )
