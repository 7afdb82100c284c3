"""Repeat a recorded run, and find the first difference between the two trajectories."""

import shlex
import tempfile
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from phalanx_agent.step import ControlStep, control_steps

from phalanx.faults.commands import ActiveCommands, CommandPolicy
from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.engine import (
    DEFAULT_ENGINE,
    EngineError,
    Progress,
    RunOptions,
    execute,
    silent,
)
from phalanx.launcher.run import Run
from phalanx.network.inbox import AnnouncedInput, Statement
from phalanx.recording.read import Recording, read
from phalanx.recording.records import State, Step, StepData
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import build_rows
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.user_methods import MistakenMethodError

INSTANT = 1e-9
"""Added to the duration so that an event at the very end happens again [s]."""


@dataclass(frozen=True)
class Verification:
    """The result of repeating a recorded run; true if the trajectory is bit-identical."""

    difference: str | None
    """The first difference, in words; None if the two are bit-identical."""
    steps: int
    """Control steps compared."""
    states: int
    """States compared; 0 for a run in real time."""

    def __bool__(self) -> bool:
        return self.difference is None

    def __str__(self) -> str:
        if self.difference is not None:
            return f"differs: {self.difference}"
        if not self.states:
            return f"bit-identical: {self.steps} decisions, each from what the agent was shown"
        return f"bit-identical: {self.steps} steps and {self.states} states"


def verify(
    run: Run | Recording | str | Path,
    *,
    engine: str = DEFAULT_ENGINE,
    progress: Progress = silent,
    trust: bool = False,
) -> Verification:
    """Run a recording's scenario and commands again and compare the trajectories bit by bit.

    Of a run in real time only the agents' decisions are computed again. A recording that was cut
    short is compared up to its last state.

    Args:
        run: a finished run, its recording, or its folder.
        engine: the engine to run it on.
        progress: as run takes it.
        trust: as open takes it.

    Raises:
        UnreadableRecordingError: there is no recording, or none that can be read.
        EngineError: it cannot be run again, breaks though it did not when it was recorded, or
            holds nothing to compare.
        ValueError: there is no such engine.
        KeyboardInterrupt: the run was stopped.
    """
    recorded = run.recording if isinstance(run, Run) else run
    if not isinstance(recorded, Recording):
        recorded = read(Path(recorded), trust)
    options = RunOptions(engine, progress=progress, commands=commands_of(recorded))
    if not recorded.states and not recorded.step_data:
        raise EngineError(f"{recorded.path}: the recording holds no state: nothing to compare")
    world = recorded.scenario.fresh_world()
    if world is not None and world.determinism == "none" and not recorded.step_data:
        raise EngineError("its world declares no determinism: a run in it cannot be run again")
    if recorded.step_data:
        try:
            decided = _decided_again(recorded)
        except MistakenMethodError as error:
            raise EngineError(f"decided again: {error}") from error
        difference = first_difference(recorded, decided)
        return Verification(difference, len(recorded.step_data), 0)
    with tempfile.TemporaryDirectory(prefix="phalanx-") as folder:
        summary = execute(_until_its_end(recorded), Path(folder), options)
        if summary.outcome is Outcome.STOPPED:
            raise KeyboardInterrupt
        if summary.outcome is Outcome.BROKEN and not cut_short(recorded):
            raise EngineError(f"run again, it broke: {summary.reason}")
        again = read(Path(folder))
    difference = first_difference(recorded, again)
    if difference is not None and world is not None and world.determinism == "build":
        difference += "; its world promises the same bits on one build and CPU alone"
    return Verification(difference, len(recorded.steps), len(recorded.states))


def cut_short(recorded: Recording) -> bool:
    """Return whether a recording ends before its scenario: damaged, stopped or broken."""
    summary = recorded.summary
    ended = summary is not None and summary.outcome not in (Outcome.STOPPED, Outcome.BROKEN)
    return recorded.damage is not None or not ended


def _until_its_end(recorded: Recording) -> Scenario:
    """Return the recording's scenario, shortened to the time of its last state."""
    if not (cut_short(recorded) and recorded.states):
        return recorded.scenario
    return shortened(recorded.scenario, recorded.states[-1].t)


def shortened(scenario: Scenario, t: float) -> Scenario:
    """Return a scenario that ends just after t [s], or at its end."""
    reached = min(scenario.duration, t + INSTANT)
    reseed = tuple(reseeding for reseeding in scenario.reseed if reseeding.at < reached)
    return scenario.model_copy(update={"duration": reached, "reseed": reseed})


def commands_of(recorded: Recording) -> CommandPolicy:
    """Return a run's commands, to be given again; faults that it declares happen without one."""
    return CommandPolicy(schedule=tuple(c for c in recorded.commands if c.fault < 0))


