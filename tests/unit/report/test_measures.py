"""Numbers that the report computes: distances, steps by agent."""

import casadi as ca
import numpy as np
import pytest

from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.read import Recording, steps_by_agent


def test_distances_are_those_of_the_output_points(recording: Recording) -> None:
    history = ReportHistory(recording)
    composed = history.swarm.safe_set
    h = ca.Function("h", [composed.x], [composed.h])
    for state in (0, 59):
        between = np.array(h(recording.x[state]))[:, 0]
        for pair, expected in zip(composed.pairs, between, strict=True):
            radius = 1.0 if pair.b < len(composed.members) else 1.25
            from_distance = radius**2 - history.distance(pair)[state] ** 2
            assert from_distance == pytest.approx(expected, rel=1e-9)


def test_steps_are_sorted_by_agent(recording: Recording) -> None:
    steps = steps_by_agent(recording)
    assert list(steps) == ["1", "2", "3", "4", "5"]
    assert [s.k for s in steps["3"]] == list(range(40))
