"""The least change of a field that would let an agent apply its wish, found at one control step.

A change is a share s of the way from the field's value to its end, such as 0 for a bound on φ. The
agent's own controller decides the step again under it; bisection finds the least s that frees it.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario, to_json
from phalanx.swarm.radio import gain
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.exact import length
from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx_explain.repetition import ControllerSteps

_EXACT = 0.02
"""Precision of a change, relative to it: the least that frees is not less."""
_LEAST = 1e-6
"""Smallest change that is looked for, as a share of the way."""
_FREE = 1e-9
"""Distance of an input from its wish below which it is the wish, relative to the wish."""


class Field(NamedTuple):
    """A field that a user may change, and the price of that."""

    path: str
    """Within the scenario, or within each group of agents if it begins with agents."""
    end: float
    """Times its value: how far it may change."""
    price: str


FIELDS = (
    Field("safety.alpha", 20.0, "gaps may close faster; a given margin must hold for it"),
    Field("safety.function.radius", 0.05, "others may come nearer"),
    Field("safety.eta", 0.0, "a smaller margin than the paper's constants give proves nothing"),
    Field("agents.clock", 0.05, "more and more exact samples, and broadcasts, a second"),
    Field("agents.clock.jitter", 0.0, "void if clocks are less exact"),
    Field("agents.disturbance.bound", 0.0, "void if disturbances are larger"),
    Field("agents.dynamics.speed", 0.05, "slower robots; void if an attacker is faster"),
    Field("agents.dynamics.wheel_rate", 0.05, "slower robots; void if an attacker is faster"),
    Field("agents.dynamics.acceleration", 20.0, "needs robots that brake as hard"),
    Field("agents.sensing", 0.05, "who is farther is not seen: proven only as far as it then is"),
    Field("safety.neighbourhood", 0.05, "who is farther is not seen; proven as far as it then is"),
    Field("agents.radio.gain", 20.0, "gaps may close faster; more braking at losses"),
    Field("agents.radio.every", 0.0, "more broadcasts a second"),
)


PAIRS = {
    "safety.composition": "pairs",
    "safety.information": "split",
    "safety.margin": "integrated",
    "safety.eta": 0.0,
}
"""One row for each pair, halves among normal agents, and a margin that is computed and proven."""
_PRICE_OF_PAIRS = "agents have to know who is an adversary"


class Advice(NamedTuple):
    """A change that frees the agent at this step."""

    overrides: dict[str, Any]
    """Values by path, as for --set."""
    price: str
    share: float
    """s: of the way from the present value to the field's end; 1 where there is no way."""

    def __str__(self) -> str:
        values = {
            path: f"{value:.9g}" if isinstance(value, float) else str(value)
            for path, value in self.overrides.items()
        }
        sets = " ".join(f"--set {path}={value}" for path, value in values.items())
        return f"{sets}: {self.price}"


def frees(steps: ControllerSteps, overrides: Mapping[str, Any]) -> bool:
    """Return whether the agent would apply its wish, as far as U_i has it, under these values."""
    table = json.loads(to_json(steps.rows.swarm.scenario))
    for group in table["agents"]:  # wishes are known: no program is to be started again
        group |= {"program": [], "filter": False, "keeps": None, "protocol": "stdio"}
    try:
        rows = build_rows(build_swarm(load(table, overrides)))
        other = steps.under(rows)
        wish, result = other.wish, other.result
    except (ValueError, ArithmeticError, MistakenMethodError):  # no such scenario, or no input
        return False
    assert result is not None
    return float(length(result.decision.u - wish)) <= _FREE * max(1.0, float(length(wish)))


def changes(scenario: Scenario, field: Field, share: float) -> dict[str, Any]:
    """Return the overrides that move a field a share of the way to its end."""
    numbers = dict(_numbers(_with_gain(scenario), "", field.path.split(".")))
    moved = {path: value * (1.0 + share * (field.end - 1.0)) for path, value in numbers.items()}
    if field.path.endswith("every"):
        moved = {path: max(1, int(value)) for path, value in moved.items()}
    return {
        path: value
        for path, value in moved.items()
        if value != numbers[path] and not path.endswith(".exponent")
    }


def _with_gain(scenario: Scenario) -> Any:
    """Return the table of a scenario, in which each radio has the gain that counts."""
    table, swarm = json.loads(to_json(scenario)), build_swarm(scenario)
    peers = tuple(i for i in swarm.normal if swarm.groups[i].radio)
    for group in table["agents"]:
        if group["radio"]:
            group["radio"]["gain"] = gain(swarm, peers)
    return table


def _numbers(node: Any, path: str, keys: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Yield each number at a path below a node; of a list and of a table at its end all."""
    if isinstance(node, list):
        for index, entry in enumerate(node):
            yield from _numbers(entry, f"{path}.{index}", keys)
    elif isinstance(node, dict) and not keys:
        for key, entry in node.items():
            yield from _numbers(entry, f"{path}.{key}", keys)
    elif isinstance(node, dict) and keys[0] in node:
        yield from _numbers(node[keys[0]], f"{path}.{keys[0]}", keys[1:])
    elif not keys and isinstance(node, int | float) and not isinstance(node, bool):
        yield path.removeprefix("."), node


def least_change(steps: ControllerSteps, field: Field) -> Advice | None:
    """Bisect for the least change of a field that frees the agent; None if none does."""
    scenario, low, high = steps.rows.swarm.scenario, 0.0, 1.0
    end = changes(scenario, field, 1.0)
    if not end or not frees(steps, end):
        return None
    while high - low > _EXACT * high and high > _LEAST:
        middle = 0.5 * (low + high)
        if frees(steps, changes(scenario, field, middle)):
            high = middle
        else:
            low = middle
    return Advice(changes(scenario, field, high), field.price, high)


def advice(steps: ControllerSteps) -> list[Advice]:
    """Return the least change of each field that frees the agent, if one does."""
    fields = [least_change(steps, field) for field in FIELDS]
    pairs = Advice(PAIRS, _PRICE_OF_PAIRS, 1.0)
    safety = steps.rows.swarm.safety
    proven = safety.pairwise and safety.information_model.shares
    whole = [] if proven or not frees(steps, PAIRS) else [pairs]
    return [*(change for change in fields if change), *whole]
