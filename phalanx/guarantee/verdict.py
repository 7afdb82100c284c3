"""The verdict on a run, its assumptions, violations, certificates and timing."""

from collections.abc import Sequence
from enum import StrEnum
from html import escape

import msgspec
import numpy as np

from phalanx.schema.notebook import html_table
from phalanx.theory.arrays import Array, Mask
from phalanx.theory.rows.origin import origin_label


class Percentiles(msgspec.Struct):
    """Percentiles of repeated measurements of one time [s]."""

    name: str
    count: int
    p50: float
    p99: float
    most: float


class Punctuality(msgspec.Struct):
    """Timing of one run in real time."""

    samples: int
    """Samples sent to agents."""
    missed: int
    """Ticks of an agent's clock at which its answer to the sample before was still missing."""
    unanswered: int
    """Samples without an answer until the timeout."""
    late: int
    """Inputs that arrived at their actuator after they were due."""
    measured: list[Percentiles]


def timing_rows(punctuality: Punctuality) -> list[tuple[str, str]]:
    """Return each figure as a text with its name."""
    return [
        ("samples missed", f"{punctuality.missed}; {punctuality.samples} taken"),
        ("samples unanswered", str(punctuality.unanswered)),
        ("inputs late", str(punctuality.late)),
        *(
            (m.name, " ms, ".join(
                f"{name} {1e3 * value:.2f}"
                for name, value in (("p50", m.p50), ("p99", m.p99), ("max", m.most))
            ) + " ms")
            for m in punctuality.measured
        ),
    ]  # fmt: skip


def percentiles(name: str, seconds: Sequence[float]) -> Percentiles:
    """Summarize a list of times; zeros if it is empty."""
    values = np.percentile(seconds, [50, 99, 100]).tolist() if len(seconds) else [0.0] * 3
    return Percentiles(name, len(seconds), *values)


class Outcome(StrEnum):
    """The outcome of a run."""

    GUARANTEED = "guaranteed"
    """Safe, and proven so at every instant for all inputs of the other agents."""
    SAFE = "safe"
    """Not unsafe at any integration step, but not proven so, nor known between steps."""
    VIOLATED = "violated"
    """Some pair's h was above zero."""
    BROKEN = "broken"
    """The run did not reach its end."""
    STOPPED = "stopped"
    """The user ended the run."""


class Assumption(msgspec.Struct):
    """One assumption of a proof, and how often it failed in a run."""

    name: str
    failed: int = 0
    """Number of failures; 0 if it held."""
    checked: int = 0
    """Number of checks."""
    first: float | None = None
    """Time of the first failure [s]."""
    note: str = ""
    """The assumption as a sentence."""

    def check(self, holds: bool, t: float) -> None:
        """Count one check at t [s]."""
        self.checked += 1
        if not holds:
            self.failed += 1
            self.first = t if self.first is None else self.first

    def check_each(self, holds: Mask, times: Array) -> None:
        """Count a check at each of several times [s], shapes (n,)."""
        self.checked += len(holds)
        failed = np.flatnonzero(~holds)
        self.failed += len(failed)
        if len(failed) and self.first is None:
            self.first = float(times[failed[0]])


class CertificateSummary(msgspec.Struct):
    """Counts of the certificates of a run; see docs/certificate.md."""

    samples: int = 0
    """Inputs that normal agents applied."""
    certified: int = 0
    """Inputs with which every pair was proven safe until the agent's next sample."""
    shortest: float | None = None
    """The shortest time for which an input was proven safe, in multiples of τ."""
    uncovered: str | None = None
    """The first pair without a certificate."""
    uncovered_at: float | None = None
    """Time from which it had none [s]."""

    def count(self, proven: Array, longest: Array) -> None:
        """Count inputs, each proven safe for one time, and held for at most another [s]; (r,)."""
        if len(proven):
            self.samples += len(proven)
            self.certified += int(np.count_nonzero(proven >= longest))
            ratio = float((proven / longest).min())
            self.shortest = ratio if self.shortest is None else min(self.shortest, ratio)


class Convicted(msgspec.Struct):
    """A conviction: one agent found that another announced or stated what is false."""

    by: str
    of: str
    t: float
    """Time of the sample at which it was found [s]."""
    begin: float
    """Begin of the window [s]."""
    end: float
    excess: float
    """By how much more than φ^max it takes to explain the motion; by radio [m]."""
    after: float | None = None
    """Time since the agent's first false broadcast [s]; None if there was none: a false one."""


