"""Write the report of a run: its figures as PNG, and one HTML file with text and tables."""

from collections.abc import Callable, Iterator, Sequence
from html import escape
from itertools import starmap
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from phalanx.guarantee.verdict import Outcome, Summary, certified, timing_rows
from phalanx.messages.traffic import traffic_in_words
from phalanx.native.files import real_folder, whole_file
from phalanx.network.link import DELAY, LOSS
from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.metrics.table import METRIC_HEAD, metric_rows, metrics_of
from phalanx.recording.read import Recording, read, size_in_words, swarm_of
from phalanx.report import safety, steps
from phalanx.report.html import (
    MOST_ROWS,
    figure,
    note,
    percent,
    quiet,
    save_page,
    seconds,
    section,
    table,
)
from phalanx.report.links import LinkStatistics, link_statistics, losses, space_time
from phalanx.report.paths import paths
from phalanx.report.style import FEW, MOST_NAMED, image_of, summarises
from phalanx.theory.rows.origin import (
    EMPTY,
    OF_CONTROLLERS,
    OF_PROOFS,
    Origin,
    origin_label,
)

REPORT = "report.html"
_NO_VERSION = ("run", "seed", "scenario_digest")
"""Entries of a recording's metadata that are no library's version."""
_VIOLATIONS = ("pair", "excursions", "first from", "last until", "worst h", "worst at",
               "time with h > 0")  # fmt: skip
_PUNCTUALITY = ("quantity", "of this run")
_ASSUMPTIONS = ("assumption", "meaning", "failed", "first failure")

_MEANING = {
    Outcome.GUARANTEED: "Safe, and proven so at every instant for all inputs of the other agents.",
    Outcome.SAFE: "No violation was seen at any integration step, but safety is not proven.",
    Outcome.VIOLATED: "Some pair left the safe set.",
    Outcome.BROKEN: "The run did not reach its end.",
    Outcome.STOPPED: "The run was stopped by its user.",
}


class ReportFigure(NamedTuple):
    """One figure of the report."""

    name: str
    """Its file's name, without the ending."""
    caption: str
    figure: Figure


def write_report(run: Path, progress: Callable[[str], None] | None = None) -> Path:
    """Write report.html and figures/* next to a recording, whole or cut short, as Run.report says.

    run: its folder, or its recording. Raises UnreadableRecordingError, OSError.
    """
    images: list[tuple[str, bytes]] = []
    recording = read(run)
    figures = real_folder(recording.path.parent / "figures")
    history, links = ReportHistory(recording), link_statistics(recording)
    for drawing in draw_figures(history, links):
        if progress:
            progress(drawing.name)
        image = image_of(drawing.figure)
        with whole_file(figures / f"{drawing.name}.png") as part:
            part.write_bytes(image)
        images.append((drawing.caption, image))
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
        if between := safety.distances(history):
            yield ReportFigure("distances", _NEAREST if many else _DISTANCES, between)
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
        empty = {i: int(np.count_nonzero(series.empty)) for i, series in normal.items()}
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


def write_page(
    path: Path,
    recording: Recording,
    metrics: Sequence[Sequence[str]],
    links: Sequence[LinkStatistics],
    figures: Sequence[tuple[str, bytes]],
    notes: Sequence[str],
) -> Path:
    """Write the whole report, and return its path. Raises OSError.

    Metrics are rows of METRIC_HEAD, figures are (caption, PNG), notes say what is not drawn.
    """
    scenario = recording.scenario
    title = f"{scenario.name}, seed {scenario.seed}"
    parts = [
        _verdict(recording),
        *starmap(figure, figures[:1]),
        *_origin(recording),
        section("Key figures", table((), key_figures(recording))),
        section("Metrics of the task", table(METRIC_HEAD, metrics)),
        *_judgement(recording.summary),
        section("Links", _links(links)),
        section("Figures", "\n".join([*starmap(figure, figures[1:]), *map(note, notes)])),
        section("Events", table(("t", "event"), [(seconds(e.t), e.text) for e in recording.log])),
        "<details><summary>The scenario, with every default</summary>"
        f"<pre>{escape(scenario.model_dump_json(by_alias=True, indent=2))}</pre></details>",
    ]
    return save_page(path, title, parts, about=scenario.description, width="64rem")


def _origin(recording: Recording) -> list[str]:
    """The command that repeats this run, its date, and the versions of the libraries."""
    scenario, metadata = recording.scenario, dict(recording.metadata)
    command = scenario.reading.command(scenario.seed) if scenario.reading else None
    parts = [metadata.pop("date", ""), f"phalanx {metadata.pop('phalanx', 'of unknown version')}"]
    of_others = [f"{name} {metadata[name]}" for name in metadata if name not in _NO_VERSION]
    versions = ", ".join(filter(None, [*parts, *of_others]))
    repeat = [f"<pre>{escape(command)}</pre>"] if command else []
    return [*repeat, quiet(versions)]


def _verdict(recording: Recording) -> str:
    summary = recording.summary
    if summary is None:
        kind, meaning = "unfinished", "No verdict: the recording ends before the run did."
        reason = recording.unfinished
    else:
        kind, meaning = summary.outcome, _MEANING[summary.outcome]
        reason = f"{summary.reason}. {summary.on_theorem}"
    return (
        f'<div class="verdict {kind}"><strong>{kind}</strong>{escape(meaning)}'
        f"<p>{escape(reason)}</p></div>"
    )


