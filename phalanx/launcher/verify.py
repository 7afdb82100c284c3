"""Run a recording's scenario again, and find the first place where two trajectories differ."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from phalanx_agent.step import ControlStep, control_steps

from phalanx.faults.commands import CommandPolicy, Orders
from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.engine import (
    DEFAULT_ENGINE,
    EngineError,
    Progress,
    RunOptions,
    execute,
    silent,
)
from phalanx.network.inbox import Claim
from phalanx.recording.read import Recording, read
from phalanx.recording.records import Shown, State, Step
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import build_rows
from phalanx.swarm.seen import SeenStates
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.asked import MistakenMethodError

_INSTANT = 1e-9
"""What makes an event at the very end happen again [s]."""


@dataclass(frozen=True)
class Verification:
    """What came of running a recording's scenario again; true if the trajectory is the same."""

    difference: str | None
    """Where the two first differ, in words; None if they are bit-identical."""
    steps: int
    """Control steps compared."""
    states: int
    """States compared; none of a run in real time."""

    def __bool__(self) -> bool:
        return self.difference is None

    def __str__(self) -> str:
        if self.difference is not None:
            return f"differs: {self.difference}"
        if not self.states:
            return f"bit-identical: {self.steps} decisions, each from what the agent was shown"
        return f"bit-identical: {self.steps} steps and {self.states} states"


def verify(
    recorded: Recording,
    *,
    engine: str = DEFAULT_ENGINE,
    seed: int | None = None,
    progress: Progress = silent,
) -> Verification:
    """Run a recording's scenario and commands again, as far as it goes, and compare.

    Of a run in real time every agent's decisions are made again, and nothing else.

    Raises:
        EngineError: it cannot be run again, breaks though it did not when it was recorded, or
            there is nothing to compare.
        KeyboardInterrupt: it was stopped.
        ValueError: there is no such engine.
    """
    # What the scenario declares happens again by itself.
    commands = CommandPolicy(schedule=tuple(c for c in recorded.commands if c.fault < 0))
    options = RunOptions(engine, progress=progress, commands=commands)
    if not recorded.states and not recorded.shown:
        raise EngineError(f"{recorded.path}: the recording holds no state: nothing to compare")
    if recorded.shown:
        if seed is not None:
            raise EngineError(
                "a run in real time cannot be run again, with another seed or without"
            )
        try:
            decided = _decided_again(recorded)
        except MistakenMethodError as error:
            raise EngineError(f"decided again: {error.told(f'agent {error.agent}')}") from error
        difference = first_difference(recorded, decided)
        return Verification(difference, len(recorded.shown), 0)
    scenario = as_far_as(recorded).model_copy(update={} if seed is None else {"seed": seed})
    with tempfile.TemporaryDirectory(prefix="phalanx-") as folder:
        made = execute(scenario, Path(folder), options)
        if made.outcome is Outcome.STOPPED:
            raise KeyboardInterrupt
        if made.outcome is Outcome.BROKEN and not cut_short(recorded):
            raise EngineError(f"run again, it broke: {made.reason}")
        again = read(Path(folder))
    difference = first_difference(recorded, again)
    return Verification(difference, len(recorded.steps), len(recorded.states))


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


def _decided_again(recorded: Recording) -> Recording:
    """The recording of a run in real time with every step as it is decided now.

    The wall clock does not come back, so the run is not run again. What each agent made of a sample
    and of the inputs that it had received is a function of both, whatever the clock.
    """
    swarm = build_swarm(recorded.scenario)
    rows, states = build_rows(swarm), SeenStates(swarm)
    steps = {s.name: s for name in recorded.scenario.programs() for s in control_steps(rows, name)}
    found = {(step.agent, step.k): place for place, step in enumerate(recorded.steps)}
    again = list(recorded.steps)
    for shown in recorded.shown:
        place = found.get((shown.agent, shown.k))
        if place is not None:
            again[place] = _decided(steps[shown.agent], shown, again[place], states)
    return Recording(recorded.path, recorded.scenario, recorded.metadata, recorded.states, again)


def _decided(step: ControlStep, shown: Shown, recorded: Step, states: SeenStates) -> Step:
    if shown.adversary:
        step.obey(Orders(adversary=True))
    names = step.swarm.names
    seen = tuple(map(names.index, shown.seen))
    x = states.stacked(states.of(np.array(shown.x, dtype="<f8").tobytes(), seen))
    received = {names.index(sender): Claim(since, tuple(u)) for sender, since, u in shown.received}
    result = step.decide(x, seen, shown.t, received)
    return msgspec.structs.replace(
        recorded,
        u=tuple(result.decision.u.tolist()),
        ages=[(names[l], shown.t - received[l].t_apply) for l in result.used],
        **msgspec.structs.asdict(result.report(recorded.solve_time)),
    )


def first_difference(recorded: Recording, again: Recording) -> str | None:
    """Where two runs first differ, in words; None if they are bit-identical.

    What does not belong to the trajectory (solve times, run names) is not compared. A recording
    that was cut short is compared as far as it goes.
    """
    compared = (_state_difference(recorded, again), _step_difference(recorded, again))
    candidates = [found for found in compared if found]
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