class TrustSummary(msgspec.Struct):
    """Betrayals, which the plant knows, and convictions, which agents found."""

    betrayals: dict[str, float] = {}
    """By agent, the time from which it first did not hold what it announced [s]."""
    convictions: list[Convicted] = []

    @property
    def false(self) -> int:
        """Number of convictions of agents that held what they announced."""
        return sum(conviction.after is None for conviction in self.convictions)

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Return each figure as a text with its name."""
        fastest: dict[str, float] = {}
        for c in self.convictions:
            if c.after is not None:
                fastest[c.of] = min(c.after, fastest.get(c.of, c.after))
        betrayals = ", ".join(f"{name} from {t:.3f} s on" for name, t in self.betrayals.items())
        delays = ", ".join(f"{name} after {1e3 * t:.0f} ms" for name, t in fastest.items())
        count, by = len(self.convictions), len({c.by for c in self.convictions})
        return [
            ("betrayals", betrayals or "none"),
            ("convictions", f"{count} by {by} agent{'s' * (by != 1)}"),
            ("first convicted", delays or "none"),
            ("false convictions", str(self.false)),
        ]


class BrokenPromise(msgspec.Struct):
    """The first event that broke an agent's part of a promise."""

    agent: str
    t: float
    """[s]"""
    why: str


class PromiseSummary(msgspec.Struct):
    """The promise made before a run; see docs/promise.md. It is no part of the outcome."""

    for_ever: int
    """Pairs for which it was kept that never come closer than they may."""
    passively: int
    """Pairs for which it was kept whose agent hits nothing while it moves by itself."""
    promised: int
    """Pairs that were promised anything."""
    broken: list[BrokenPromise] = []
    """By the first event of each agent."""
    turned: dict[str, float] = {}
    """Agents that turned, with the time [s]: others keep passively what they had for ever."""
    refused: str = ""
    """Why nothing was promised."""
    until: int = 0
    """Pairs with one that is faster for which it was kept for as long as it was promised."""

    @property
    def kept(self) -> bool:
        """True if something was promised, and nothing broke it."""
        return bool(self.promised) and not self.broken

    @property
    def lost_at(self) -> float | None:
        """Time at which the first promise broke [s]; None if none did."""
        return self.broken[0].t if self.broken else None

    def __str__(self) -> str:
        if not self.promised:
            return f"nothing was promised{f': {self.refused}' if self.refused else ''}"
        pairs = f"{self.for_ever + self.passively + self.until} of {self.promised} pairs"
        until = f", {self.until} for its time" if self.until else ""
        words = f"kept for {pairs} ({self.for_ever} for ever, {self.passively} passively{until})"
        if self.turned:
            turns = ", ".join(f"{name} at {t:.3f} s" for name, t in self.turned.items())
            words += f"; turned, and promised nothing since: {turns}"
        if self.broken:
            first = self.broken[0]
            more = f" and {len(self.broken) - 1} more" if len(self.broken) > 1 else ""
            words += f"; broken at {first.t:.3f} s by {first.agent}: {first.why}{more}"
        return words


class FaultCount(msgspec.Struct):
    """A fault that the scenario declares, and the number of its effects."""

    name: str
    """Its field: "network.links.0.loss", "faults.2 (partition)"."""
    count: int
    """Number of messages, samples or agents affected."""


class Violation(msgspec.Struct):
    """Excursions of a pair from the safe set: times with h > 0."""

    pair: str
    first: float
    """Begin of the first excursion [s]."""
    worst: float
    """Largest h."""
    worst_at: float
    """[s]"""
    duration: float
    """Of all excursions together [s]."""
    count: int
    """Number of excursions."""
    begin: float
    """Begin of the last one [s]."""
    end: float | None
    """Its end [s]; None while it lasts."""

    @property
    def times(self) -> str:
        """Its times as text, such as "1.413 s from t = 124.118 s to 125.531 s"."""
        end = "on" if self.end is None else f"to {self.end:.3f} s"
        more = f", in {self.count} excursions" if self.count > 1 else ""
        return f"{self.duration:.3f} s from t = {self.first:.3f} s {end}{more}"


