"""Information models: assumptions of a row on the other normal agents' inputs.

An agent's row certifies the joint condition from its own update until the next one of any normal
agent, whose row certifies it from then on. So every input in a row must be the one in force when
its own input takes effect. Declared adversaries count at their worst, γ_j^max, in every model.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

_INSTANT = 1e-9
"""Tolerance for equal times [s], since sums of periods round."""


class ReceivedInput(Protocol):
    """The newest broadcast that an agent has received from another."""

    @property
    def t_apply(self) -> float:
        """Time from which the input is in force [s]."""

    @property
    def u(self) -> tuple[float, ...]:
        """û_l, shape (m_l,)."""


@dataclass(frozen=True)
class Information:
    """An information model, which a scenario names in safety.information.

    A model of its own sets what differs, for example::

        class Newest(Information):
            label = "information is newest"
            counts_on_received = True

            def counts(self, l, received, t):
                return True
    """

    unchanged: Mapping[int, float]
    """Γ_l - δ_l^max of each normal agent [s]: the least time that its input stays in force."""
    silence: float
    """A normal agent without a broadcast for longer [s] counts like an adversary, at γ_l^max."""

    label: ClassVar[str]
    """Why no received input counts, or which do, as a clause."""
    reads_roles: ClassVar[bool] = True
    """Whether agents know who is normal and who is an adversary."""
    shares: ClassVar[bool] = False
    """Whether rows assume the best effort of all normal agents."""
    counts_on_received: ClassVar[bool] = False
    """Whether rows contain received inputs."""
    longest_delay: ClassVar[float] = float("inf")
    """Longest delay of broadcasts for which received inputs in the rows are in force [s]."""
    advice: ClassVar[str] = ""
    """What a check says where agents receive one another's inputs; "" for nothing."""

    def counts(self, l: int, received: ReceivedInput, t: float) -> bool:
        """Return whether agent l's û_l counts for an input that takes effect at t [s]."""
        return False

    def usable(
        self, received: Mapping[int, ReceivedInput], t: float
    ) -> dict[int, tuple[float, ...]]:
        """û_l by agent, where it counts for an input that takes effect at t [s]."""
        return {l: message.u for l, message in received.items() if self.counts(l, message, t)}

    def sharing(
        self, i: int, received: Mapping[int, ReceivedInput], t: float, among: Iterable[int]
    ) -> list[int]:
        """Normal agents among these that keep their half of a pair at t [s], agent i included."""
        begun = t <= self.silence
        alive = {l for l, message in received.items() if t - message.t_apply <= self.silence}
        return [l for l in among if l in self.unchanged and (l == i or begun or l in alive)]


class Paper(Information):
    """(QPdistributed) as printed: the last received û_l, whether still in force or not.

    Sound only if every broadcast arrives before the next update of any other agent, and no two
    agents update together; the run checks it (received inputs in force).
    """

    label = "information is paper"
    counts_on_received = True
    longest_delay = 0.0
    advice = (
        "safety.information = 'paper' assumes that each neighbour applies the last input received "
        "of it. With any delay or loss, or if two agents sample at one instant, the neighbour may "
        "apply another one: each agent's row holds, but not the joint condition. Take 'in-flight' "
        "or 'unknown', or 'split' with composition = 'pairs'."
    )

    def counts(self, l: int, received: ReceivedInput, t: float) -> bool:
        return t - received.t_apply <= self.silence


class InFlight(Information):
    """û_l counts only while no newer input of l can be in force, t < t_l + Γ_l - δ_l^max with t_l
    the instant when û_l took effect; else γ_l^max.

    Sound for any delay and loss, if clocks keep their bounds and broadcasts are true; checked too
    (received inputs in force, sampling gap, truthful broadcasts).
    """

    label = "information is in-flight"
    counts_on_received = True

    def counts(self, l: int, received: ReceivedInput, t: float) -> bool:
        return t < received.t_apply + self.unchanged[l] - _INSTANT


class Split(Information):
    """No û: each agent keeps one half of the condition of each pair of normal agents.

    Sound for any delay and loss, as halves are constant, and each agent's own margin is enough.
    """

    label = "information is split"
    shares = True


class WorstCase(Information):
    """γ_l^max for all others. Always sound, feasible least often."""

    label = "information is worst-case"


class Unknown(Information):
    """Roles are not declared: an agent keeps its own pairs alone, with everyone else at γ_l^max.

    It reads no role, so that its pairs hold even if all others were taken over.
    """

    label = "information is unknown"
    reads_roles = False


class Together(Information):
    """One controller decides for all normal agents, as in Theorem 1: safety.control has it."""

    label = "one controller decides"
    shares = True
