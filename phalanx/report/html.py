"""The report's HTML: one page that fetches nothing. Every text of a table is escaped here."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from string import Template

from phalanx.guarantee.punctuality import Punctuality, in_words
from phalanx.guarantee.verdict import Outcome, Summary, certified
from phalanx.network.link import DELAY, LOSS
from phalanx.recording.read import Recording
from phalanx.recording.size import size_in_words
from phalanx.report.measures import LinkStatistics, origins, worst
from phalanx.theory.rows.origin import EMPTY

_NO_VERSION = ("run", "seed", "scenario_digest")
"""What a recording says of itself beside versions."""
_MOST_ROWS = 60
"""Of a table."""
_ASSUMPTIONS = ("assumption", "in words", "failed", "first failure")

_MEANING = {
    Outcome.GUARANTEED: "Safe, and proven so at every instant, whatever the others had done.",
    Outcome.SAFE: "Never unsafe, but not proven throughout: safe by luck.",
    Outcome.VIOLATED: "Some pair left the safe set.",
    Outcome.BROKEN: "The run did not reach its end.",
    Outcome.STOPPED: "The run was stopped by its user.",
}

_PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>$title</title>
<style>
:root { --page: #fff; --text: #1d2127; --quiet: #5d6570; --line: #d9dde3; --stripe: #f5f6f8; }
@media (prefers-color-scheme: dark) {
  :root { --page: #16191d; --text: #e4e7eb; --quiet: #9aa3ae; --line: #353b43; --stripe: #1e2227; }
}
body { background: var(--page); color: var(--text); font: 15px/1.5 system-ui, sans-serif;
  max-width: $width; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin: 0; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem; }
p.quiet, figcaption, .none { color: var(--quiet); }
p.quiet { margin: .2rem 0 1rem; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .25rem .9rem .25rem .5rem; vertical-align: top;
  border-bottom: 1px solid var(--line); overflow-wrap: anywhere; }
thead th { color: var(--quiet); font-weight: 600; }
tbody tr:nth-child(even) { background: var(--stripe); }
.wide { overflow: auto; max-height: 34rem; }
.verdict { border-left: .4rem solid var(--badge); background: var(--stripe); margin: 1.2rem 0;
  padding: .7rem 1rem; }
.verdict strong { background: var(--badge); color: #fff; border-radius: .3rem;
  letter-spacing: .04em; padding: .15rem .6rem; margin-right: .6rem; text-transform: uppercase;
  font-size: .85rem; }
.verdict p { margin: .4rem 0 0; overflow-wrap: anywhere; }
.guaranteed { --badge: #1a7f46; } .safe { --badge: #a86a00; } .violated { --badge: #c1121f; }
.broken, .stopped, .unfinished { --badge: #5d6570; }
figure { margin: 1.2rem 0; }
.beside { display: grid; gap: 1rem; grid-template-columns: repeat(auto-fit, minmax(24rem, 1fr)); }
figure img { background: #fff; border: 1px solid var(--line); border-radius: .3rem;
  max-width: 100%; display: block; }
figcaption { font-size: .9rem; margin-top: .3rem; }
pre { background: var(--stripe); padding: .8rem; overflow: auto; font-size: .8rem; }
</style>
</head>
<body>
$body
</body>
</html>
""")


def page(
    recording: Recording,
    links: Sequence[LinkStatistics],
    figures: Sequence[tuple[str, bytes]],
    notes: Sequence[str],
) -> str:
    """The whole report; figures are (caption, PNG), notes say what is not drawn and why."""
    title = f"{recording.scenario.name}, seed {recording.scenario.seed}"
    parts = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="quiet">{escape(recording.scenario.description)}</p>',
        *_origin(recording),
        _verdict(recording),
        _section("Key figures", _table((), key_figures(recording))),
        *_judgement(recording.summary),
        _section("Links", _links(links)),
        _section("Figures", "\n".join([*map(_figure, figures), *map(_note, notes)])),
        _section("Events", _events(recording)),
        _details(recording),
    ]
    return _PAGE.substitute(title=escape(title), body="\n".join(parts), width="64rem")


