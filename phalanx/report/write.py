"""Write the report of a run: its figures as PNG, and one HTML file."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from phalanx.files import real_folder, whole_file
from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.metrics.table import metric_rows, metrics_of
from phalanx.recording.read import Recording, read
from phalanx.report import safety, steps
from phalanx.report.links import LinkStatistics, link_statistics, losses, space_time
from phalanx.report.page import write_page
from phalanx.report.paths import paths
from phalanx.report.style import FEW, MOST_NAMED, SCREEN, drawn_for, image_of, summarises

REPORT = "report.html"
_DATELESS = {"CreationDate": None}
"""Metadata of PDF: the same run gives the same file."""


class ReportFigure(NamedTuple):
    """One figure of the report."""

    name: str
    """Its file's name, without the ending."""
    caption: str
    figure: Figure


def write_report(
    run: Path, progress: Callable[[str], None] | None = None, style: str = SCREEN
) -> Path:
    """Write report.html and figures/* next to a recording, whole or cut short, as Run.report says.

    run: its folder, or its recording. Raises UnreadableRecordingError, OSError, ValueError.
    """
    images: list[tuple[str, bytes]] = []
    with drawn_for(style):
        recording = read(run)
        figures = real_folder(recording.path.parent / "figures")
        history, links = ReportHistory(recording), link_statistics(recording)
        for figure in draw_figures(history, links):
            if progress:
                progress(figure.name)
            if style == "paper":
                with whole_file(figures / f"{figure.name}.pdf") as part:
                    figure.figure.savefig(part, metadata=_DATELESS)
            image = image_of(figure.figure)
            with whole_file(figures / f"{figure.name}.png") as part:
                part.write_bytes(image)
            images.append((figure.caption, image))
    metrics = metric_rows(metrics_of(recording, history.swarm))
    report = recording.path.parent / REPORT
    return write_page(report, recording, metrics, links, images, notes(history))


def draw_figures(history: ReportHistory, links: list[LinkStatistics]) -> Iterator[ReportFigure]:
    """Draw the figures that the recording has data for, in the report's order."""
    recording, many = history.recording, summarises(history.scenario)
    if recording.states:
        yield ReportFigure("h_tot", _SAFETY, safety.safety(history))
        if higher := safety.psi(history):
            yield ReportFigure("psi", _PSI, higher)
        yield ReportFigure("paths", _paths_caption(recording), paths(history))
        if figure := safety.distances(history):
            yield ReportFigure("distances", _NEAREST if many else _DISTANCES, figure)
    if recording.states and recording.steps:
        yield from _step_figures(history)
        if needed := steps.disturbances(history):
            yield ReportFigure("disturbances", _DISTURBANCES, needed)
        if lanes := space_time(history):
            yield ReportFigure("space-time", _SPACE_TIME, lanes)
    if any(link.lost or link.model.loss for link in links):
        yield ReportFigure("losses", _LOSSES, losses(recording, links))


def notes(history: ReportHistory) -> list[str]:
    """Notes about figures that are not drawn, and why."""
    if not history.recording.states:
        return ["The recording holds no state: there is nothing to draw."]
    if not summarises(history.scenario):
        return []
    return [
        f"More than {MOST_NAMED} agents: figures show the least, median, largest and the band "
        "of 10 to 90 % of all agents, and the worst few of them by name."
    ]


def _step_figures(history: ReportHistory) -> Iterator[ReportFigure]:
    normal = {i: history.agent(i) for i in history.swarm.normal if history.steps[i]}
    if summarises(history.scenario):
        yield ReportFigure("inputs", _ALL_INPUTS, steps.inputs_of_all(history))
        empty = {i: int(np.count_nonzero(made.empty)) for i, made in normal.items()}
        agents = sorted((i for i in empty if empty[i]), key=lambda i: -empty[i])[:FEW]
    else:
        agents = list(normal)
    for i in agents:
        name = history.swarm.names[i]
        caption = (
            f"Inputs of agent {name}; nominal input in grey, bounds dotted. A cross marks a step "
            "whose K_i was empty: dark if the backup was applied, light if it had no authority."
        )
        yield ReportFigure(f"inputs-{name}", caption, steps.inputs(history, i))
    if horizons := steps.certified(history):
        yield ReportFigure("certified", _CERTIFIED, horizons)
    if ages := steps.ages(history):
        yield ReportFigure("ages", _ages_caption(history.recording), ages)
    yield ReportFigure("solve-times", _SOLVE_TIMES, steps.solve_times(history))


_SAFETY = (
    "The largest h of a pair with a normal agent, and h_tot, over time, each value the largest "
    "since the event before. A pair is safe at or below zero. h_tot lies above the largest h."
)
_PSI = (
    "The largest ψ_k of all pairs, each alone or composed; the table says under stayed in S_I how "
    "large it was at any integration step. "
    "The theorem assumes a start in S_I, where every ψ_k is at or below zero, and proves that the "
    "run stays there."
)
_DISTANCES = (
    "Distances between the output points of all pairs, and to obstacles' centres; dotted: the "
    "distance required. The closest pairs come first."
)
_NEAREST = (
    "Distance of each normal agent from the nearest other agent, adversary and obstacle's centre; "
    "dotted: the distance required. The closest pairs are drawn by name."
)
_ALL_INPUTS = (
    "Share of their bounds that the inputs of normal agents use, of the component that uses most; "
    "and the share of steps whose K_i was empty. The agents with most of those follow one by one."
)
_CERTIFIED = (
    "Time for which each normal agent's input is proven to keep all its pairs safe, whatever the "
    "others do, in multiples of τ, the longest time until its next sample: at or above the line at "
    "1 the proof lasts until then. A cross marks every input below it. The scale is logarithmic; "
    "an input that is proven for no time at all is drawn at the bottom."
)
_DISTURBANCES = (
    "Disturbance that explains each agent's motion under the declared dynamics: the norm of the "
    "constant φ between two of its inputs, with the declared bounds as lines. What is above its "
    "line contradicts the scenario's disturbance.bound."
)
_SOLVE_TIMES = (
    "Wall time of control steps, from sample to input: the share of steps that took as long or "
    "longer. It does not affect the trajectory."
)
_SPACE_TIME = (
    "Space-time diagram. Above, the whole run: in each agent's lane the share of broadcasts to it "
    "that came too late for its next step (first row) or were lost (second row), and when it was "
    "on its backup, without authority, or silent for longer than its τ (third row); of more "
    "than 24 agents the gravest of these in one row each. Below, around the worst moment (shaded "
    "above): a dot is a control step, a square one whose K_i was empty; a line is a broadcast from "
    "its sender to its receiver, a cross one that was lost."
)
_LOSSES = "Share of broadcasts lost on each link, with the loss that the scenario sets."


def _paths_caption(recording: Recording) -> str:
    circles = (
        " Circles have half the required distance as radius, so two that overlap are too close: "
        "solid at the end, dashed at the worst h."
        if safety.required_distance(recording.scenario)
        else ""
    )
    return "Paths of the output points: hollow mark at the start, filled mark at the end." + circles


def _ages_caption(recording: Recording) -> str:
    model = recording.scenario.safety.information_model
    unused = f"received (no row uses them: {model.label})"
    role = "that rows may use" if model.counts_on_received else unused
    return f"Age of the inputs û {role}, at each receiver's steps."
