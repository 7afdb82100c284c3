"""Faults as objects: each function makes one entry of [[faults]], with the fields of its table.

A field `for` is `for_` here, since Python has a word of that name. Each raises ValueError if a
field is wrong. See docs/network-faults.md for their meaning.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from pydantic import TypeAdapter

from phalanx.faults.fault import Fault
from phalanx.faults.links import Shape
from phalanx.scenario.declared import AnyFault

_FAULT: TypeAdapter[Fault] = TypeAdapter(AnyFault)


def table_of(fault: Fault) -> dict[str, Any]:
    """Return a fault's table, as a scenario's file has it."""
    return fault.model_dump(mode="json", by_alias=True, exclude_unset=True)


def _fault(kind: str, **fields: Any) -> Fault:
    fault = {name.rstrip("_"): value for name, value in fields.items() if value is not None}
    return _FAULT.validate_python({"kind": kind, **fault})


def partition(
    *groups: Sequence[str], for_: float, at: float = 0.0, shape: Shape | None = None
) -> Fault:
    """Cut the links between groups of agents; all agents in no group form one more.

    shape: in place of groups, agents that stay connected are drawn.
    """
    return _fault("partition", groups=groups or None, at=at, for_=for_, shape=shape)


def hold(*, for_: float, at: float = 0.0, **links: Any) -> Fault:
    """Hold messages back until the end; links: `of`, `from_` and `to`, by default all."""
    return _fault("hold", at=at, for_=for_, **links)


def link(*, for_: float, at: float = 0.0, **model: Any) -> Fault:
    """Make links worse for a time, such as loss=0.9, delay=0.2."""
    return _fault("link", at=at, for_=for_, **model)


def lie(agent: str, *, for_: float, at: float = 0.0, **claim: Any) -> Fault:
    """Let an agent's broadcasts claim what is false, such as says="opposite"."""
    return _fault("lie", agent=agent, at=at, for_=for_, **claim)


def kill(*agents: str, at: float | None = None, rate: float | None = None) -> Fault:
    """Kill agents at a time [s], or one of them at each random time, `rate` per second."""
    return _fault("kill", agents=agents, at=at, rate=rate)


def restart(*agents: str, for_: float, at: float | None = None, rate: float | None = None) -> Fault:
    """Kill agents, and replace them after a time by processes that have received nothing."""
    return _fault("restart", agents=agents, at=at, rate=rate, for_=for_)


def pause(*agents: str, for_: float, at: float | None = None, rate: float | None = None) -> Fault:
    """Suspend agents for a time."""
    return _fault("pause", agents=agents, at=at, rate=rate, for_=for_)


def turn(*agents: str, at: float | None = None, rate: float | None = None) -> Fault:
    """Make agents adversaries that broadcast what they apply."""
    return _fault("turn", agents=agents, at=at, rate=rate)


def hijack(*agents: str, at: float | None = None, rate: float | None = None) -> Fault:
    """Make agents adversaries that broadcast what their own controller would have applied."""
    return _fault("hijack", agents=agents, at=at, rate=rate)


def clock(
    *agents: str, at: float | None = None, rate: float | None = None, for_: float | None = None,
    step: float | None = None, skew: float | None = None, drift: float | None = None,
) -> Fault:  # fmt: skip
    """Trigger samples too late or too early, by one of step, skew [s] and drift."""
    return _fault(
        "clock", agents=agents, at=at, rate=rate, for_=for_, step=step, skew=skew, drift=drift
    )


def sensor(
    *agents: str, for_: float, at: float | None = None, rate: float | None = None,
    silent: Literal[True] | None = None, bias: Mapping[str, float] | None = None,
    noise: Mapping[str, float] | None = None,
) -> Fault:  # fmt: skip
    """Silence sensors, or falsify them by a bias and noise of states, by name."""
    return _fault(
        "sensor", agents=agents, at=at, rate=rate, for_=for_, silent=silent, bias=bias, noise=noise
    )


def actuator(
    *agents: str, for_: float, at: float | None = None, rate: float | None = None
) -> Fault:
    """Let actuators hold the input that they have."""
    return _fault("actuator", agents=agents, at=at, rate=rate, for_=for_)
