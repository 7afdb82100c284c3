"""Faults as objects: each function makes one entry of [[faults]], with the fields of its table.

A field `for` is `for_` here, since Python has a word of that name. Faults of agents have `at`, the
time [s], or `rate` [1/s], by which one of the agents is hit at each random time; without names they
are of all agents. Each raises ValueError if a field is wrong. See docs/network-faults.md.
"""

from collections.abc import Sequence
from typing import Any

from pydantic import TypeAdapter

from phalanx.faults.fault import Fault
from phalanx.scenario.declared import AnyFault

_FAULT: TypeAdapter[Fault] = TypeAdapter(AnyFault)


def table_of(fault: Fault) -> dict[str, Any]:
    """Return a fault's table, as a scenario's file has it."""
    return fault.model_dump(mode="json", by_alias=True, exclude_unset=True)


def _fault(kind: str, **fields: Any) -> Fault:
    fault = {name.rstrip("_"): value for name, value in fields.items()}
    return _FAULT.validate_python({"kind": kind, **fault})


def partition(*groups: Sequence[str], for_: float, **fields: Any) -> Fault:
    """Cut the links between groups of agents; all agents in no group form one more.

    shape: in place of groups, agents that stay connected are drawn.
    """
    return _fault("partition", groups=groups, for_=for_, **fields)


def hold(*, for_: float, **fields: Any) -> Fault:
    """Hold messages back until the end; links: `of`, `from_` and `to`, by default all."""
    return _fault("hold", for_=for_, **fields)


def link(*, for_: float, **fields: Any) -> Fault:
    """Make links worse for a time, such as loss=0.9, delay=0.2."""
    return _fault("link", for_=for_, **fields)


def lie(agent: str, *, for_: float, **fields: Any) -> Fault:
    """Let an agent's broadcasts claim what is false, such as says="opposite"."""
    return _fault("lie", agent=agent, for_=for_, **fields)


def kill(*agents: str, **fields: float) -> Fault:
    """Kill agents."""
    return _fault("kill", agents=agents, **fields)


def restart(*agents: str, for_: float, **fields: float) -> Fault:
    """Kill agents, and replace them after a time by processes that have received nothing."""
    return _fault("restart", agents=agents, for_=for_, **fields)


def pause(*agents: str, for_: float, **fields: float) -> Fault:
    """Suspend agents for a time."""
    return _fault("pause", agents=agents, for_=for_, **fields)


def turn(*agents: str, **fields: float) -> Fault:
    """Make agents adversaries that broadcast what they apply."""
    return _fault("turn", agents=agents, **fields)


def hijack(*agents: str, **fields: float) -> Fault:
    """Make agents adversaries that broadcast what their own controller would have applied."""
    return _fault("hijack", agents=agents, **fields)


def clock(*agents: str, **fields: float) -> Fault:
    """Trigger samples too late or too early, by one of step, skew [s] and drift."""
    return _fault("clock", agents=agents, **fields)


def sensor(*agents: str, for_: float, **fields: Any) -> Fault:
    """Silence sensors, or falsify them by `bias` and `noise` of states, by name."""
    return _fault("sensor", agents=agents, for_=for_, **fields)


def actuator(*agents: str, for_: float, **fields: float) -> Fault:
    """Let actuators hold the input that they have."""
    return _fault("actuator", agents=agents, for_=for_, **fields)
