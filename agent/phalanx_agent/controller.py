"""What turns one agent's samples into inputs."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

from phalanx.arrays import Array
from phalanx.theory.rows.decision import Decision
from phalanx.theory.rows.information import ReceivedInput
from phalanx.wire.step_report import StepReport


class StepResult(NamedTuple):
    """What came of a sample."""

    decision: Decision
    u_nom: Array
    """The nominal input, or the attack before its projection, shape (m_i,)."""
    used: list[int]
    """The agents whose û_l counted."""

    def report(self, solve_time: float) -> StepReport:
        """All numbers of the decision, and how long it took [s]."""
        made = self.decision._asdict()
        del made["u"]
        return StepReport(u_nom=tuple(self.u_nom.tolist()), solve_time=solve_time, **made)


class Controller(Protocol):
    """One agent's controller: its own, or its part of the centralised one."""

    def __call__(
        self, x: Array, seen: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide on the stacked state x, shape (n̄,), sampled at t [s]: NaN but of those seen."""

    def turned(self) -> "Controller":
        """The same agent's as an adversary."""