def comparison(
    runs: Sequence[str],
    differences: Sequence[Sequence[str]],
    results: Sequence[Sequence[str]],
    figures: Mapping[str, Mapping[str, bytes]],
) -> str:
    """A page of several runs; rows have a name and a value for each run, figures PNG by run."""
    title, head = f"{len(runs)} runs", ("", *runs)
    parts = [
        f"<h1>{escape(title)}</h1>",
        _section("What differs", _table(head, differences)),
        _section("What they came to", _table(head, results)),
    ]
    for name, of_runs in figures.items():
        shown = "".join(
            _figure((run, of_runs[run])) if run in of_runs else _note(f"{run}: nothing to draw")
            for run in runs
        )
        parts.append(_section(name, f'<div class="beside">{shown}</div>'))
    return _PAGE.substitute(title=escape(title), body="\n".join(parts), width="none")


def _origin(recording: Recording) -> list[str]:
    """The command that makes this run again, when it was made, and with what."""
    scenario, made = recording.scenario, dict(recording.metadata)
    command = scenario.reading.command(scenario.seed) if scenario.reading else None
    parts = [made.pop("date", ""), f"phalanx {made.pop('phalanx', 'of unknown version')}"]
    of_others = [f"{name} {made[name]}" for name in made if name not in _NO_VERSION]
    words = ", ".join(filter(None, [*parts, *of_others]))
    shown = [f"<pre>{escape(command)}</pre>"] if command else []
    return [*shown, f'<p class="quiet">{escape(words)}</p>']


def _verdict(recording: Recording) -> str:
    summary = recording.summary
    if summary is None:
        kind, meaning = "unfinished", "No verdict: the recording ends before the run did."
        reason = recording.damage or "it holds no summary"
    else:
        kind, meaning, reason = summary.outcome, _MEANING[summary.outcome], summary.reason
    return (
        f'<div class="verdict {kind}"><strong>{kind}</strong>{escape(meaning)}'
        f"<p>{escape(reason)}</p></div>"
    )


def key_figures(recording: Recording) -> list[tuple[str, str]]:
    """What a run came to, each with its name."""
    summary, peak = recording.summary, worst(recording)
    counts = origins(recording)
    steps, normal = len(recording.steps), sum(counts.values())
    empty = sum(counts[o] for o in EMPTY)
    share = f"{empty} of {normal} normal steps ({_percent(empty, normal)}): " if normal else ""
    kinds = ", ".join(f"{counts[o]} {o}" for o in EMPTY)
    reached = recording.states[-1].t if recording.states else 0.0
    rows = [
        ("Run", recording.metadata.get("run", "unknown")),
        ("Seed", str(recording.scenario.seed)),
        ("Virtual time", f"{reached:.3f} s of {recording.scenario.duration:g} s"),
        ("Worst h_tot", f"{peak.h_tot:.6g} at t = {peak.t:.3f} s" if peak else "no state"),
        ("Steps", f"{steps} recorded"),
        ("Empty K_i", share + kinds),
    ]
    if summary:
        rows += [
            ("Worst pair", summary.worst_pair),
            ("Certified", certified(summary)),
            ("Wall time", f"{summary.wall_time:.3f} s"),
            ("Real-time factor", f"{summary.real_time_factor:.2f}"),
            ("Trajectory, SHA-256", summary.trajectory),
        ]
    return [*rows, ("Recording", size_in_words(recording))]