def _decided_again(recorded: Recording) -> Recording:
    """Return the recording of a run in real time with every step decided again.

    The wall clock cannot be repeated, so the run cannot either. But each decision is a function of
    the sample and of the received inputs, which are recorded.
    """
    swarm = build_swarm(recorded.scenario)
    if swarm.by_radio and any(swarm.links.lies(name).declared for name in swarm.names):
        raise EngineError("of a run in real time no false states that were relayed are recorded")
    rows, states = build_rows(swarm), StateCodec(swarm)
    steps = {s.name: s for name in recorded.scenario.programs() for s in control_steps(rows, name)}
    index_of_step = {(step.agent, step.k): index for index, step in enumerate(recorded.steps)}
    again, stated = list(recorded.steps), dict[tuple[str, float], Statement]()
    for sample in recorded.step_data:
        index = index_of_step.get((sample.agent, sample.k))
        if index is not None:
            step = steps[sample.agent]
            again[index] = _decided(step, sample, again[index], states, stated)
    return Recording(recorded.path, recorded.scenario, recorded.metadata, recorded.states, again)


def _decided(
    step: ControlStep, sample: StepData, recorded: Step, states: StateCodec,
    stated: dict[tuple[str, float], Statement],
) -> Step:  # fmt: skip
    """Return a step decided again.

    stated: by radio, each agent's true statements so far by their t_apply; this one is added.
    """
    if sample.adversary:
        step.apply_commands(ActiveCommands(adversary=True))
    names = step.swarm.names
    visible = tuple(map(names.index, sample.seen))
    x = states.unpack(np.array(sample.x, dtype="<f8").tobytes(), visible)
    peers = {names[l] for l in step.swarm.peers(step.i)}
    if unknown := [one for one in sample.received if one[0] in peers and one[:2] not in stated]:
        raise EngineError(f"agent {step.name} received what agent {unknown[0][0]} never stated")
    received = {
        names.index(sender): stated.get((sender, since), AnnouncedInput(since, tuple(u)))
        for sender, since, u in sample.received
    }
    result = step.decide(x, visible, sample.t, received)
    if peers:
        u, t_apply = tuple(result.decision.u.tolist()), sample.t + step.swarm.time.latency
        state = tuple(x[step.swarm.safe_set.parts[step.i]].tolist())
        z = state if result.reference is None else tuple(result.reference.tolist())
        stated[step.name, t_apply] = Statement(
            sender=step.i, k=sample.k, t_apply=t_apply, u=u, t=sample.t, x=state, z=z
        )
    return msgspec.structs.replace(
        recorded,
        u=tuple(result.decision.u.tolist()),
        ages=[(names[l], sample.t - received[l].t_apply) for l in result.used],
        **msgspec.structs.asdict(result.report(recorded.solve_time)),
    )


def first_difference(recorded: Recording, again: Recording) -> str | None:
    """Describe the first difference of two runs; None if they are bit-identical.

    Solve times and run names are not compared: they are not part of the trajectory. A recording
    that was cut short is compared up to its end.
    """
    members, differences = build_swarm(recorded.scenario).members, []
    states = [f"agent {m.name} {state}" for m in members for state in m.dynamics.states]
    programs = {name: group.program for name, group, _ in recorded.scenario.roster()}
    inputs = {m.name: [f"u.{name}" for name in m.dynamics.inputs] for m in members}
    for n, (old, new) in enumerate(zip(recorded.states, again.states, strict=False)):
        if old != new:
            words = _first_field(old, new, "x", states)
            differences.append((old.t, f"state {n} at t = {old.t:.6f} s: {words}"))
            break
    for n, (a, b) in enumerate(zip(recorded.steps, again.steps, strict=False)):
        b.solve_time = a.solve_time  # wall time
        if a != b:
            where = f"step {n}, agent {a.agent}, k = {a.k}, t = {a.t:.6f} s"
            words = f"{where}: {_first_field(a, b, 'u', inputs.get(a.agent, []))}"
            if (program := programs[a.agent]) and (a.u, a.u_nom) != (b.u, b.u_nom):
                words += f": its program, {shlex.join(program)}, is not deterministic"
            differences.append((a.t, words))
            break
    if differences:
        return min(differences, key=lambda difference: difference[0])[1]
    counts = [
        ("steps", len(recorded.steps), len(again.steps)),
        ("states", len(recorded.states), len(again.states)),
    ]
    for kind, first, second in counts if not cut_short(recorded) else ():
        if first != second:
            return f"{first} {kind} recorded, {second} the second time"
    return None


def _first_field(a: State | Step, b: State | Step, vector: str, components: list[str]) -> str:
    """Describe the first field in which two records differ, and the component of the vector."""
    for field in a.__struct_fields__:
        old, new = getattr(a, field), getattr(b, field)
        if old == new:
            continue
        if field == vector and components and len(old) == len(new):
            at = next(i for i, (p, q) in enumerate(zip(old, new, strict=True)) if p != q)
            field, old, new = components[at], old[at], new[at]
        text = f"{field} recorded {old!r}, again {new!r}"
        if isinstance(old, float) and isinstance(new, float):
            text += f" ({_ulps(old, new)} steps of float64 apart)"
        return text
    raise AssertionError("the records are equal")


def _ulps(a: float, b: float) -> int:
    """Return the distance of a and b in steps of float64."""
    bits = np.array([a, b]).view(np.int64).tolist()
    first, second = (n if n >= 0 else -(n & 0x7FFF_FFFF_FFFF_FFFF) for n in bits)
    return abs(int(first - second))
