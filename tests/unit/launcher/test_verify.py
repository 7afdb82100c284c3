"""Two recordings side by side: every number of the trajectory is compared, and nothing else."""

import math
from pathlib import Path

import pytest

from phalanx.launcher.engine import EngineError, RunOptions, execute
from phalanx.launcher.verify import first_difference, verify
from phalanx.recording.read import Recording, read
from phalanx.scenario.load import load
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space


@pytest.fixture
def twins(tmp_path: Path) -> tuple[Recording, Recording]:
    """The same run, recorded twice."""
    scenario = swarm_in_space(2, 1, {})
    recordings = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        recordings.append(
            read(record(tmp_path / name, scenario, drift(scenario), summary_of(scenario)))
        )
    return recordings[0], recordings[1]


def test_the_same_run_has_no_difference_whatever_its_wall_times(twins):
    first, second = twins
    for step in second.steps:
        step.solve_time += 1.0
    assert first_difference(first, second) is None


@pytest.mark.parametrize("field", ["t", "x", "h_tot"])
def test_every_number_of_a_state_is_compared(twins, field):
    first, second = twins
    state = second.states[7]
    value = getattr(state, field)
    changed = [*value[:-1], value[-1] + 1e-12] if field == "x" else value + 1e-12
    setattr(state, field, changed)
    difference = first_difference(first, second)
    assert difference.startswith(f"state 7 at t = {first.states[7].t:.6f} s: ")
    assert f" s: {'agent a0 z' if field == 'x' else field} recorded " in difference


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("t_apply", 9.0),
        ("u", (0.1, 0.1, 0.2)),
        ("origin", "backup"),
        ("residual", 1e-12),
        ("ages", [("3", 0.5)]),
        ("fates", [("3", 0, 0.5)]),
        ("u_nom", (0.0, 0.0, 1e-12)),
        ("certified", 0.5),
        ("margin", 0.5),
        ("faults", [("3", 0, ["network.loss"])]),
        ("false", [("3", 0, 0.0, [1.0, 1.0, 1.0])]),
    ],
)
def test_every_number_of_a_step_but_its_wall_time_is_compared(twins, field, value):
    first, second = twins
    setattr(second.steps[5], field, value)
    difference = first_difference(first, second)
    assert difference.startswith("step 5, agent ")
    assert f" s: {field}" in difference


def test_a_run_that_is_shorter_differs(twins):
    first, second = twins
    second.steps.pop()
    assert "steps recorded" in first_difference(first, second)
    first.steps.pop()
    second.states.pop()
    assert "states recorded" in first_difference(first, second)


@pytest.mark.parametrize(
    ("old", "new", "apart"),
    [
        (1.0, math.nextafter(1.0, 2.0), 1),
        (-1.0, math.nextafter(-1.0, -2.0), 1),
        (-5e-324, 5e-324, 2),
    ],
)
def test_two_numbers_differ_by_the_steps_of_float64_between_them(twins, old, new, apart):
    first, second = twins
    first.states[0].h_tot, second.states[0].h_tot = old, new
    assert first_difference(first, second).endswith(f"({apart} steps of float64 apart)")


def test_a_recording_without_a_state_is_not_the_same_as_anything(tmp_path):
    scenario = swarm_in_space(2, 1, {})
    empty = read(record(tmp_path, scenario, [], summary_of(scenario)))
    with pytest.raises(EngineError, match="holds no state: nothing to compare"):
        verify(empty, engine="in-process")


@pytest.mark.slow
def test_a_run_is_the_same_again_and_another_with_another_seed(tmp_path):
    changed = ["duration=0.05", "agents.0.clock.jitter=0.002"]
    execute(load("one-on-one", changed), tmp_path, RunOptions("in-process"))
    recorded = read(tmp_path)
    assert verify(recorded, engine="in-process")
    assert not verify(recorded, engine="in-process", seed=1)
