"""The knobs of a search: points of a cube, with choices, become overrides of a scenario.

A table of overrides is all that a search changes, so that each of its runs is a plain scenario.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from phalanx.scenario.agents import AgentGroup
from phalanx.scenario.attack import Attack, FaultBudget, Interval
from phalanx.scenario.load import validate
from phalanx.scenario.model import Scenario, ScenarioError
from phalanx.schema.fields import Distribution
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.dynamics import heading
from phalanx.theory.models.polytope import constant_polytope

Fields = dict[str, Any]
"""Overrides by path."""


class Point(NamedTuple):
    """One setting of all knobs."""

    numbers: tuple[float, ...]
    """In [0, 1]."""
    choices: tuple[int, ...]
    """Index of the possibility chosen, of each choice."""


@dataclass(frozen=True)
class Knobs:
    """Some knobs that belong together."""

    numbers: int
    choices: tuple[int, ...]
    """The number of possibilities of each choice, two at least."""
    fields: Callable[[Sequence[float], Sequence[int]], Fields]
    """(numbers, choices) -> overrides."""


@dataclass(frozen=True)
class Space:
    """All knobs of a search, and the scenario that they turn."""

    table: Fields
    """The scenario's; agents with knobs have groups of their own."""
    knobs: tuple[Knobs, ...]

    @property
    def numbers(self) -> int:
        """The number of knobs that are numbers."""
        return sum(knob.numbers for knob in self.knobs)

    @property
    def choices(self) -> tuple[int, ...]:
        """The number of possibilities of each choice."""
        return tuple(count for knob in self.knobs for count in knob.choices)

    def overrides(self, point: Point) -> Fields:
        """Return the fields that a point sets, by path."""
        overrides, faults = Fields(), list(self.table.get("faults", ()))
        ends = accumulate((len(knob.choices) for knob in self.knobs), initial=0)
        begins = accumulate((knob.numbers for knob in self.knobs), initial=0)
        for knob, number, choice in zip(self.knobs, begins, ends, strict=False):
            numbers = point.numbers[number : number + knob.numbers]
            fields = knob.fields(numbers, point.choices[choice : choice + len(knob.choices)])
            faults += fields.pop("faults", [])
            overrides.update(fields)
        return overrides | ({"faults": faults} if faults else {})


def space_of(table: Mapping[str, Any], source: str = "scenario") -> Space:
    """Return the knobs that a scenario's [attack] table declares.

    Raises ScenarioError: the scenario is not valid, a path names no field, or there is no knob.
    """
    scenario = validate(table, source)
    attack = scenario.attack or Attack()
    separate = separated(table, scenario, {*attack.starts, *attack.scripts})
    groups = validate(separate, source).agents
    path_of = {name: f"agents.{g}" for g, group in enumerate(groups) for name in group.names}
    by_name = {name: group for group in groups for name in group.names}
    knobs = [_varied(path, distribution) for path, distribution in attack.vary.items()]
    knobs += [_start(path_of[name], box) for name, box in attack.starts.items()]
    knobs += [
        _script(path_of[name], by_name[name], pieces, scenario.duration)
        for name, pieces in attack.scripts.items()
    ]
    if attack.faults is not None:
        knobs += [_fault(attack.faults, scenario) for _ in range(attack.faults.most)]
    if not any(knob.numbers or max(knob.choices, default=1) > 1 for knob in knobs):
        raise ScenarioError(f"{source}: attack: expected knobs: vary, starts, scripts or faults")
    del separate["attack"]
    return Space(separate, tuple(knobs))


def separated(table: Mapping[str, Any], scenario: Scenario, names: set[str]) -> Fields:
    """Return a scenario's table in which each of these agents has a group of its own."""
    groups: list[Fields] = []
    for written, group in zip(table["agents"], scenario.named(), strict=True):
        whole = {key: value for key, value in dict(written).items() if key != "count"}
        if not names & {*group.names} or group.size == 1:
            groups.append({**whole, "names": list(group.names)})
            continue
        for member, name in enumerate(group.names):
            of_member = {
                field: [list(whole[field])[member]]
                for field in ("slots", "goal", "start")
                if whole.get(field)
            }
            groups.append({**whole, **of_member, "names": [name]})
    return {**table, "agents": groups}


