"""Two agents that pass each other: a swarm whose run takes a tenth of a second."""

from typing import Any

from phalanx_testing import CheckedRun, run

from tests.unit.tables import group, swarm_table

CROSSING = swarm_table(
    group(
        "a b",
        "normal",
        [[-1.5, 0.1], [1.5, -0.1]],
        law={"type": "track-velocity", "gain": 2.0},
        period=0.02,
        goal=[[1.5, 0.1], [-1.5, -0.1]],
    ),
    safety={"alpha": [3.0], "margin": "integrated", "information": "paper"},
    name="crossing-pair",
    duration=3.0,
)
UNFILTERED = {"agents.0.controller": {"type": "none"}}
"""They do not avoid each other."""


def crossed(**conditions: Any) -> CheckedRun:
    return run(CROSSING, **conditions)
