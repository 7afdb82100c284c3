"""What an agent may assume of the other normal agents' inputs: the information models.

Adversaries count at their worst, γ_j^max, in every model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from phalanx.arrays import Array


class Information(StrEnum):
    """Information models of the row, and when each is sound.

    An agent's row certifies the joint condition from its own update until the next update of any
    normal agent, whose row then takes over. So what matters is that every input a row counts on
    is the one in force when the row's own input takes effect.
    """

    PAPER = "paper"
    """(QPdistributed) as printed: the last received û_l, whatever has become of it. Sound only if
    every broadcast arrives before anyone else's next update, and no two agents update together;
    the run checks it (received inputs in force)."""
    IN_FLIGHT = "in-flight"
    """û_l counts only while no newer input of l can be in force, t < t_l + Γ_l - δ_l^max, where
    t_l is when û_l took effect; else γ_l^max. Sound for any delay and loss, if clocks keep their
    bounds and senders tell the truth; checked too (received inputs in
    force, sampling gap, truthful broadcasts)."""
    SPLIT = "split"
    """No û: each agent keeps its share of the joint condition. Sound for any delay and loss, as
    all normal agents compose the same h_tot. With `lse` shares are computed from different samples,
    and keep back what that costs to first order (ShareMargin); the rest is in η, and not proven.
    With `pairs` shares are constant, and each agent's own margin is enough."""
    WORST_CASE = "worst-case"
    """γ_l^max for everybody else. Sound always, feasible least often."""

    @property
    def shares(self) -> bool:
        """Whether each agent keeps its share of a joint condition."""
        return self is Information.SPLIT

    @property
    def counts_on_received(self) -> bool:
        """Whether rows count on inputs that were received."""
        return self in (Information.PAPER, Information.IN_FLIGHT)


class ReceivedInput(Protocol):
    """The newest broadcast that an agent has of another one, as a row needs it."""

    @property
    def t_apply(self) -> float:
        """When the input takes effect [s]."""

    @property
    def u(self) -> tuple[float, ...]:
        """û_l, shape (m_l,)."""


@dataclass(frozen=True)
class InformationModel:
    """Which received inputs a row may count on."""

    kind: Information
    unchanged: Mapping[int, float]
    """Γ_l - δ_l^max of each normal agent [s]: how long its input stays in force at least."""
    silence: float
    """A normal agent not heard of for longer [s] is counted like an adversary, at γ_l^max."""

    def usable(self, received: Mapping[int, ReceivedInput], t: float) -> dict[int, Array]:
        """û_l by agent, of those that count for an input that takes effect at t [s]."""
        if not self.kind.counts_on_received:
            return {}
        if self.kind is Information.IN_FLIGHT:
            return {
                l: np.array(h.u)
                for l, h in received.items()
                if t < h.t_apply + self.unchanged[l] - _INSTANT
            }
        return {l: np.array(h.u) for l, h in received.items() if t - h.t_apply <= self.silence}

    def sharing(
        self,
        i: int,
        received: Mapping[int, ReceivedInput],
        t: float,
        among: Sequence[int] | None = None,
    ) -> list[int]:
        """Normal agents that can be expected to keep their share at t [s], agent i with them.

        among: agents of any kind, of whom it is asked; None for all.
        """
        begun = t <= self.silence
        alive = {l for l, h in received.items() if t - h.t_apply <= self.silence}
        asked = self.unchanged if among is None else [l for l in among if l in self.unchanged]
        return [l for l in asked if l == i or begun or l in alive]


_INSTANT = 1e-9
"""Two times within this are one [s]: sums of periods round."""