class Deadlock(msgspec.Struct):
    """A time for which a normal agent wanted to move, was held by its rows, and stood."""

    agent: str
    begin: float
    """[s]"""
    end: float
    """The last time at which it was seen to stand [s]."""
    held_by: dict[str, float] = {}
    """For how long rows of each other agent, obstacle or limit were binding [s]."""

    @property
    def waits_for(self) -> list[str]:
        """Return who held it at least half as long as the one that did longest."""
        longest = max(self.held_by.values(), default=0.0)
        return sorted(name for name, held in self.held_by.items() if held >= 0.5 * longest)

    def __str__(self) -> str:
        holders = ", ".join(self.waits_for) or "no row of its own"
        return (
            f"agent {self.agent} has stood since {self.begin:.4g} s though it wants to move, "
            f"held by: {holders}"
        )


def waiting_in_words(deadlocks: Sequence[Deadlock], most: int = 8) -> str:
    """Say who waited for whom, as "a for c and d (1.9 to 8 s), …"; empty without one."""
    longest: dict[str, Deadlock] = {}
    for deadlock in sorted(deadlocks, key=lambda d: d.begin - d.end):
        longest.setdefault(deadlock.agent, deadlock)
    texts = [
        f"{name} for {' and '.join(d.waits_for) or 'no one'} ({d.begin:.4g} to {d.end:.4g} s)"
        for name, d in longest.items()
    ]
    more = [f"{len(texts) - most} more"] if len(texts) > most else []
    return ", ".join(texts[:most] + more)


class Summary(msgspec.Struct):
    """The results of a run; written as summary.json and into the recording."""

    outcome: Outcome
    reason: str
    """One sentence."""
    t: float
    """Virtual time reached [s]."""
    seed: int
    trajectory: str
    """SHA-256 over every state and applied input, in hexadecimal."""
    worst_h: float
    """Largest h of a pair with a normal agent, at any integration step."""
    worst_at: float
    """Its time [s]."""
    worst_pair: str
    """Its pair."""
    largest_h_tot: float
    largest_h_tot_at: float
    """[s]"""
    steps: int
    origins: dict[str, int]
    """Steps of normal agents by the origin of their input."""
    assumptions: list[Assumption]
    """Assumptions of the outcome `guaranteed`."""
    theorem: list[Assumption]
    """Assumptions of the paper's theorem, which have no effect on the outcome."""
    certificates: CertificateSummary
    violations: list[Violation]
    rejected: dict[str, int]
    """Payloads dropped by the plant and by the agents, by reason."""
    wall_time: float
    """[s]"""
    faults: list[FaultCount] = []
    """Every fault that the scenario declares."""
    punctuality: Punctuality | None = None
    """None unless the run was in real time."""
    excluded: list[Violation] = []
    """Excursions of pairs since all their normal agents had turned adversary: not counted."""
    trust: TrustSummary | None = None
    """None unless agents watch each other, or know peers by radio."""
    deadlocks: list[Deadlock] | None = None
    """Of normal agents; None in older recordings."""
    promise: PromiseSummary | None = None
    """None unless agents keep fallbacks, by safety.keep."""
    lost: list[str] = []
    """Agents that became unreachable in real time: when, and what they had reported."""

    def __repr__(self) -> str:
        until = f"{self.outcome} after {self.t:g} s"
        return f"Summary({until}: {self.reason!r}, worst h {self.worst_in_words})"

    def _repr_html_(self) -> str:
        """Return the key figures for a notebook."""
        return f"{html_table(self._key_figures)}<p>{escape(self.reason)}</p>"

    @property
    def _key_figures(self) -> list[tuple[str, str]]:
        steps = ", ".join(f"{count} {origin_label(name)}" for name, count in self.origins.items())
        failed = ", ".join(a.name for a in self.assumptions if a.failed) or "none"
        return [
            ("verdict", str(self.outcome)),
            ("virtual time", f"{self.t:.3f} s, seed {self.seed}"),
            ("worst h", self.worst_in_words),
            ("control steps of normal agents", steps),
            ("assumptions that failed", failed),
            ("certified", certified(self)),
            *([("promise", str(self.promise))] if self.promise else []),
            ("real-time factor", f"{self.real_time_factor:.1f}"),
            ("trajectory", self.trajectory[:16]),
        ]

    @property
    def worst_in_words(self) -> str:
        """The worst h with its pair and time, as text."""
        return f"{self.worst_h:.4g} of {self.worst_pair} at t = {self.worst_at:.3f} s"

    @property
    def on_theorem(self) -> str:
        """Sentence on the paper's theorem, which a guarantee does not need; else empty."""
        failed = [a for a in self.theorem if a.failed]
        if self.outcome is not Outcome.GUARANTEED or not failed:
            return ""
        counts = ", ".join(f"{a.name} failed in {a.failed} of {a.checked} checks" for a in failed)
        return (
            f"Proven by certificates. The paper's theorem alone would not have sufficed: {counts}."
        )

    @property
    def notes(self) -> list[str]:
        """Remarks on the verdict: faults that never had an effect."""
        return [f"{f.name} never had an effect" for f in self.faults if not f.count]

    @property
    def real_time_factor(self) -> float:
        """Virtual over wall time."""
        return self.t / self.wall_time if self.wall_time > 0 else 0.0


