"""Whether recorded states and steps are of the recorded scenario: readers rely on their sizes."""

from collections.abc import Iterable

from phalanx.faults.commands import Command
from phalanx.recording.records import Shown, State, Step
from phalanx.scenario.model import Scenario


def misfit(
    scenario: Scenario,
    states: Iterable[State],
    steps: Iterable[Step],
    shown: Iterable[Shown] = (),
    commands: Iterable[Command] = (),
) -> str | None:
    """The first record that is none of this scenario's, in words; None if all are."""
    dynamics = {name: group.dynamics_object() for name, group, _ in scenario.roster()}
    width = sum(len(found.states) for found in dynamics.values())
    inputs = {name: len(found.inputs) for name, found in dynamics.items()}
    for state in states:
        if len(state.x) != width:
            return f"a state at t = {state.t:.3f} s of {len(state.x)} numbers, expected {width}"
    for step in steps:
        if not _fits(step, inputs):
            return f"a step of agent {step.agent!r} at t = {step.t:.3f} s with wrong fields"
    sizes = {name: len(found.states) for name, found in dynamics.items()}
    for each in shown:
        if not _could_be_shown(each, sizes, inputs):
            return f"what agent {each.agent!r} was shown at t = {each.t:.3f} s has wrong fields"
    for command in commands:
        if command.effect and command.agent not in dynamics:
            return f"a command at t = {command.t:.3f} s to {command.agent!r}, which is no agent"
    return None


def _fits(step: Step, inputs: dict[str, int]) -> bool:
    size = inputs.get(step.agent)
    told = [sender for sender, *_ in (*step.ages, *step.fates, *step.faults, *step.false)]
    return (
        len(step.u) == size
        and len(step.u_nom) in (0, size)
        and inputs.keys() >= set(told)
        and all(len(u) == inputs[sender] for sender, _, _, u in step.false)
    )


def _could_be_shown(shown: Shown, sizes: dict[str, int], inputs: dict[str, int]) -> bool:
    in_order = [name for name in sizes if name in shown.seen]
    return (
        shown.agent in in_order
        and shown.seen == in_order
        and len(shown.x) == sum(sizes[name] for name in in_order)
        and all(len(u) == inputs.get(sender) for sender, _, u in shown.received)
    )
