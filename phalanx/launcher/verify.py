"""Run a recording's scenario again, and find the first place where two trajectories differ."""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.launch import launch, new_folder
from phalanx.recording.read import Recording, read
from phalanx.recording.records import State, Step
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import build_swarm
from phalanx.wire.messages import Status
from phalanx.wire.session import free_endpoint

_INSTANT = 1e-9
"""What makes an event at the very end happen again [s]."""


def run_again(
    scenario: Scenario, report: Callable[[Status], None], policy: CommandPolicy = NO_COMMANDS
) -> Recording:
    """Run a scenario in a folder that does not stay. Raises LaunchError."""
    with tempfile.TemporaryDirectory(prefix="phalanx-") as parent:
        folder = new_folder(Path(parent), scenario.name)
        launch(scenario, folder, free_endpoint(), report, policy=policy)
        return read(folder)


def cut_short(recorded: Recording) -> bool:
    """Whether a recording ends before its scenario does: damaged, stopped or broken."""
    summary = recorded.summary
    ended = summary is not None and summary.outcome not in (Outcome.STOPPED, Outcome.BROKEN)
    return recorded.damage is not None or not ended


def as_far_as(recorded: Recording) -> Scenario:
    """The recording's scenario, no longer than it lasted."""
    scenario = recorded.scenario
    if not (cut_short(recorded) and recorded.states):
        return scenario
    reached = min(scenario.duration, recorded.states[-1].t + _INSTANT)
    return scenario.model_copy(update={"duration": reached})


def first_difference(recorded: Recording, again: Recording) -> str | None:
    """Where two runs first differ, in words; None if they are bit-identical.

    What does not belong to the trajectory (solve times, run names) is not compared. A recording
    that was cut short is compared as far as it goes.
    """
    candidates = [
        found
        for found in (_state_difference(recorded, again), _step_difference(recorded, again))
        if found
    ]
    if candidates:
        return min(candidates, key=lambda found: found[0])[1]
    cut = cut_short(recorded)
    if len(recorded.steps) != len(again.steps) and not cut:
        return f"{len(recorded.steps)} steps recorded, {len(again.steps)} the second time"
    if len(recorded.states) != len(again.states) and not cut:
        return f"{len(recorded.states)} states recorded, {len(again.states)} the second time"
    return None


def _state_difference(recorded: Recording, again: Recording) -> tuple[float, str] | None:
    names = _component_names(recorded.scenario)
    for index, (a, b) in enumerate(zip(recorded.states, again.states, strict=False)):
        if a == b:
            continue
        what = _first_field(a, b, {"x": names})
        return a.t, f"state {index} at t = {a.t:.6f} s: {what}"
    return None


def _step_difference(recorded: Recording, again: Recording) -> tuple[float, str] | None:
    inputs = {
        m.name: [f"u.{name}" for name in m.dynamics.inputs]
        for m in build_swarm(recorded.scenario).members
    }
    for index, (a, b) in enumerate(zip(recorded.steps, again.steps, strict=False)):
        b.solve_time = a.solve_time  # wall time
        if a == b:
            continue
        what = _first_field(a, b, {"u": inputs.get(a.agent, [])})
        return a.t, f"step {index}, agent {a.agent}, k = {a.k}, t = {a.t:.6f} s: {what}"
    return None


def _component_names(scenario: Scenario) -> list[str]:
    members = build_swarm(scenario).members
    return [f"agent {m.name} {state}" for m in members for state in m.dynamics.states]


def _first_field(a: State | Step, b: State | Step, components: dict[str, list[str]]) -> str:
    """The first field of two records that differs, with both values and how far they are apart."""
    for field in a.__struct_fields__:
        old, new = getattr(a, field), getattr(b, field)
        if old == new:
            continue
        if field in components and len(old) == len(new):
            at = next(i for i, (p, q) in enumerate(zip(old, new, strict=True)) if p != q)
            return f"{components[field][at]} recorded {_versus(old[at], new[at])}"
        return f"{field} recorded {_versus(old, new)}"
    return "equal"  # unreachable: the caller saw a difference


def _versus(old: object, new: object) -> str:
    text = f"{old!r}, again {new!r}"
    if isinstance(old, float) and isinstance(new, float):
        text += f" ({_ulps(old, new)} steps of float64 apart)"
    return text


def _ulps(a: float, b: float) -> int:
    """How many float64 numbers lie between a and b, plus one."""

    def rank(value: float) -> int:
        bits = int(np.float64(value).view(np.int64))
        return bits if bits >= 0 else -(bits & 0x7FFF_FFFF_FFFF_FFFF)

    return abs(rank(a) - rank(b))