def rounded(value: Any) -> Any:
    """Return a number with four digits, which a person can read; others as they are."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


def _varied(path: str, of: Distribution) -> Knobs:
    if of.choice is not None:
        values = of.choice
        if len(values) == 1:
            return Knobs(0, (), lambda _, __: {path: values[0]})
        return Knobs(0, (len(values),), lambda _, chosen: {path: values[chosen[0]]})
    return Knobs(1, (), lambda numbers, _: {path: rounded(of.at(numbers[0]))})


def _start(group: str, box: Sequence[Interval]) -> Knobs:
    free = [state for state, (low, high) in enumerate(box) if low < high]

    def fields(numbers: Sequence[float], _: Sequence[int]) -> Fields:
        start = [low for low, _ in box]
        for state, number in zip(free, numbers, strict=True):
            low, high = box[state]
            start[state] = rounded(low + number * (high - low))
        return {f"{group}.start": [start], f"{group}.spread": []}

    return Knobs(len(free), (), fields)


def _script(path: str, group: AgentGroup, pieces: int, duration: float) -> Knobs:
    """Make the knobs of constant inputs: for each, the distance from U's center in a direction."""
    dynamics = group.dynamics_object()
    x = ca.SX.sym("x", len(dynamics.states))
    polytope = constant_polytope(*dynamics.input_polytope(x))
    if polytope is None:
        raise ScenarioError(f"attack: scripts.{group.names[0]}: expected inputs in a constant U")
    low, high = polytope.corners.min(axis=0), polytope.corners.max(axis=0)
    center, size = polytope.corners.mean(axis=0), len(dynamics.inputs)
    at = [rounded(duration * piece / pieces) for piece in range(pieces)]

    def admissible(numbers: Sequence[float]) -> list[float]:
        step = low + np.array(numbers) * (high - low) - center
        beyond = float(((polytope.A @ step) / (polytope.b - polytope.A @ center)).max())
        u: list[float] = (center + step / max(1.0, beyond)).tolist()
        short = [float(f"{value:.3g}") for value in u]
        return short if polytope.takes(short) else u  # at a face of U it may be rounded outwards

    def fields(numbers: Sequence[float], _: Sequence[int]) -> Fields:
        inputs = [admissible(numbers[k * size : (k + 1) * size]) for k in range(pieces)]
        return {f"{path}.law": {"type": "script", "at": at, "inputs": inputs}}

    return Knobs(pieces * size, (), fields)


def _fault(budget: FaultBudget, scenario: Scenario) -> Knobs:
    """Make the knobs of one fault, or of none: kind, agent, begin, duration and strength."""
    normal = [name for name, group, _ in scenario.roster() if group.role == "normal"]
    agents = budget.agents or tuple(normal)
    facts = {name: group.facts for name, group, _ in scenario.roster()}

    def fields(numbers: Sequence[float], choices: Sequence[int]) -> Fields:
        kind, name = choices[0], agents[choices[1] if len(choices) > 1 else 0]
        if kind == 0:
            return {}
        begin, lasts, strength = numbers
        at = rounded(begin * 0.95 * scenario.duration)
        span = rounded(max(0.01, lasts * min(budget.longest, scenario.duration)))
        state = facts[name].states[0]
        return {"faults": [_fault_table(budget.kinds[kind - 1], name, at, span, strength, state)]}

    several = (len(agents),) if len(agents) > 1 else ()
    return Knobs(3, (1 + len(budget.kinds), *several), fields)


_SAYS: tuple[Fields, ...] = ({"says": "opposite"}, {"says": "zero"}, {"equivocate": True},
    {"replay": 50}, {"silent": True})  # fmt: skip


def _fault_table(
    kind: str, name: str, at: float, span: float, strength: float, state: str
) -> Fields:
    """Return an entry of `faults` for one agent; strength is in [0, 1], state the agent's first."""
    time = {"at": at, "for": span}
    table = {"kind": kind, "agents": [name], **time}
    match kind:
        case "lie":
            says = _SAYS[min(int(strength * len(_SAYS)), len(_SAYS) - 1)]
            return {"kind": kind, "agent": name, **time, **says}
        case "loss":
            return {"kind": "link", "from": name, **time, "loss": rounded(0.5 + 0.5 * strength)}
        case "hold":
            return {"kind": kind, "from": name, **time}
        case "partition":
            return {"kind": kind, "groups": [[name]], **time}
        case "clock":
            return {**table, "drift": rounded(0.1 + 4.0 * strength)}
        case "sensor":
            return {**table, "bias": {state: rounded(2.0 * strength - 1.0)}}
        case "kill" | "turn":
            del table["for"]
    return table


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
