"""The picture of docs/network-faults.md: what each fault does to what one agent knows of another.

python bench/network/faults_picture.py
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import phalanx
from phalanx.report.style import LIMIT, MUTED, PEAK, style_axes

PICTURE = Path("docs/images/network-faults.png")
DURATION = 1.5
SENDER, RECEIVER = "2", "1"
BEGIN, SPAN = 0.5, 0.4
"""Of faults of a time [s]."""


def timed(kind: str, **fields: Any) -> dict[str, Any]:
    """A fault of a time."""
    return {"faults": [{"kind": kind, "at": BEGIN, "for": SPAN, **fields}]}


JITTER = {"time": 0.03, "jitter": 0.02, "distribution": "pareto"}
FAULTS: Mapping[str, dict[str, Any]] = {
    "no fault": {},
    "loss = 0.3": {"network.loss": 0.3},
    "loss = { mean = 0.3, burst = 8 }": {"network.loss": {"mean": 0.3, "burst": 8.0}},
    "loss_by_distance": {"network.loss_by_distance": {"none_within": 2.0, "all_beyond": 6.0}},
    "delay = 0.03": {"network.delay": 0.03},
    "delay, pareto": {"network.delay": JITTER},
    "delay, correlation = 0.9": {"network.delay": {**JITTER, "correlation": 0.9}},
    "reorder": {"network.delay": 0.03, "network.reorder": {"probability": 0.2}},
    "duplicate, delay": {"network.delay": JITTER, "network.duplicate": 0.5},
    "corrupt = 0.3": {"network.corrupt": 0.3},
    "rate": {"network.rate": {"bits_per_second": 8.5e4, "limit": 8}},
    "slot = 0.1": {"network.slot": 0.1},
    "partition": timed("partition", groups=[[SENDER]]),
    "hold": timed("hold"),
    "link, delay = 0.1": timed("link", delay=0.1),
    "sample.loss = 0.3": {"network.sample.loss": 0.3},
    'preset = "lossy-wifi"': {"network.preset": "lossy-wifi"},
    'preset = "satellite"': {"network.preset": "satellite"},
}


def main() -> None:
    """Run each fault for a second and a half, and draw all of them on one page."""
    figure = Figure(figsize=(10.0, 12.0), layout="constrained", facecolor="white")
    panels = figure.subplots(len(FAULTS) // 2, 2, sharex=True, sharey=True).ravel()
    for (name, overrides), axes in zip(FAULTS.items(), panels, strict=True):
        scenario = phalanx.load("unicycles", {"duration": DURATION, **overrides})
        draw(axes, name, phalanx.run(scenario, engine="in-process"))
    for axes in panels[-2:]:
        axes.set_xlabel("t [s]")
    figure.supylabel(f"age of what agent {RECEIVER} knows of agent {SENDER}'s input [ms]")
    figure.savefig(PICTURE, dpi=80)


def draw(axes: Axes, name: str, run: phalanx.Run) -> None:
    """The age at each sample of the receiver; above, the broadcasts that were lost."""
    style_axes(axes)
    axes.set_title(name, loc="left", fontsize=9)
    axes.set_ylim(0.0, 450.0)
    if "faults" in FAULTS[name]:
        axes.axvspan(BEGIN, BEGIN + SPAN, color=MUTED, alpha=0.2, linewidth=0)
    t, age = ages(run)
    axes.plot(t, 1e3 * age, color=LIMIT, linewidth=0.8, marker=".", markersize=2.0)
    links = run.links
    between = (links["sender"] == SENDER) & (links["receiver"] == RECEIVER)
    lost = links.filter(between & links["lost"])
    axes.plot(lost["t"], [430.0] * len(lost), "|", color=PEAK, markersize=5.0)


def ages(run: phalanx.Run) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """When the receiver sampled [s], and how old what it knew was by then [s]."""
    steps = [step for step in run.recording.steps if step.agent == RECEIVER]
    known = [dict(step.ages).get(SENDER, np.nan) for step in steps]
    return np.array([step.t for step in steps]), np.array(known)


if __name__ == "__main__":
    main()
