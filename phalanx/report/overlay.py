"""h_tot of several runs on the same axes, and their differences from the first."""

from collections.abc import Mapping
from itertools import cycle

import numpy as np
from matplotlib.figure import Figure

from phalanx.curves.thinning import Series
from phalanx.report.style import LIMIT, NORMAL, WORST, draw_line, legend, panels


def overlay(h_tot: Mapping[str, Series]) -> Figure:
    """Draw h_tot of runs, by their titles, over one another; below, less that of the first run.

    A difference is taken at the run's own times up to the first run's end, where h_tot of the
    first is interpolated between its states.
    """
    figure, (above, below) = panels(2, 2.6)
    (_, base), *_ = h_tot.items()
    for (title, series), colour in zip(h_tot.items(), cycle((NORMAL, *WORST))):
        label = f"{title}: worst {np.nanmax(series.y):.4g}"
        draw_line(above, series, colour=colour, width=1.2, label=label)
        if series is not base:
            common = Series(*(values[series.t <= base.t[-1]] for values in series))
            apart = Series(common.t, common.y - np.interp(common.t, *base))
            label = f"{title}: at most {np.abs(apart.y).max(initial=0.0):.3g}"
            draw_line(below, apart, colour=colour, width=1.0, label=label)
    for axes, name in ((above, "$h_{tot}$"), (below, "$h_{tot}$, less the first's")):
        axes.axhline(0.0, color=LIMIT, linewidth=1.2)
        axes.set_ylabel(name)
        axes.margins(x=0.01)
        legend(axes)
    below.set_xlabel("t [s]")
    return figure
