"""Runs that the loop can make, and why it cannot make others."""

import ctypes
from collections.abc import Iterator, Sequence

from phalanx.native.loop.goals import goal_table
from phalanx.native.loop.laws import KNOWN
from phalanx.native.loop.memory import MOST_AGENTS
from phalanx.native.loop.rules import MOST_DECLARED, has_entries
from phalanx.network.link import Stage
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.user_methods import is_built_in
from phalanx.theory.rows.information import InFlight, Paper, Split, WorstCase

_MOST_CHOSEN = 6
"""Inputs of an agent: least_violation.c has one coordinate more."""


def reason_against(rows: SafetyRows) -> str | None:
    """Return why a run is not eligible, in words; None if it is."""
    return next(_reasons(rows), None)


def _reasons(rows: SafetyRows) -> Iterator[str]:
    swarm = rows.swarm
    scenario, safety, every = swarm.scenario, swarm.safety, range(len(swarm.members))
    if ctypes.sizeof(ctypes.c_void_p) != 8:
        yield "the machine's addresses have not 64 bits"
    if scenario.world is not None:
        yield "it has a world of its own"
    if scenario.faults:
        yield "it declares faults"
    if scenario.reseed:
        yield "its seed changes"
    if len(every) > MOST_AGENTS:
        yield f"it has more than {MOST_AGENTS} agents"
    if safety.centralised or swarm.controllers or any(g.filter for g in swarm.groups):
        yield "some agents have a controller of their own, or one for all"
    if safety.modes:
        yield "agents prove, watch or keep a fallback"
    if swarm.by_radio:
        yield "agents know one another by radio"
    if type(swarm.information()) not in (Paper, InFlight, WorstCase, Split):
        yield "its information model is not one of paper, in-flight, worst-case and split"
    polytopes = rows.composed.members.constant_polytopes
    if any(l not in polytopes or polytopes[l].box is None for l in every):
        yield "the inputs of some agents have other bounds than constant ones"
    yield from _of_agents(swarm)
    if len(swarm.links.declared) > MOST_DECLARED or not all(map(has_entries, _models(swarm))):
        yield "a link has rules that the loop has not"


def _models(swarm: Swarm) -> Iterator[Sequence[Stage]]:
    """Yield the rules of each link on which something is sent."""
    for i, receiver in enumerate(swarm.names):
        for j in swarm.heard_by(i):
            yield swarm.links.model(swarm.names[j], receiver).stages


def _of_agents(swarm: Swarm) -> Iterator[str]:
    links = swarm.links
    for i, (name, group) in enumerate(zip(swarm.names, swarm.groups, strict=True)):
        reference, law = swarm.goal(i).reference, group.law_object()
        if not (is_built_in(law) and isinstance(law, KNOWN)):
            yield f"the law of {name} is not one that the loop has"
        if not is_built_in(reference) or goal_table(reference, group.axes) is None:
            yield f"the goal of {name} is not one that the loop has"
        if group.disturbance.kind == "adverse":
            yield f"the disturbance of {name} follows the state"
        if links.model(name, name, "sample").stages or links.model(name, name, "actuation").stages:
            yield f"links on board {name} have rules"
        if len(swarm.members[i].dynamics.inputs) > _MOST_CHOSEN:
            yield f"{name} has more than {_MOST_CHOSEN} inputs"
