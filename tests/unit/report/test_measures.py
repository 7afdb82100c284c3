"""Numbers that the report computes: distances, peaks kept, steps by agent."""

import casadi as ca
import numpy as np
import pytest

from phalanx.recording.read import Recording, steps_by_agent
from phalanx.report.measures import (
    Motion,
    extremes_kept,
)
from phalanx.swarm.swarm import build_swarm


def test_distances_are_those_of_the_output_points(recording: Recording) -> None:
    swarm = build_swarm(recording.scenario)
    motion = Motion(recording, swarm)
    composed = swarm.safe_set
    h = ca.Function("h", [composed.x], [composed.h])
    for state in (0, 59):
        between = np.array(h(recording.x[state]))[:, 0]
        for pair, expected in zip(composed.pairs, between, strict=True):
            radius = 1.0 if pair.obstacle is None else 1.25
            found = radius**2 - motion.distance(pair)[state] ** 2
            assert found == pytest.approx(expected, rel=1e-9)


def test_fewer_points_keep_every_peak() -> None:
    y = np.sin(np.linspace(0.0, 30.0, 100_001))
    y[[777, 50_000]] = 9.0, -9.0
    y[20_000:40_000] = np.nan
    kept = extremes_kept(y, 400)
    assert len(kept) <= 402
    assert {0, 777, 50_000, 100_000} <= set(kept.tolist())
    assert np.isnan(y[kept]).any()
    assert list(extremes_kept(y[:300], 400)) == list(range(300))


def test_steps_are_sorted_by_agent(recording: Recording) -> None:
    found = steps_by_agent(recording)
    assert list(found) == ["1", "2", "3", "4", "5"]
    assert [s.k for s in found["3"]] == list(range(40))