def _judgement(summary: Summary | None) -> list[str]:
    """Assumptions, violations and rejected payloads, as far as there is a verdict."""
    if summary is None:
        return []
    guarantee, theorem = (
        [(a.name, a.note, f"{a.failed} of {a.checked}", _time(a.first)) for a in table]
        for table in (summary.assumptions, summary.theorem)
    )
    violations = [
        (v.pair, _time(v.first), f"{v.worst:.6g}", _time(v.worst_at), _time(v.duration))
        for v in sorted(summary.violations, key=lambda v: -v.worst)
    ]
    rejected = [(reason, str(count)) for reason, count in summary.rejected.items()]
    faults = [(f.name, str(f.count) if f.count else "never had an effect") for f in summary.faults]
    return [
        _section("What a guarantee rests on", _table(_ASSUMPTIONS, guarantee)),
        _section("What the paper's theorem would have needed", _table(_ASSUMPTIONS, theorem)),
        _section(
            "Violations",
            _table(("pair", "first", "worst h", "worst at", "time with h > 0"), violations),
        ),
        *_punctuality(summary.punctuality),
        _section("Declared faults", _table(("fault", "times it had an effect"), faults)),
        _section("Rejected payloads", _table(("by whom or why", "payloads"), rejected)),
    ]


def _punctuality(found: Punctuality | None) -> list[str]:
    if found is None:
        return []
    return [_section("Real time", _table(("what", "of this run"), in_words(found)))]


def _links(links: Sequence[LinkStatistics]) -> str:
    shown = sorted(links, key=lambda link: -link.excess) if len(links) > _MOST_ROWS else links
    head = ("link", "sent", "decided", "lost", "loss", "scenario's loss",
            "mean delay", "least", "most", "scenario's delay")  # fmt: skip
    rows = [
        (
            f"{link.sender} → {link.receiver}",
            str(link.sent),
            str(link.decided),
            str(link.lost),
            _percent(link.lost, link.decided),
            link.model.described(LOSS),
            *_delays(link.delays),
            link.model.described(DELAY),
        )
        for link in shown[:_MOST_ROWS]
    ]
    return _table(head, rows, len(links))


def _delays(delays: Sequence[float]) -> tuple[str, str, str]:
    if not delays:
        return ("none arrived",) * 3
    mean = sum(delays) / len(delays)
    return _milliseconds(mean), _milliseconds(min(delays)), _milliseconds(max(delays))


def _events(recording: Recording) -> str:
    return _table(("t", "event"), [(_time(event.t), event.text) for event in recording.log])


def _details(recording: Recording) -> str:
    text = escape(recording.scenario.model_dump_json(by_alias=True, indent=2))
    title = "The scenario, every default spelled out"
    return f"<details><summary>{title}</summary><pre>{text}</pre></details>"


def _figure(figure: tuple[str, bytes]) -> str:
    caption, png = figure
    data = base64.b64encode(png).decode()
    words = escape(caption)
    return (
        f'<figure><img alt="{words}" src="data:image/png;base64,{data}">'
        f"<figcaption>{words}</figcaption></figure>"
    )


def _section(title: str, content: str) -> str:
    return f"<h2>{escape(title)}</h2>\n{content}"


def _note(text: str) -> str:
    return f'<p class="none">{escape(text)}</p>'


def _table(head: Iterable[str], rows: Sequence[Sequence[str]], total: int | None = None) -> str:
    """The first rows; total: how many there are where the worst alone were given."""
    if not rows:
        return _note("None.")
    left = (total or len(rows)) - min(len(rows), _MOST_ROWS)
    titles = "".join(f'<th scope="col">{escape(title)}</th>' for title in head)
    top = f"<thead><tr>{titles}</tr></thead>" if titles else ""
    body = "\n".join(
        f'<tr><th scope="row">{escape(first)}</th>'
        + "".join(f"<td>{escape(cell)}</td>" for cell in rest)
        + "</tr>"
        for first, *rest in rows[:_MOST_ROWS]
    )
    table = f'<div class="wide"><table>{top}<tbody>\n{body}\n</tbody></table></div>'
    return table + (_note(f"and {left} more") if left else "")


def _time(t: float | None) -> str:
    return "never" if t is None else f"{t:.3f} s"


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.4g} ms"


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / whole:.2f} %" if whole else "0 %"
