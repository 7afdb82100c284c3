"""What a recording says of each agent: where it was, and which inputs its actuator held."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from phalanx.arrays import Array
from phalanx.certify.checker.intervals import UncertifiableError, UndecidedError
from phalanx.theory.safety.composition import Member


class StateRecord(Protocol):
    """The true state at an event: a sample taken or an input applied."""

    t: float
    x: list[float]


class StepRecord(Protocol):
    """An input that took effect at t_apply."""

    agent: str
    t_apply: float
    u: tuple[float, ...]


class HeldInputs(NamedTuple):
    """What one agent's actuator held, input after input."""

    t: Array
    """Since when [s], shape (s,)."""
    until: Array
    """[s], shape (s,)."""
    u: Array
    """shape (m, s)"""


def track(states: Sequence[StateRecord], n: int) -> tuple[Array, Array]:
    """Times, shape (e,), and states, shape (n, e). Raises UncertifiableError."""
    if not states or any(len(state.x) != n for state in states):
        raise UncertifiableError(f"expected states of {n} components")
    times = np.array([s.t for s in states])
    x = np.empty((n, len(states)))
    for k, state in enumerate(states):
        x[:, k] = state.x
    if times[0] < 0.0 or not (np.diff(times) >= 0.0).all() or not np.isfinite(x).all():
        raise UncertifiableError("expected finite states in order from t = 0 on")
    return times, x


def inputs_of(
    members: Sequence[Member], times: Array, steps: Sequence[StepRecord]
) -> list[HeldInputs]:
    """What each member's actuator held: zeros until its first input.

    Raises UncertifiableError, or UndecidedError where states are missing.
    """
    of: dict[str, list[StepRecord]] = {member.name: [] for member in members}
    for step in steps:
        of[step.agent].append(step)
    return [_held(member, times, of[member.name]) for member in members]


def _held(member: Member, times: Array, steps: Sequence[StepRecord]) -> HeldInputs:
    m = len(member.dynamics.inputs)
    own = sorted(steps, key=lambda step: step.t_apply)
    if any(len(step.u) != m for step in own):
        raise UncertifiableError(f"expected inputs of {m} components of agent {member.name}")
    t, u = [step.t_apply for step in own], [step.u for step in own]
    if not t or t[0] > times[0]:
        t, u = [float(times[0]), *t], [(0.0,) * m, *u]
    since = np.array(t)
    if not np.isin(since, times).all():
        raise UndecidedError(
            f"agent {member.name} applied an input in a state not recorded: record one at every "
            "event, time.recording_step = 0"
        )
    return HeldInputs(since, np.append(since[1:], times[-1]), np.array(u).reshape(-1, m).T)
