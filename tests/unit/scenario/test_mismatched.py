"""Parts that are each right but do not fit together: refused when the swarm is built."""

import pytest

from phalanx.scenario.load import ScenarioError, load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from tests.unit.scenario.broken import replace, working, written


def alone(text: str) -> str:
    """One agent, and no obstacle."""
    table, agents = text[: text.index("[[obstacles]]")], text[text.index("[[agents]]") :]
    first = agents[: agents.rindex("[[agents]]")]
    return table + first.replace('["1", "2", "3"]', '["1"]').replace("[0, 1, 4]", "[0]")


MISMATCHED = [
    ("two gains for q = 1", replace("alpha = [2.0]", "alpha = [2.0, 1.0]"), "expected 1 gains"),
    (
        "obstacle in space for agents in the plane",
        replace("center = [14.0, 9.0]", "center = [14.0, 9.0, 1.0]"),
        "unicycles: ",
    ),
    ("one agent alone", alone, "one agent alone"),
]


@pytest.mark.parametrize(
    ("edit", "fragment"), [m[1:] for m in MISMATCHED], ids=[m[0] for m in MISMATCHED]
)
def test_parts_that_do_not_fit_together_are_refused_when_the_swarm_is_built(
    edit, fragment, tmp_path
):
    scenario = load(written(edit(working()), tmp_path))
    with pytest.raises(ScenarioError) as error:
        build_rows(build_swarm(scenario))
    assert fragment in str(error.value)
