"""What a check of a scenario answers."""

from dataclasses import dataclass, field

from phalanx.guarantee.certificates import CertifiedStart
from phalanx.guarantee.formula import Formula


@dataclass(frozen=True)
class BoundaryCondition:
    """Theorem 3's Eq. (asyncminmaxcondition), asked of sampled states on the boundary of S_I.

    With a margin that is computed η counts as 0, so that what is refuted here is refuted for any
    margin.
    """

    states: int
    """How many were asked."""
    worst: float
    """Largest Σ γ_min + Σ γ_max + α + η; above 0 the condition fails there."""

    @property
    def holds(self) -> bool | None:
        """False if refuted, None if not: samples cannot prove it."""
        return False if self.worst > 0 else None


@dataclass(frozen=True)
class CheckReport:
    """The answers, and in words what they mean."""

    relative_degree: int
    """q."""
    psi_at_start: tuple[float, ...]
    """Largest ψ_0, ..., ψ_{q-1} at x(0); above 0 the start is outside S_I."""
    eta_paper: dict[str, float | None]
    """By normal agent: η(Γ + δ^max) in force with margin = "paper"; None if none is given."""
    formula: Formula | None
    """Of h_tot over the workspace; None if the workspace is not known."""
    pair_formula: Formula | None
    """Likewise of the pair that needs most."""
    eta_local: dict[str, float]
    """By normal agent: the largest local margin of its rows at x(0)."""
    rows_at_start: dict[str, bool]
    """By normal agent: whether K_i(x(0)) is non-empty, with nothing received yet."""
    boundary: BoundaryCondition | None
    """None if it was not asked: there is no workspace, or the start is outside S_I."""
    horizon: float
    """How long a normal agent's input may be in force, Γ + δ^max and the latency [s]."""
    largest_gap: float | None
    """The horizon up to which every proven K_i(x(0)) (half rows for each pair, local
    margin) is non-empty [s]; None if none is."""
    largest_delay: float
    """Longest delay for which what the rows count on is in force [s]; inf for any."""
    gaps: list[str]
    """What the paper's theorem, or the margin's, lacks whatever the run does; empty if nothing."""
    certified: CertifiedStart
    """What the certificates say that a run is judged by."""
    words: list[str] = field(default_factory=list)
    """What all this means, and what to change."""

    @property
    def answer(self) -> str:
        """Whether a run can end guaranteed, in words."""
        can = "can" if self.may_be_guaranteed else "cannot"
        return f"a run {can} end guaranteed (relative degree q = {self.relative_degree})"

    def __repr__(self) -> str:
        return "\n".join([self.answer, *(f"- {words}" for words in self.words)])

    @property
    def worst_at_start(self) -> float:
        """The largest ψ of all at x(0)."""
        return max(self.psi_at_start)

    @property
    def may_be_guaranteed(self) -> bool:
        """Whether a run can end guaranteed: it begins under certificates. Gaps do not count."""
        return self.certified.holds
