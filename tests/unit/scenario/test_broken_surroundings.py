"""Mistakes in what surrounds agents: formation, obstacles and network."""

import pytest

from tests.unit.scenario.broken import Broken, assert_refused, replace

BROKEN: list[Broken] = [
    (
        "slots without formation",
        lambda t: t[: t.index("[formation]")] + t[t.index("[[obstacles]]") :],
        ["agents.0.slots: expected a [formation] that has slots", "got (0, 1, 4)"],
    ),
    (
        "loss above one",
        replace("[formation]", "[network]\nloss = 30\n\n[formation]"),
        ["network.loss: expected less than or equal to 1", "got 30"],
    ),
    (
        "delay the wrong way round",
        replace("[formation]", "[network]\ndelay = { low = 0.2, high = 0.1 }\n\n[formation]"),
        ["network.delay: expected low <= high, got 0.2 > 0.1"],
    ),
    (
        "link of a stranger",
        replace("[formation]", '[[network.links]]\nfrom = "9"\n\n[formation]'),
        ["network.links.0.from: expected an agent's name or '*'", "got '9'"],
    ),
    (
        "obstacle without size",
        replace("clearance = 1.25", "clearance = 0.0"),
        ["obstacles.0.clearance: expected greater than 0", "got 0.0"],
    ),
    (
        "path with one point",
        replace("[[0.0, 0.0], [16.0, 12.0], [24.0, -12.0], [40.0, 0.0]]", "[[0.0, 0.0]]"),
        ["formation.path: ", "at least 2 items"],
    ),
    (
        "path of mixed dimension",
        replace("[16.0, 12.0]", "[16.0, 12.0, 3.0]"),
        ["formation: path: expected control points that are all 2-D or all 3-D"],
    ),
]


@pytest.mark.parametrize(("edit", "fragments"), [b[1:] for b in BROKEN], ids=[b[0] for b in BROKEN])
def test_it_is_refused_with_file_field_expected_and_got(edit, fragments, tmp_path):
    assert_refused(edit, fragments, tmp_path)
