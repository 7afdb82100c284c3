"""Two recordings side by side: every number of the trajectory is compared, and nothing else."""

import math
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from phalanx.faults.commands import Command, CommandKind, CommandPolicy
from phalanx.launcher.engine import EngineError, RunOptions, execute
from phalanx.launcher.verify import Verification, first_difference, shortened, verify
from phalanx.recording.read import Recording, read
from phalanx.recording.records import StepData
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


def test_the_earlier_of_two_differences_is_named_and_a_program_if_it_decided(twins):
    program = ("./robot", "-v 2")
    first, second = twins
    groups = [g.model_copy(update={"program": program}) for g in first.scenario.agents[:1]]
    scenario = first.scenario.model_copy(update={"agents": (*groups, first.scenario.agents[1])})
    first, second = replace(first, scenario=scenario), replace(second, scenario=scenario)
    late = next(n for n, step in enumerate(first.steps) if step.agent == "n1" and step.k == 20)
    second.steps[late].u = (0.5, 0.5, 0.5)
    blamed = "its program, ./robot '-v 2', is not deterministic"
    assert blamed in first_difference(first, second)
    early = next(n for n, state in enumerate(first.states) if state.t > 0.1)
    second.states[early].x[0] += 1.0
    assert first_difference(first, second).startswith(f"state {early} ")
    first.states[early].x[0] += 1.0
    second.steps[late].u = first.steps[late].u
    second.steps[late].residual = 1.0
    assert blamed not in first_difference(first, second)
    a = next(n for n, step in enumerate(first.steps) if step.agent == "a0")
    second.steps[a].u = (0.5, 0.5, 0.5)
    late_state = next(n for n, state in enumerate(first.states) if state.t > 0.3)
    second.states[late_state].x[0] += 1.0
    assert first_difference(first, second).startswith(f"step {a}, agent a0")
    assert "program" not in first_difference(first, second)


def test_a_scenario_is_shortened_to_its_last_state_and_never_lengthened():
    reseed = [{"at": 1.0, "seed": 8}, {"at": 3.0, "seed": 9}]
    scenario = load("one-on-one", {"reseed": reseed})
    for t, end, reseedings in ((2.0, 2.0, 1), (scenario.duration, scenario.duration, 2)):
        short = shortened(scenario, t)
        assert end <= short.duration <= min(end + 1e-6, scenario.duration)
        assert len(short.reseed) == reseedings


@pytest.mark.parametrize(
    ("difference", "states", "words"),
    [
        (None, 7, "bit-identical: 3 steps and 7 states"),
        (None, 0, "bit-identical: 3 decisions, each from what the agent was shown"),
        ("step 2", 7, "differs: step 2"),
    ],
)
def test_it_is_said_what_was_compared(difference, states, words):
    assert str(Verification(difference, 3, states)) == words


@pytest.mark.slow
def test_decisions_in_real_time_are_made_again_from_what_was_shown(tmp_path):
    """Take those of a run in lockstep, in which agent 1 turns."""
    turn = CommandPolicy(schedule=(Command(0.03, CommandKind.TURN, "1"),))
    scenario = load("one-on-one", {"duration": 0.06, "time.recording_step": 0.0})
    execute(scenario, tmp_path, RunOptions("in-process", commands=turn))
    recorded = read(tmp_path)
    state = {state.t: state.x for state in recorded.states}
    shown = [
        StepData(s.agent, s.k, s.t, ["1", "2"], state[s.t], [], s.agent == "1" and s.t >= 0.03)
        for s in recorded.steps
    ]
    again = verify(replace(recorded, step_data=shown))
    assert (again.difference, again.steps, again.states) == (None, len(shown), 0)
    shown[-1] = msgspec.structs.replace(shown[-1], x=[0.0, 0.0, 2.0, 0.0])
    assert f"k = {shown[-1].k}," in verify(replace(recorded, step_data=shown)).difference


@pytest.mark.slow
def test_relayed_states_that_are_false_or_that_no_agent_stated_are_not_decided_again(tmp_path):
    lie = {"kind": "lie", "agent": "2", "at": 0.0, "for": 1.0, "shift": [1.0, 0.0, 0.0, 0.0]}
    for faults, why in (([lie], "no false states"), ([], "agent 2 never stated")):
        scenario = load("radio", {"duration": 0.06, "faults": faults})
        (folder := tmp_path / str(len(faults))).mkdir()
        execute(scenario, folder, RunOptions("in-process"))
        recorded = read(folder)
        x = [*recorded.states[0].x[:4]]
        shown = [StepData("1", 0, 0.0, ["1"], x, [("2", 0.0, [0.0, 0.0])])]
        with pytest.raises(EngineError, match=why):
            verify(replace(recorded, step_data=shown))


@pytest.mark.slow
def test_a_run_is_the_same_again_and_another_with_another_seed(tmp_path):
    changed = ["duration=0.05", "agents.0.clock.jitter=0.002"]
    execute(load("one-on-one", changed), tmp_path, RunOptions("in-process"))
    recorded = read(tmp_path)
    assert verify(tmp_path, engine="in-process")
    other = recorded.scenario.model_copy(update={"seed": 1})
    assert not verify(replace(recorded, scenario=other), engine="in-process")
