"""Mistakes in scenario files: each is refused with file, field, expected and got."""

import copy
import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from phalanx.scenario.load import load, shipped, validate
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm

Edit = Callable[[str], str]


@cache
def working() -> str:
    """Return Simulation 1 as it is shipped."""
    return shipped()["unicycles"].read_text(encoding="utf-8")


def replace(old: str, new: str, count: int = 1) -> Edit:
    """Replace a text that must be there."""

    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new, count)

    return edit


def under(header: str, line: str) -> Edit:
    """Add a line below a table's header."""
    return replace(header, f"{header}\n{line}")


def written(text: str, folder: Path) -> str:
    """Write a file with this text, and return its path."""
    path = folder / "broken.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def alone(text: str) -> str:
    """Leave one agent, and no obstacle."""
    table, agents = text[: text.index("[[obstacles]]")], text[text.index("[[agents]]") :]
    first = agents[: agents.rindex("[[agents]]")]
    return table + first.replace('["1", "2", "3"]', '["1"]').replace("[0, 1, 4]", "[0]")


# By what is wrong: the edit that makes it so, and fragments of the message.
BROKEN: Mapping[str, tuple[Edit, list[str]]] = {
    # Mistakes in the run itself: its name, duration, seed and time.
    "no name": (replace('name = "unicycles"', ""), ["name: expected a value, got nothing"]),
    "name unfit for a key": (
        replace('"unicycles"', '"uni/cycles"'),
        ["name: expected 1 to 32 of a-z 0-9", "got 'uni/cycles'"],
    ),
    "negative duration": (
        replace("duration = 24.0", "duration = -1.0"),
        ["duration: expected greater than 0", "got -1.0"],
    ),
    "duration in words": (
        replace("duration = 24.0", 'duration = "long"'),
        ["duration: expected a valid number", "got 'long'"],
    ),
    "infinite duration": (
        replace("duration = 24.0", "duration = inf"),
        ["duration: expected a finite number", "got inf"],
    ),
    "an infinite number in a class's table": (
        replace("gain = 5.0", "gain = inf"),
        ["agents.1.law: expected finite numbers", "'gain': inf"],
    ),
    "true for a number": (
        replace("duration = 24.0", "duration = true"),
        ["duration: expected a valid number", "got True"],
    ),
    "negative seed": (
        replace("duration = 24.0", "duration = 24.0\nseed = -3"),
        ["seed: expected greater than or equal to 0", "got -3"],
    ),
    "a seed that replaces another after the end": (
        under("duration = 24.0", "reseed = [{ at = 24.0, seed = 1 }]"),
        ["reseed.0.at: expected more than 0 s, and less than the run's duration", "got 24.0"],
    ),
    "seeds that replace one another in the wrong order": (
        under("duration = 24.0", "reseed = [{ at = 2.0, seed = 1 }, { at = 2.0, seed = 2 }]"),
        ["reseed.1.at: expected more than 2 s", "got 2.0"],
    ),
    "misspelt table": (
        replace("[formation]", "[formatoin]"),
        ["formatoin: unknown field (misspelt, or retired?)"],
    ),
    "a latency as long as the shortest sampling gap": (
        under("duration = 24.0", "time = { latency = 0.008 }"),
        ["time.latency: expected less than 0.008 s", "got 0.008"],
    ),
    "Runge-Kutta step too long": (
        replace("[formation]", "[time]\nintegration_step = 0.01\n\n[formation]"),
        ["time.integration_step: expected less than or equal to 0.001", "got 0.01"],
    ),
    "two pairs of one name": (
        lambda t: t.replace('["1", "2", "3"]', '["a-b", "c", "a"]').replace('"4"', '"b-c"'),
        ["agents: expected names without two pairs that are both called a-b-c"],
    ),
    "no agents": (lambda t: t[: t.index("[[agents]]")], ["agents: expected a value, got nothing"]),
    "several errors at once": (
        lambda t: (
            t.replace("rho = 5.0", "rho = -5.0")
            .replace("duration = 24.0", "")
            .replace("period = 0.01", 'period = "fast"')
        ),
        [
            "duration: expected a value, got nothing",
            "safety.rho: expected greater than 0, got -5.0",
            "agents.0.clock.period: expected a valid number, got 'fast'",
            "agents.1.clock.period: expected a valid number, got 'fast'",
        ],
    ),
    # Mistakes in safety: the function, gains, margin and information.
    "misspelt field": (
        under("[safety]", "roh = 5.0"),
        ["safety.roh: unknown field (misspelt, or retired?), got 5.0"],
    ),
    "no ρ": (replace("rho = 5.0", ""), ["safety.rho: expected a value, got nothing"]),
    "ρ zero": (replace("rho = 5.0", "rho = 0"), ["safety.rho: expected greater than 0", "got 0"]),
    "no gain": (
        replace("alpha = [2.0]", "alpha = []"),
        ["safety.alpha: ", "expected at least 1 item", "got []"],
    ),
    "negative gain": (
        replace("alpha = [2.0]", "alpha = [-2.0]"),
        ["safety.alpha.0: expected greater than 0", "got -2.0"],
    ),
    "η not a number": (replace("eta = 8.0566", "eta = nan"), ["safety.eta: expected ", "got nan"]),
    "η constants incomplete": (
        replace("eta = 8.0566", "eta = { c_f = 1.0 }"),
        ["safety.eta.c_g: expected a value, got nothing", "safety.eta.mu: expected a value"],
    ),
    "unknown information model": (
        replace('"paper"', '"papper"'),
        ["safety.information: expected 'paper', 'in-flight'", "got 'papper'"],
    ),
    "unknown safe-set function": (
        replace('"separation"', '"seperation"'),
        ["safety.function: expected one of separation, ", "package.module:Name", "'seperation'"],
    ),
    "safe-set function without radius": (
        replace(", radius = 1.0", ""),
        ["safety.function.radius: expected a value, got nothing"],
    ),
    # Mistakes in what surrounds agents: formation, obstacles and network.
    "slots without formation": (
        lambda t: t[: t.index("[formation]")] + t[t.index("[[obstacles]]") :],
        ["agents.0.slots: expected a [formation] that has slots", "got (0, 1, 4)"],
    ),
    "loss above one": (
        replace("[formation]", "[network]\nloss = 30\n\n[formation]"),
        ["network.loss: expected less than or equal to 1", "got 30"],
    ),
    "delay the wrong way round": (
        replace("[formation]", "[network]\ndelay = { low = 0.2, high = 0.1 }\n\n[formation]"),
        ["network.delay: expected low <= high, got 0.2 > 0.1"],
    ),
    "link of a stranger": (
        replace("[formation]", '[[network.links]]\nfrom = "9"\n\n[formation]'),
        ["network.links.0.from: expected an agent's name or '*'", "got '9'"],
    ),
    "obstacle without size": (
        replace("clearance = 1.25", "clearance = 0.0"),
        ["obstacles.0.clearance: expected greater than 0", "got 0.0"],
    ),
    "obstacle that is no table": (
        lambda t: "obstacles = [3.0]\n" + t.replace("[[obstacles]]", "[[ignored]]"),
        ["obstacles.0: expected a dictionary", "got 3.0"],
    ),
    "obstacle with one coordinate": (
        replace(
            "clearance = 1.25", "clearance = 1.25\n\n[[obstacles]]\ncenter = [50.0]\nclearance = 1"
        ),
        ["obstacles.1.center: expected 2 coordinates, as the agents' positions have, got (50.0,)"],
    ),
    "box in space among agents in the plane": (
        replace(
            "clearance = 1.25",
            "clearance = 1.25\n\n[[obstacles]]\ncenter = [50.0, 0, 0]\nsize = [1.0, 1, 1]",
        ),
        ["obstacles.1.center: expected 2 coordinates"],
    ),
    "wall with one coordinate": (
        replace(
            "clearance = 1.25", "clearance = 1.25\n\n[[obstacles]]\nnormal = [1.0]\noffset = 50"
        ),
        ["obstacles.1.normal: expected 2 coordinates"],
    ),
    "path with one point": (
        replace("[[0.0, 0.0], [16.0, 12.0], [24.0, -12.0], [40.0, 0.0]]", "[[0.0, 0.0]]"),
        ["formation.path: ", "at least 2 items"],
    ),
    "path of mixed dimension": (
        replace("[16.0, 12.0]", "[16.0, 12.0, 3.0]"),
        ["formation: path: expected control points that are all 2-D or all 3-D"],
    ),
    # Mistakes in agents: names, roles, dynamics, laws, clocks and places.
    "unknown dynamics": (
        replace('"unicycle"', '"tricycle"'),
        ["agents.0.dynamics: expected one of unicycle, dynamic-unicycle,", "got 'tricycle'"],
    ),
    "dynamics without type": (
        replace('type = "unicycle", ', ""),
        ["agents.0.dynamics: expected a field type, one of unicycle"],
    ),
    "negative speed": (
        replace("speed = 4.0", "speed = -4.0"),
        ["agents.0.dynamics.speed: expected greater than 0", "got -4.0"],
    ),
    "unknown parameter of the dynamics": (
        replace("speed = 4.0", "speed = 4.0, mass = 2.0"),
        ["agents.0.dynamics.mass: unknown field", "got 2.0"],
    ),
    "single integrator in 5-D": (
        replace(
            'type = "unicycle", speed = 4.0, turn_rate = 2.0, offset = 0.25',
            'type = "single-integrator", speed = 1.0, dimension = 5',
        ),
        ["agents.0.dynamics", "dimension: expected 2 or 3, got 5"],
    ),
    "unknown law": (
        replace('"pursue"', '"persue"'),
        [
            "agents.1.law: expected one of track-velocity, track, give-way, unstick, pursue",
            "got 'persue'",
        ],
    ),
    "script that goes back in time": (
        replace(
            'type = "pursue", gain = 5.0',
            'type = "script", at = [0.0, 2.0, 1.0], inputs = [[2, 0], [2, 1], [2, 0]]',
        ),
        ["agents.1.law: expected at to ascend, got 1 after 2"],
    ),
    "script beyond what the actuators can do": (
        replace('type = "pursue", gain = 5.0', 'type = "script", at = [0.0], inputs = [[3, 0]]'),
        [
            "agents.1.law: inputs.0: expected (nu, omega) within U, [-2, 2] x [-1, 1]",
            "got [3.0, 0.0]",
        ],
    ),
    "unknown role": (
        replace('"adversary"', '"evil"'),
        ["agents.1.role: expected 'normal' or 'adversary'", "got 'evil'"],
    ),
    "name twice": (
        replace('["4", "5"]', '["4", "1"]'),
        ["agents: expected every name once, got '1' twice"],
    ),
    "the plant's name": (
        replace('["4", "5"]', '["4", "plant"]'),
        ["agents.1.names.1: expected another name", "got 'plant'"],
    ),
    "the controller's name": (
        replace('["4", "5"]', '["4", "controller"]'),
        ["agents.1.names.1: expected another name", "got 'controller'"],
    ),
    "adversaries only": (
        replace('role = "normal"', 'role = "adversary"'),
        ["agents: expected at least one normal agent", "got 'adversaries only'"],
    ),
    "jitter above the period": (
        replace("jitter = 0.002", "jitter = 0.02"),
        ["agents.0.clock: expected jitter < period = 0.01, got 0.02"],
    ),
    "slots and names differ in number": (
        replace("slots = [0, 1, 4]", "slots = [0, 1]"),
        ["agents.0.slots: expected one for each of the 3 agents", "got (0, 1)"],
    ),
    "slot that the formation lacks": (
        replace("slots = [2, 3]", "slots = [2, 5]"),
        ["agents.1.slots: expected slots 0 to 4", "got (2, 5)"],
    ),
    "neither slots nor start": (
        replace("slots = [2, 3]", ""),
        ["agents.1: expected slots or start, or [flows] in which it starts, got 'none of them'"],
    ),
    "spread of the wrong size": (
        replace("spread = [0.2, 0.2, 0.3]", "spread = [0.2, 0.2]"),
        ["agents.0.spread: expected 3 components", "got (0.2, 0.2)"],
    ),
    "start of the wrong size": (
        replace("slots = [2, 3]", "start = [[0.0, 1.0, 0.0], [1.0]]"),
        ["agents.1.start: expected 3 components", "(1.0,)"],
    ),
    "a workspace of a state that no agent has": (
        replace("[[obstacles]]", "[workspace]\nz = [0.0, 1.0]\n\n[[obstacles]]"),
        ["workspace: expected bounds of states, x, y, theta, got 'z'"],
    ),
    "a workspace from its end to its beginning": (
        replace("[[obstacles]]", "[workspace]\nx = [50.0, -50.0]\n\n[[obstacles]]"),
        ["workspace.x: expected the least value first, then the largest, got [50.0, -50.0]"],
    ),
    "negative disturbance": (
        replace("bound = 1.73", "bound = -1.73"),
        ["agents.0.disturbance.bound: expected greater than or equal to 0", "got -1.73"],
    ),
}

