"""The report's page: text and tables about one recorded run."""

from collections.abc import Sequence
from html import escape
from itertools import starmap
from pathlib import Path

from phalanx.guarantee.verdict import Outcome, Summary, certified, timing_rows
from phalanx.network.link import DELAY, LOSS
from phalanx.recording.metrics.table import METRIC_HEAD
from phalanx.recording.read import Recording, size_in_words
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
from phalanx.report.links import LinkStatistics
from phalanx.report.safety import worst
from phalanx.theory.rows.origin import (
    EMPTY,
    OF_CONTROLLERS,
    OF_PROOFS,
    origin_label,
    origins_of_normal,
)

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
    summary, peak = recording.summary, worst(recording)
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
            ("Wall time", f"{summary.wall_time:.3f} s"),
            ("Real-time factor", f"{summary.real_time_factor:.2f}"),
            ("Trajectory, SHA-256", summary.trajectory),
        ]
    return [*rows, ("Recording", size_in_words(recording))]


def origins(recording: Recording) -> dict[str, int]:
    """Count recorded steps of normal agents by the origin of their input."""
    named = any(group.controller for group in recording.scenario.agents)
    proofs = recording.scenario.safety.prove
    counts = {str(origin): 0 for origin in origins_of_normal(named, proofs)}
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
        counts, loss = (link.sent, link.decided, link.lost), percent(link.lost, link.decided)
        of_model = link.model.described
        rows.append((link.name, *map(str, counts), loss, of_model(LOSS), *delays, of_model(DELAY)))
    return table(head, rows, len(links))
