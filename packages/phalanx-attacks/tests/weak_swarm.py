"""A swarm that a search breaks in a few short runs."""

from typing import Any

from phalanx.scenario.load import read_table


def weak(**attack: Any) -> dict[str, Any]:
    """One normal agent without a margin, and a faster adversary somewhere around it."""
    table = read_table("one-on-one")
    table["duration"] = 1.0
    table["agents"][1]["dynamics"]["speed"] = 4.0
    table["agents"][1]["start"] = [[0.0, -4.0]]
    knobs = {"starts": {"2": [[-6.0, 6.0], [-6.0, 6.0]]}, "apart": 1.5}
    table["attack"] = {**knobs, **attack}
    return table
