"""Information models: assumptions of a row on the other normal agents' inputs.

Declared adversaries count at their worst, γ_j^max, in every model.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol


class Information(StrEnum):
    """Information models of the row, and when each is sound.

    An agent's row certifies the joint condition from its own update until the next update of any
    normal agent, whose row certifies it from then on. So every input in a row must be the one in
    force when the row's own input takes effect.
    """

    PAPER = "paper"
    """(QPdistributed) as printed: the last received û_l, whether still in force or not. Sound only
    if every broadcast arrives before the next update of any other agent, and no two agents update
    together; the run checks it (received inputs in force)."""
    IN_FLIGHT = "in-flight"
    """û_l counts only while no newer input of l can be in force, t < t_l + Γ_l - δ_l^max with t_l
    the instant when û_l took effect; else γ_l^max. Sound for any delay and loss, if clocks keep
    their bounds and broadcasts are true; checked too (received inputs in force, sampling gap,
    truthful broadcasts)."""
    SPLIT = "split"
    """No û: each agent keeps one half of the condition of each pair of normal agents. Sound for any
    delay and loss, as halves are constant, and each agent's own margin is enough."""
    WORST_CASE = "worst-case"
    """γ_l^max for all others. Always sound, feasible least often."""
    UNKNOWN = "unknown"
    """Roles are not declared: an agent keeps its own pairs alone, with everyone else at γ_l^max. It
    reads no role, so that its pairs hold even if all others were taken over."""

    @property
    def reads_roles(self) -> bool:
        """Return whether agents know who is normal and who is an adversary."""
        return self is not Information.UNKNOWN

    @property
    def shares(self) -> bool:
        """Return whether each agent keeps its share of a joint condition."""
        return self is Information.SPLIT

    @property
    def counts_on_received(self) -> bool:
        """Return whether rows contain received inputs."""
        return self in (Information.PAPER, Information.IN_FLIGHT)


class ReceivedInput(Protocol):
    """The newest broadcast that an agent has received from another."""

    @property
    def t_apply(self) -> float:
        """Time from which the input is in force [s]."""

    @property
    def u(self) -> tuple[float, ...]:
        """û_l, shape (m_l,)."""


@dataclass(frozen=True)
class InformationModel:
    """Choice of the received inputs that a row contains."""

    kind: Information
    unchanged: Mapping[int, float]
    """Γ_l - δ_l^max of each normal agent [s]: the least time that its input stays in force."""
    silence: float
    """A normal agent without a broadcast for longer [s] counts like an adversary, at γ_l^max."""

    def usable(
        self, received: Mapping[int, ReceivedInput], t: float
    ) -> dict[int, tuple[float, ...]]:
        """û_l by agent, where it counts for an input that takes effect at t [s]."""
        least, silence = self.unchanged, self.silence
        match self.kind:
            case Information.PAPER:
                return {l: h.u for l, h in received.items() if t - h.t_apply <= silence}
            case Information.IN_FLIGHT:
                until = _INSTANT
                return {l: h.u for l, h in received.items() if t < h.t_apply + least[l] - until}
            case _:
                return {}

    def sharing(
        self,
        i: int,
        received: Mapping[int, ReceivedInput],
        t: float,
        among: Iterable[int] | None = None,
    ) -> list[int]:
        """Normal agents that are expected to keep their share at t [s], agent i included.

        among: agents of any kind to choose from; None for all.
        """
        begun = t <= self.silence
        alive = {l for l, h in received.items() if t - h.t_apply <= self.silence}
        normal = self.unchanged
        among = normal if among is None else among
        return [l for l in among if l in normal and (l == i or begun or l in alive)]


_INSTANT = 1e-9
"""Tolerance for equal times [s], since sums of periods round."""