def key_figures(recording: Recording) -> list[tuple[str, str]]:
    """Key figures of a run, each with its name."""
    summary, peak = recording.summary, safety.worst(recording)
    counts = origins(recording)
    steps, by_controllers = len(recording.steps), sum(counts.get(o, 0) for o in OF_CONTROLLERS)
    normal = sum(counts.values()) - by_controllers
    empty = sum(counts[o] for o in EMPTY)
    share = f"{empty} of {normal} normal steps ({percent(empty, normal)}): " if normal else ""
    kinds = ", ".join(f"{counts[o]} {origin_label(o)}" for o in EMPTY)
    if by_controllers:
        kinds += f"; {by_controllers} steps by another controller, which has no K_i"
    if recording.scenario.safety.prove:
        proofs = ", ".join(f"{counts[o]} {origin_label(o)}" for o in OF_PROOFS)
        kinds += f"; certified for too short at first: {proofs}"
    if Origin.BRAKE in counts:
        kinds += f"; {counts[Origin.BRAKE]} steps braked for what was not known"
    if Origin.FALLBACK in counts:
        kinds += f"; {counts[Origin.FALLBACK]} steps by a fallback, to keep a promise"
    reached = recording.states[-1].t if recording.states else 0.0
    rows = [
        ("Run", recording.metadata.get("run", "unknown")),
        ("Seed", str(recording.scenario.seed)),
        ("Virtual time", f"{reached:.3f} s of {recording.scenario.duration:g} s"),
        ("Worst h", f"{peak.h:.6g} at t = {peak.t:.3f} s" if peak else "no state"),
        ("Steps", f"{steps} recorded"),
        ("Empty K_i", share + kinds),
    ]
    if summary:
        rows += [
            ("Worst pair", summary.worst_pair),
            ("Largest h_tot", f"{summary.largest_h_tot:.6g} at {summary.largest_h_tot_at:.3f} s"),
            ("Certified", certified(summary)),
            *([("Promise", str(summary.promise))] if summary.promise else []),
            ("Wall time", f"{summary.wall_time:.3f} s"),
            ("Real-time factor", f"{summary.real_time_factor:.2f}"),
            ("Trajectory, SHA-256", summary.trajectory),
        ]
    traffic = traffic_in_words(swarm_of(recording))
    return [*rows, ("Broadcasts", traffic or "none"), ("Recording", size_in_words(recording))]


def origins(recording: Recording) -> dict[str, int]:
    """Count recorded steps of normal agents by the origin of their input."""
    counts = {str(origin): 0 for origin in swarm_of(recording).origins}
    for step in recording.steps:
        if step.origin in counts:
            counts[step.origin] += 1
    return counts


def _judgement(summary: Summary | None) -> list[str]:
    """Assumptions, violations and rejected payloads, as far as there is a verdict."""
    if summary is None:
        return []
    guarantee, theorem = (
        [(a.name, a.note, f"{a.failed} of {a.checked}", seconds(a.first)) for a in assumptions]
        for assumptions in (summary.assumptions, summary.theorem)
    )
    violations, excluded = (
        [
            (
                v.pair, str(v.count), seconds(v.first), seconds(v.end), f"{v.worst:.6g}",
                seconds(v.worst_at), seconds(v.duration),
            )
            for v in sorted(excursions, key=lambda v: -v.worst)
        ]
        for excursions in (summary.violations, summary.excluded)
    )  # fmt: skip
    punctuality, trust = summary.punctuality, summary.trust
    rejected = [(reason, str(count)) for reason, count in summary.rejected.items()]
    faults = [(f.name, str(f.count) if f.count else "never had an effect") for f in summary.faults]
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[str]] | None]] = {
        "Assumptions of the guarantee": (_ASSUMPTIONS, guarantee),
        "Assumptions of the paper's theorem": (_ASSUMPTIONS, theorem),
        "Violations": (_VIOLATIONS, violations),
        "Not counted: of agents that had turned adversary": (_VIOLATIONS, excluded or None),
        "Real time": (_PUNCTUALITY, timing_rows(punctuality) if punctuality else None),
        "Trust": (("count", "found"), trust.rows if trust else None),
        "Declared faults": (("fault", "times it had an effect"), faults),
        "Rejected payloads": (("receiver or reason", "payloads"), rejected),
    }
    return [section(t, table(head, rows)) for t, (head, rows) in tables.items() if rows is not None]


def _links(links: Sequence[LinkStatistics]) -> str:
    worst = sorted(links, key=lambda link: -link.excess) if len(links) > MOST_ROWS else links
    head = ("link", "sent", "decided", "lost", "loss", "scenario's loss",
            "mean delay", "least", "most", "scenario's delay")  # fmt: skip
    rows = []
    for link in worst[:MOST_ROWS]:
        d = link.delays
        times = (sum(d) / len(d), min(d), max(d)) if d else ()
        delays = [f"{1e3 * t:.4g} ms" for t in times] or ["none arrived"] * 3
        counts, loss = (link.broadcasts, link.decided, link.lost), percent(link.lost, link.decided)
        of_model = link.model.described
        rows.append((link.name, *map(str, counts), loss, of_model(LOSS), *delays, of_model(DELAY)))
    return table(head, rows, len(links))
