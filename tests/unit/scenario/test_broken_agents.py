"""Mistakes in agents: names, roles, dynamics, laws, clocks and places."""

import pytest

from tests.unit.scenario.broken import Broken, assert_refused, replace

BROKEN: list[Broken] = [
    (
        "unknown dynamics",
        replace('"unicycle"', '"tricycle"'),
        ["agents.0.dynamics: expected one of unicycle, single-integrator", "got 'tricycle'"],
    ),
    (
        "dynamics without type",
        replace('type = "unicycle", ', ""),
        ["agents.0.dynamics: expected a field type, one of unicycle"],
    ),
    (
        "negative speed",
        replace("speed = 4.0", "speed = -4.0"),
        ["agents.0.dynamics.speed: expected greater than 0", "got -4.0"],
    ),
    (
        "unknown parameter of the dynamics",
        replace("speed = 4.0", "speed = 4.0, mass = 2.0"),
        ["agents.0.dynamics.mass: unknown field", "got 2.0"],
    ),
    (
        "single integrator in 5-D",
        replace(
            'type = "unicycle", speed = 4.0, turn_rate = 2.0, offset = 0.25',
            'type = "single-integrator", speed = 1.0, dimension = 5',
        ),
        ["agents.0.dynamics", "dimension: expected 2 or 3, got 5"],
    ),
    (
        "unknown law",
        replace('"pursue"', '"persue"'),
        ["agents.1.law: expected one of track-velocity, track, pursue", "got 'persue'"],
    ),
    (
        "unknown role",
        replace('"adversary"', '"evil"'),
        ["agents.1.role: expected 'normal' or 'adversary'", "got 'evil'"],
    ),
    (
        "name twice",
        replace('["4", "5"]', '["4", "1"]'),
        ["agents: expected every name once, got '1' twice"],
    ),
    (
        "the plant's name",
        replace('["4", "5"]', '["4", "plant"]'),
        ["agents.1.names.1: expected another name", "got 'plant'"],
    ),
    (
        "the controller's name",
        replace('["4", "5"]', '["4", "controller"]'),
        ["agents.1.names.1: expected another name", "got 'controller'"],
    ),
    (
        "adversaries only",
        replace('role = "normal"', 'role = "adversary"'),
        ["agents: expected at least one normal agent", "got 'adversaries only'"],
    ),
    (
        "jitter above the period",
        replace("jitter = 0.002", "jitter = 0.02"),
        ["agents.0.clock: expected jitter < period = 0.01, got 0.02"],
    ),
    (
        "slots and names differ in number",
        replace("slots = [0, 1, 4]", "slots = [0, 1]"),
        ["agents.0.slots: expected one for each of the 3 agents", "got (0, 1)"],
    ),
    (
        "slot that the formation lacks",
        replace("slots = [2, 3]", "slots = [2, 5]"),
        ["agents.1.slots: expected slots 0 to 4", "got (2, 5)"],
    ),
    (
        "neither slots nor start",
        replace("slots = [2, 3]", ""),
        ["agents.1: expected slots or start, or [flows] in which it starts, got 'none of them'"],
    ),
    (
        "spread of the wrong size",
        replace("spread = [0.2, 0.2, 0.3]", "spread = [0.2, 0.2]"),
        ["agents.0.spread: expected 3 components", "got (0.2, 0.2)"],
    ),
    (
        "start of the wrong size",
        replace("slots = [2, 3]", "start = [[0.0, 1.0, 0.0], [1.0]]"),
        ["agents.1.start: expected 3 components", "(1.0,)"],
    ),
    (
        "negative disturbance",
        replace("bound = 1.73", "bound = -1.73"),
        ["agents.0.disturbance.bound: expected greater than or equal to 0", "got -1.73"],
    ),
]


@pytest.mark.parametrize(("edit", "fragments"), [b[1:] for b in BROKEN], ids=[b[0] for b in BROKEN])
def test_it_is_refused_with_file_field_expected_and_got(edit, fragments, tmp_path):
    assert_refused(edit, fragments, tmp_path)
