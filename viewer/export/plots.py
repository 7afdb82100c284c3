"""The plots of an exported page, as JSON."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.viewer.feeds.history import certified_horizon, swarm_horizons, thinned
from phalanx.viewer.feeds.replay import Replay

Array = NDArray[np.float64]

_POINTS = 400


def plot_data(replay: Replay) -> dict[str, Any]:
    """Titles, curves and guides, of the swarm and of every agent."""
    model, summary = replay.model, replay.summary
    return {
        "title": f"{model.scenario.name}, seed {model.scenario.seed}",
        "verdict": f"{summary.outcome}: {summary.reason}" if summary else "no verdict",
        "begin": float(replay.times[0]),
        "end": replay.end,
        "swarm": _swarm_plots(replay),
        "agents": [
            {"name": name, "plots": _agent_plots(replay, i)} for i, name in enumerate(model.names)
        ],
    }


def _swarm_plots(replay: Replay) -> list[dict[str, Any]]:
    rows, model = thinned(replay.history.swarm.rows, _POINTS), replay.model
    t, shown = rows[:, 0], swarm_horizons(replay.history.swarm.rows, _POINTS)
    return [
        _plot("h_tot (safe: at most 0)", t, rows[:, 1], [0.0]),
        _plot("Smallest distance [m]", t, rows[:, 2], [2.0 * model.radius]),
        *(
            [_plot("Certified at least for [τ]", shown[:, 0], shown[:, 1], [1.0])]
            if len(shown)
            else []
        ),
        *(_plot(f"ψ_{k}", t, rows[:, 4 + k], [0.0]) for k in model.psi_levels),
    ]


def _agent_plots(replay: Replay, i: int) -> list[dict[str, Any]]:
    steps, tau = replay.history.agent(i), replay.model.swarm.horizon(i)
    rows = thinned(steps, _POINTS)
    t, backups = rows[:, 0], np.flatnonzero(rows[:, 1])
    bounds = replay.model.input_bounds[i]
    certified = certified_horizon(steps, tau, _POINTS)
    plots = [_plot("Certified for [τ]", *certified, [1.0])] if len(certified[0]) else []
    for c, name in enumerate(replay.model.input_names(i)):
        guides = [] if bounds is None else [float(bounds[0][c]), float(bounds[1][c])]
        plots.append(_plot(f"{name}, backups marked", t, rows[:, 5 + c], guides, backups.tolist()))
    plots.append(_plot("Age of the oldest û [ms]", t, 1e3 * rows[:, 2], []))
    return [*plots, _plot("Control step [ms]", t, 1e3 * rows[:, 3], [])]


def _plot(
    title: str, t: Array, y: Array, guides: list[float], marks: list[int] | None = None
) -> dict[str, Any]:
    known = np.isfinite(y)
    return {
        "title": title,
        "t": np.round(t[known], 4).tolist(),
        "y": [float(f"{value:.5g}") for value in y[known]],
        "guides": guides,
        "marks": marks or [],
    }
