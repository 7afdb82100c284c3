"""The report of a check of a scenario."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import NamedTuple

from phalanx.guarantee.formula import Formula
from phalanx.guarantee.impossible import Impossible
from phalanx.guarantee.kept_distance import KeptDistance
from phalanx.guarantee.promise import Grades
from phalanx.guarantee.radio_reach import RadioReach
from phalanx.guarantee.start import CertifiedStart, Promise


@dataclass(frozen=True)
class BoundaryCondition:
    """Theorem 3's Eq. (asyncminmaxcondition) at sampled states on the boundary of S_I.

    A margin computed in the run counts as 0, so that a violation holds for any margin.
    """

    states: int
    """Number of states."""
    worst: float
    """Largest Σ γ_min + Σ γ_max + α + η; above 0 the condition fails there."""

    @property
    def holds(self) -> bool | None:
        """False if violated, else None: samples cannot prove it."""
        return False if self.worst > 0 else None


class Requirement(NamedTuple):
    """A row of the table."""

    name: str
    value: str
    """In the scenario."""
    allowed: str
    """Values that meet it, or the setting without which the scenario's is not known."""
    equation: str
    """In the paper."""
    holds: bool | None
    """None if unknown."""


class Finding(NamedTuple):
    """A requirement of the guarantee, sentences with what to change, or both."""

    row: Requirement | None
    words: Sequence[str] = ()


@dataclass(frozen=True)
class CheckReport:
    """The results of a check."""

    relative_degree: int
    """q."""
    psi_at_start: tuple[float, ...]
    """Largest ψ_0, ..., ψ_{q-1} at x(0); above 0 the start is outside S_I."""
    eta_paper: dict[str, float | None]
    """By normal agent: η(Γ + δ^max) with margin = "paper"; None for other margins."""
    formula: Formula | None
    """η of h_tot over the workspace; None if the workspace is not known."""
    pair_formula: Formula | None
    """The same for the pair with the largest η."""
    eta_local: dict[str, float]
    """By normal agent: the largest local margin of its rows at x(0)."""
    rows_at_start: dict[str, bool]
    """By normal agent: True if K_i(x(0)) is non-empty, with nothing received yet."""
    boundary: BoundaryCondition | None
    """None if not computed: there is no workspace, or the start is outside S_I."""
    horizon: float
    """Longest time for which a normal agent's input is in force, Γ + δ^max and the latency [s]."""
    largest_gap: float | None
    """The horizon up to which every proven K_i(x(0)) (half rows for each pair, local
    margin) is non-empty [s]; None if there is none."""
    largest_delay: float
    """Longest delay of broadcasts for which received inputs in the rows are in force [s]; may be
    inf."""
    gaps: list[str]
    """Requirements of the paper's theorem, or the margin's proof, that no run can meet."""
    certified: CertifiedStart
    """Certificates at the start, on which the verdict rests."""
    promised: Promise
    """The time for which all pairs are safe, proven before a run."""
    grades: Grades = Grades()  # noqa: RUF009
    """What is promised of pairs before a run, if agents keep fallbacks."""
    impossible: Impossible = Impossible()  # noqa: RUF009
    """What no rule can promise."""
    kept_distance: KeptDistance | None = None
    """At rest before one another; None if it is not known."""
    radio: RadioReach | None = None
    """Of agents that know one another by radio."""
    findings: list[Finding] = field(default_factory=list)
    """All of them, in the order of the paper."""

    @property
    def answer(self) -> str:
        """Sentence on the verdict of a run, as far as it is known before."""
        if self.may_be_guaranteed:
            return "a run can end guaranteed: every pair is certified at the start"
        if not self.certified.safe:
            return "a run will end violated: a pair is unsafe at the start"
        return "a run cannot end guaranteed: no certificate covers its start"

    @property
    def table(self) -> list[Requirement]:
        """The requirements of a guarantee, as `phalanx check` prints them."""
        return [finding.row for finding in self.findings if finding.row]

    @property
    def words(self) -> list[str]:
        """Sentences on the results, and what to change."""
        return [sentence for finding in self.findings for sentence in finding.words]

    def __repr__(self) -> str:
        return "\n".join([self.answer, *(f"- {sentence}" for sentence in self.words)])

    def _repr_html_(self) -> str:
        """Return the answer and the sentences for a notebook."""
        words = "".join(f"<li>{escape(sentence)}</li>" for sentence in self.words)
        return f"<p><b>{escape(self.answer)}</b></p><ul>{words}</ul>"

    @property
    def worst_at_start(self) -> float:
        """The largest ψ at x(0)."""
        return max(self.psi_at_start)

    @property
    def may_be_guaranteed(self) -> bool:
        """True if a run can end guaranteed: certificates cover its start. Gaps do not matter."""
        return self.certified.holds