# Parts that do not fit together are refused when the swarm is built.
MISMATCHED: Mapping[str, tuple[Edit, str]] = {
    "two gains for q = 1": (replace("alpha = [2.0]", "alpha = [2.0, 1.0]"), "expected 1 gains"),
    "one agent alone": (alone, "one agent alone"),
}


@pytest.mark.parametrize(("edit", "fragments"), BROKEN.values(), ids=BROKEN)
def test_a_mistake_is_refused_with_file_field_expected_and_got(edit, fragments, tmp_path):
    path = written(edit(working()), tmp_path)
    with pytest.raises(ScenarioError) as error:
        load(path)
    assert all(line.startswith(f"{path}: ") for line in str(error.value).splitlines())
    for fragment in fragments:
        assert fragment in str(error.value)


@pytest.mark.parametrize(("edit", "fragment"), MISMATCHED.values(), ids=MISMATCHED)
def test_parts_that_do_not_fit_together_are_refused_when_the_swarm_is_built(
    edit, fragment, tmp_path
):
    scenario = load(written(edit(working()), tmp_path))
    with pytest.raises(ScenarioError) as error:
        build_rows(build_swarm(scenario))
    assert fragment in str(error.value)


def test_the_working_file_is_accepted(tmp_path):
    assert load(written(working(), tmp_path)).name == "unicycles"


def test_every_field_of_the_working_file_is_needed_or_checked():
    table: dict[str, Any] = tomllib.loads(working())
    for key in ("safety", "agents", "name", "duration"):
        lacking = copy.deepcopy(table)
        del lacking[key]
        with pytest.raises(ScenarioError, match=f"{key}: expected a value"):
            validate(lacking, "file")
    for key in table:
        wrong = copy.deepcopy(table) | {key: 5.5j}
        with pytest.raises(ScenarioError, match=f"file: {key}"):
            validate(wrong, "file")
