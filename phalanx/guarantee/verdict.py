"""The end of a run: was the safe set kept, and did the theorem's assumptions hold."""

from enum import StrEnum

import msgspec


class Outcome(StrEnum):
    """How a run ended."""

    GUARANTEED = "guaranteed"
    """Safe throughout, and every assumption of the theorem held at every step."""
    SAFE = "safe"
    """Never unsafe, but some assumption failed: safe by luck."""
    VIOLATED = "violated"
    """Some pair's h was above zero."""
    BROKEN = "broken"
    """The run did not reach its end."""
    STOPPED = "stopped"
    """The user ended the run."""


class Assumption(msgspec.Struct):
    """One assumption of the theorem, and how often a run broke it."""

    name: str
    failed: int = 0
    """Number of failures; 0 if it held."""
    checked: int = 0
    """Number of checks."""
    first: float | None = None
    """Time of the first failure [s]."""
    note: str = ""
    """What it says, in words."""

    def check(self, holds: bool, t: float) -> None:
        """Count one check at t [s]."""
        self.checked += 1
        if not holds:
            self.failed += 1
            self.first = t if self.first is None else self.first


class Violation(msgspec.Struct):
    """A pair that left the safe set."""

    pair: str
    first: float
    """[s]"""
    worst: float
    """Largest h."""
    worst_at: float
    """[s]"""
    duration: float
    """Time with h > 0 [s]."""


class Summary(msgspec.Struct):
    """What a run comes to; written as summary.json and into the recording."""

    outcome: Outcome
    reason: str
    """One sentence."""
    t: float
    """Virtual time reached [s]."""
    seed: int
    trajectory: str
    """SHA-256 over every state and applied input, in hexadecimal."""
    worst_h_tot: float
    worst_at: float
    """[s]"""
    worst_pair: str
    """The pair whose h was largest."""
    steps: int
    origins: dict[str, int]
    """Steps of normal agents by how their input was made."""
    assumptions: list[Assumption]
    violations: list[Violation]
    rejected: dict[str, int]
    """Payloads dropped by the plant and by the agents, by reason."""
    wall_time: float
    """[s]"""

    @property
    def real_time_factor(self) -> float:
        """Virtual over wall time."""
        return self.t / self.wall_time if self.wall_time > 0 else 0.0


def exit_status(outcome: Outcome, strict: bool = False) -> int:
    """0 guaranteed or safe (1 for safe with strict), 2 violated, 3 broken, 130 stopped."""
    return {
        Outcome.GUARANTEED: 0,
        Outcome.SAFE: 1 if strict else 0,
        Outcome.VIOLATED: 2,
        Outcome.BROKEN: 3,
        Outcome.STOPPED: 130,
    }[outcome]


def judge(violations: list[Violation], assumptions: list[Assumption]) -> tuple[Outcome, str]:
    """The verdict on a run that reached its end. Safe by luck is never called guaranteed."""
    failed = [a for a in assumptions if a.failed]
    if violations:
        worst = max(violations, key=lambda v: v.worst)
        earlier = [
            f"{a.name} (since t = {a.first:.3f} s)"
            for a in failed
            if a.first is not None and a.first <= worst.first
        ]
        before = f"; assumptions that had failed: {', '.join(earlier)}" if earlier else ""
        return Outcome.VIOLATED, (
            f"{worst.pair} left the safe set at t = {worst.first:.3f} s, "
            f"up to h = {worst.worst:.4g} where 0 is allowed, for {worst.duration:.3f} s{before}"
        )
    if failed:
        what = ", ".join(f"{a.name} ({a.failed} of {a.checked} checks)" for a in failed)
        return Outcome.SAFE, (
            f"no pair left the safe set, but not guaranteed; assumptions that failed: {what}"
        )
    return Outcome.GUARANTEED, (
        "no pair left the safe set, and every assumption of the theorem held"
    )
