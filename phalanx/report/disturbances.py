"""Figure of the disturbances that explain each agent's motion."""

import numpy as np
from matplotlib.figure import Figure

from phalanx.curves.thinning import Series
from phalanx.recording.disturbances import disturbances_of
from phalanx.report import style
from phalanx.report.history import ReportHistory


def disturbances(history: ReportHistory) -> Figure | None:
    """Draw the disturbance that each agent needed, against its declared bound.

    None without an interval to explain.
    """
    names, groups = history.swarm.names, history.swarm.groups
    every = zip(names, disturbances_of(history.recording, history.swarm), strict=True)
    curves = {
        name: Series(found.t, np.where(np.isfinite(found.size), found.size, np.nan))
        for name, found in every
        if len(found.t)
    }
    if not curves:
        return None
    figure, (axes,) = style.panels(1, 3.0)
    if style.summarises(history.scenario):
        worst = sorted(curves, key=lambda name: -float(np.nanmax(curves[name].y)))
        style.draw_many(axes, curves, worst, "agents", "")
    else:
        palette = style.colours(history.scenario)
        for name, curve in curves.items():
            style.draw_line(axes, curve, colour=palette[name], held=True, label=name)
        style.legend(axes)
    for bound in {group.disturbance.bound for group in groups}:
        axes.axhline(bound, color=style.LIMIT, linewidth=1.2)
    axes.set_ylabel("disturbance needed")
    axes.set_xlabel("t [s]")
    axes.margins(x=0.01)
    return figure
