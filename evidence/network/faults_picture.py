"""The pictures of docs/network-faults.md: what each fault does to one agent, and to the swarm.

python evidence/network/faults_picture.py [links robot presets times lies agents]
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import phalanx
from phalanx.report.style import LIMIT, MUTED, PEAK, style_axes
from phalanx.theory.arrays import Array
from tests.network.pictured_faults import (
    AGENT,
    DURATION,
    GALLERIES,
    PEER,
    SWARM,
    Gallery,
    Overrides,
)

FOLDER = Path("docs/images")
ACROSS = 2
"""Faults in a row; each has two panels."""
SAFE = 1.0
"""Of the pair that is closest [m]."""
ZOOM = (0.3, 0.5)
"""Of what is told [s]."""


def main() -> None:
    """Run every fault, and draw one picture for each of its kinds."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("names", nargs="*", default=list(GALLERIES), metavar="PICTURE")
    for name in arguments.parse_args().names:
        figure = picture(GALLERIES[name], LEFT[name])
        figure.savefig(FOLDER / f"faults-{name}.png", dpi=80)


def picture(gallery: Gallery, panel: "Panel") -> Figure:
    """Draw each fault's effect on one agent, and next to it the effect on the swarm."""
    rows = -(-len(gallery.faults) // ACROSS)
    size = (12.0, 1.25 * rows + 0.5)
    figure = Figure(figsize=size, layout="constrained", facecolor="white")
    panels = figure.subplots(rows, 2 * ACROSS, sharex="col", squeeze=False).reshape(-1, 2)
    calm: dict[str, phalanx.Run] = {}
    for (name, fault), pair in zip(gallery.faults.items(), panels, strict=False):
        beside = gallery.calm(name)
        without = calm.setdefault(repr(beside), run(gallery, beside))
        faulty = run(gallery, fault)
        for axes, draw in zip(pair, (panel, draw_closest), strict=True):
            style_axes(axes)
            axes.tick_params(labelsize=8)
            shade(axes, fault, gallery.without)
            draw(axes, faulty, without)
        pair[0].set_title(name, loc="left", fontsize=9)
    shown_panels = panels[: len(gallery.faults)]
    for axes in panels[len(gallery.faults) :].ravel():
        axes.set_visible(False)
    for axes in shown_panels[-ACROSS:].ravel():
        axes.set_xlabel("t [s]", fontsize=8)
        axes.tick_params(labelbottom=True)
    align(shown_panels[:, 1])
    for axes in shown_panels[:, 1]:
        axes.axhspan(axes.get_ylim()[0], SAFE, color=PEAK, alpha=0.12, linewidth=0)
    if panel is draw_path:
        align(shown_panels[:, 0])
    return figure


def align(panels: Array) -> None:
    """Give them one scale."""
    limits = np.array([axes.get_ylim() for axes in panels])
    for axes in panels:
        axes.set_ylim(limits[:, 0].min(), limits[:, 1].max())


def shade(axes: Axes, overrides: Overrides, without: Overrides) -> None:
    """The times of those faults that are not there without."""
    for fault in overrides.get("faults", []):
        if "at" in fault and fault not in without.get("faults", []):
            end = fault["at"] + fault.get("for", DURATION)
            axes.axvspan(fault["at"], min(end, DURATION), color=MUTED, alpha=0.2, linewidth=0)


def run(gallery: Gallery, overrides: Overrides) -> phalanx.Run:
    """The swarm with these overrides."""
    base = {"faults": [], "duration": DURATION, "agents.0.start": gallery.start}
    return phalanx.run(phalanx.load(SWARM, {**base, **overrides}), engine="in-process")


Panel = Callable[[Axes, phalanx.Run, phalanx.Run], None]
"""Draws a run with a fault, and the same run without it behind."""


def draw_closest(axes: Axes, faulty: phalanx.Run, without: phalanx.Run) -> None:
    """Draw the distance of the two closest agents [m]."""
    for run, colour in ((without, MUTED), (faulty, LIMIT)):
        distances = np.sqrt(
            SAFE**2 - run.h.drop("run", "scenario", "seed", "t").to_numpy().max(axis=1)
        )
        axes.plot(run.h["t"], distances, color=colour, linewidth=1.2)
    axes.set_ylim(bottom=min(0.7, 0.95 * distances.min()))
    axes.set_ylabel("closest [m]", fontsize=8)


def draw_delays(axes: Axes, faulty: phalanx.Run, without: phalanx.Run) -> None:
    """Draw the delay of each broadcast to the peer [ms]; red, above: lost ones."""
    for run, colour in ((without, MUTED), (faulty, LIMIT)):
        links = heard(run)
        came = links.filter(~links["lost"])
        axes.plot(came["t"], 1e3 * came["delay"], ".", color=colour, markersize=2.5)
    top = max(25.0, axes.get_ylim()[1])
    axes.set_ylim(-0.08 * top, 1.25 * top)
    draw_lost(axes, faulty)
    axes.set_ylabel("delay [ms]", fontsize=8)


def draw_lost(axes: Axes, faulty: phalanx.Run) -> None:
    """The broadcasts to the peer that were lost, at the upper edge."""
    links = heard(faulty)
    lost = links.filter(links["lost"])["t"]
    edge = axes.get_xaxis_transform()
    axes.plot(lost, [0.94] * len(lost), "|", color=PEAK, markersize=5.0, transform=edge)


def heard(run: phalanx.Run) -> pl.DataFrame:
    """The agent's broadcasts to its peer, as received."""
    return run.links.filter(sender=AGENT, receiver=PEER)


def draw_path(axes: Axes, faulty: phalanx.Run, without: phalanx.Run) -> None:
    """The agent's second coordinate [m]; a dot at each of its samples."""
    for run, colour in ((without, MUTED), (faulty, LIMIT)):
        t, y = position(run)
        axes.plot(t, y, color=colour, linewidth=0.9)
        samples = run.inputs.filter(agent=AGENT)["t"].to_numpy()
        axes.plot(samples, np.interp(samples, t, y), ".", color=colour, markersize=3.0)
    axes.set_ylabel("way [m]", fontsize=8)


def position(run: phalanx.Run) -> tuple[Array, Array]:
    """Times of the recorded states [s], and the agent's second coordinate [m]."""
    states = run.recording.states
    place = 2 * [name for name, _, _ in run.scenario.roster()].index(AGENT) + 1
    return np.array([state.t for state in states]), np.array([state.x[place] for state in states])


def draw_told(axes: Axes, faulty: phalanx.Run, _: phalanx.Run) -> None:
    """Draw the inputs that the agent applies [m/s]; red: those that it broadcasts instead."""
    steps = [step for step in faulty.recording.steps if step.agent == AGENT]
    applied = [step.t_apply for step in steps], [step.u[1] for step in steps]
    axes.step(*applied, where="post", color=LIMIT, linewidth=0.7)
    axes.plot(*applied, ".", color=LIMIT, markersize=3.0)
    of_peer = [step for step in faulty.recording.steps if step.agent == PEER]
    false_inputs = [(t, u[1]) for step in of_peer for name, _, t, u in step.false if name == AGENT]
    axes.plot(*np.array(false_inputs).reshape(-1, 2).T, "x", color=PEAK, markersize=3.5)
    draw_lost(axes, faulty)
    axes.set_xlim(*ZOOM)
    axes.set_ylim(-2.5, 3.2)
    axes.set_ylabel("input [m/s]", fontsize=8)


LEFT: dict[str, Panel] = {
    "links": draw_delays,
    "robot": draw_path,
    "presets": draw_delays,
    "times": draw_delays,
    "lies": draw_told,
    "agents": draw_path,
}


if __name__ == "__main__":
    main()
