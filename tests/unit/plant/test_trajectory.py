"""The trajectory's hash knows every state and every input to the last bit, and nothing else."""

import numpy as np
from phalanx_plant.judge.judge import Judged
from phalanx_plant.observers.recorder import TrajectoryHash
from phalanx_plant.world.events import InputApplied, StateReached


def hashed(x: float = 1.0, u: float = 0.5, i: int = 0, k: int = 3, t: float = 0.1) -> str:
    trajectory = TrajectoryHash()
    state = np.full(15, x)
    applied = InputApplied(i, k, t, t, np.array([u, 0.0]))
    trajectory.add([Judged(StateReached(t, state, [])), Judged(applied)])
    return trajectory.hexadecimal


def test_the_hash_changes_with_the_last_bit_of_any_state_or_input_with_agent_step_and_time():
    up = np.nextafter
    changed = [hashed(x=up(1.0, 2)), hashed(u=up(0.5, 1)), hashed(t=up(0.1, 1)), hashed(i=1)]
    assert len({hashed(), hashed(k=4), *changed}) == 6


def test_the_same_events_have_the_same_hash():
    assert hashed() == hashed()
