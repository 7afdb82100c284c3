"""Knobs for a scenario that declares none: within the bounds of a guarantee, or beyond them."""

import math
from collections.abc import Mapping
from typing import Any

from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.dynamics import heading

WITHIN, BEYOND = "within", "beyond"
_AROUND = 5.0
"""Half-width of the box around an adversary's start [m]."""
_POSITIONS = {"x", "y", "z", "px", "py", "pz"}
_GAINS = 5.0
"""Largest factor on a law's gain."""
_LINKS = ["lie", "loss", "hold", "partition"]
_ROBOTS = ["pause", "kill", "turn", "clock", "sensor", "actuator"]


def preset(name: str, scenario: Scenario) -> dict[str, Any]:
    """Return an [attack] table for a resolved scenario.

    - within: adversaries' starts and gains, how disturbances act, and for rows that count on
      received inputs lies and worse links. Nothing that voids sampling, φ, U or clocks.
    - beyond: also one fault of a normal robot, its clock or its sensors.

    Raises ScenarioError.
    """
    swarm = build_swarm(scenario)
    x, parts = swarm.start(), swarm.safe_set.parts
    starts, vary = {}, dict[str, Any]()
    for i, member in enumerate(swarm.members):
        if member.adversary:
            turns, start = heading(member.dynamics), x[parts[i]].tolist()
            named_states = enumerate(zip(member.dynamics.states, start, strict=True))
            starts[member.name] = [_interval(*state, turns=k == turns) for k, state in named_states]
    declared = scenario.attack
    alone = {*starts, *declared.starts, *declared.scripts} if declared else {*starts}
    for g, group in enumerate(_separate(scenario, alone)):
        if group.role == "adversary":
            vary |= {f"agents.{g}.law.{path}": _gain(v) for path, v in _gains(group.law)}
        if group.disturbance.bound > 0.0:
            vary[f"agents.{g}.disturbance.kind"] = {"choice": ["random", "adverse"]}
    kinds = _LINKS if scenario.safety.information_model.counts_on_received else []
    kinds = kinds + (_ROBOTS if name == BEYOND else [])
    budget = {"faults": {"most": 1, "kinds": kinds}} if kinds else {}
    return {"starts": starts, "vary": vary, **budget}


def _separate(scenario: Scenario, names: set[str]) -> list[Any]:
    """Return the groups of space_of's table: those of these agents are split."""
    return [
        group
        for group in scenario.named()
        for _ in (group.names if names & {*group.names} else (group,))
    ]


def _interval(state: str, value: float, turns: bool) -> list[float]:
    if state in _POSITIONS:
        return [round(value - _AROUND, 2), round(value + _AROUND, 2)]
    if turns:
        return [-math.pi, math.pi]
    return [value, value]


def _gains(law: Mapping[str, Any]) -> list[tuple[str, float]]:
    gains = [("gain", law["gain"])] if "gain" in law else []
    return gains + [(f"gains.{k}", gain) for k, gain in enumerate(law.get("gains", ()))]


def _gain(value: float) -> dict[str, list[float]]:
    return {"log-uniform": [value / _GAINS, value * _GAINS]}