def read_summary(written: bytes) -> Summary:
    """Read a summary from its JSON. Raises ValueError if it is malformed."""
    try:
        return msgspec.json.decode(written, type=Summary)
    except msgspec.DecodeError as error:  # not a ValueError, as UnicodeDecodeError is
        raise ValueError(f"no summary, or of another version of Phalanx: {error}") from error


def certified(summary: Summary) -> str:
    """Return the counts of certificates as a text."""
    counts = summary.certificates
    if counts.shortest is None:
        return "no input was applied"
    share = (
        f"{counts.certified} of {counts.samples} inputs, the shortest for {counts.shortest:.2f} τ"
    )
    if counts.uncovered is None or counts.uncovered_at is None:
        return share
    return f"{share}; {counts.uncovered} without one from t = {counts.uncovered_at:.3f} s on"


def exit_status(outcome: Outcome, strict: bool = False) -> int:
    """Return 0: guaranteed or safe (1: safe, if strict), 2: violated, 3: broken, 130: stopped."""
    return {
        Outcome.GUARANTEED: 0,
        Outcome.SAFE: 1 if strict else 0,
        Outcome.VIOLATED: 2,
        Outcome.BROKEN: 3,
        Outcome.STOPPED: 130,
    }[outcome]


def judge(
    violations: list[Violation],
    assumptions: list[Assumption],
    theorem: list[Assumption],
    excluded: Sequence[Violation] | None = None,
) -> tuple[Outcome, str]:
    """Return the outcome of a run that reached its end, and the reason in a sentence.

    Args:
        violations: pairs that left the safe set, the deepest first.
        assumptions: those of the outcome `guaranteed`.
        theorem: those of the paper's theorem, which have no effect on the outcome.
        excluded: violations of pairs without a normal agent, which have no effect either; None if
            there is no such pair.
    """
    counted = "pair" if excluded is None else "pair with a normal agent"
    failed = _counts([a for a in assumptions if a.failed])
    outcome, reason = Outcome.GUARANTEED, f"every {counted} was proven safe at every instant"
    if violations:
        outcome, reason = Outcome.VIOLATED, _worst_of(violations, [*assumptions, *theorem])
    elif failed:
        unsafe = f"no {counted} was outside the safe set at any integration step, but this is not"
        unknown = f"guaranteed, nor known between the steps; assumptions that failed: {failed}"
        outcome, reason = Outcome.SAFE, f"{unsafe} {unknown}"
    if excluded:
        pairs = ", ".join(f"{v.pair} (from t = {v.first:.3f} s)" for v in excluded)
        reason += f"; not counted, since their agents had turned adversary: {pairs}"
    return outcome, reason


def _worst_of(violations: list[Violation], assumptions: list[Assumption]) -> str:
    worst = max(violations, key=lambda v: v.worst)
    earlier = [
        f"{a.name} (since t = {a.first:.3f} s)"
        for a in {a.name: a for a in assumptions}.values()
        if a.first is not None and a.first <= worst.first
    ]
    before = f"; assumptions that had failed: {', '.join(earlier)}" if earlier else ""
    depth = f"up to h = {worst.worst:.4g} where 0 is allowed"
    return f"{worst.pair} left the safe set, {depth}, for {worst.times}{before}"


def _counts(failed: list[Assumption]) -> str:
    return ", ".join(f"{a.name} ({a.failed} of {a.checked} checks)" for a in failed)
