"""Draw which share of the branches violates, over the time at which they left the run."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from phalanx.branches.inevitable import BranchesAt, from_when, landmarks
from phalanx.guarantee.verdict import Summary
from phalanx.report.style import NORMAL, PEAK, current, legend, panels

_HEIGHT = 3.0
"""[inch]"""


def draw_branches(curve: Sequence[BranchesAt], summary: Summary | None) -> Figure:
    """Draw shares with their intervals; with the run's loss of a certificate and violation."""
    figure, (axes,) = panels(1, _HEIGHT)
    t = [each.t for each in curve]
    low, high = zip(*(each.interval for each in curve), strict=True)
    axes.fill_between(t, low, high, color=NORMAL, alpha=0.2, linewidth=0, label="95 % interval")
    shares = [each.share for each in curve]
    axes.plot(t, shares, "o-", color=NORMAL, markersize=4, label="branches that violate")
    for landmark, dashes in zip(landmarks(summary), ("-", "--"), strict=False):
        axes.axvline(
            landmark.t, color=PEAK, linestyle=dashes, linewidth=1.2, label=landmark.happens
        )
    axes.set_ylim(-0.03, 1.03)
    axes.set_ylabel("share of branches")
    axes.set_xlabel("time at which they leave the run [s]")
    title = f"{len(curve[0].summaries)} branches at each time{_point_of_no_return(curve, summary)}"
    axes.set_title(title, loc="right", fontsize=current().title)
    legend(axes)
    return figure


def _point_of_no_return(curve: Sequence[BranchesAt], summary: Summary | None) -> str:
    """Say from when on half of the branches violate, compared with the certificate's loss."""
    half, known = from_when(curve, 0.5), landmarks(summary)
    if half is None:
        return ""
    words = f"; half violate from {half:.3f} s on"
    if len(known) < 2:
        return words
    ahead = known[1].t - half
    return (
        f"{words}, {abs(ahead):.3f} s {'before' if ahead >= 0 else 'after'} the certificate's loss"
    )


def save_picture(curve: Sequence[BranchesAt], summary: Summary | None, file: Path) -> None:
    """Write the figure as PNG. Raises OSError."""
    draw_branches(curve, summary).savefig(file, dpi=110)
