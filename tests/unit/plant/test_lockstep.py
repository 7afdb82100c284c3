"""Lockstep where it ends badly."""

import sys
from pathlib import Path

import pytest

from phalanx.faults.commands import CommandKind, CommandPolicy
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.plant.commands import CommandQueue
from phalanx.plant.judge import Judge
from phalanx.plant.lockstep import Lockstep
from phalanx.plant.world import DivergedError
from phalanx.recording.read import read
from phalanx.recording.records import Command
from phalanx.recording.write import RecordingWriter
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import VERSION, Input, Sample, Status

RUNAWAY = """
from dataclasses import dataclass

from phalanx.theory.models.integrators import SingleIntegrator


@dataclass(frozen=True)
class Runaway(SingleIntegrator):
    def drift(self, x):
        return 1e2 * x**3
"""
SCENARIO = """
name = "runaway"
duration = 1.0
safety = { function = { type = "separation", radius = 1.0 }, rho = 1.0, alpha = [1.0], eta = 0.0 }
obstacles = [{ center = [0.0, 0.0], clearance = 0.1 }]

[[agents]]
names = ["1"]
role = "normal"
dynamics = { type = "runaway_user:Runaway", speed = 1.0 }
law = { type = "track-velocity", gain = 1.0 }
clock = { period = 0.01 }
start = [[0.5, 0.0]]
"""


class Coasting:
    """An agent that wants nothing."""

    def __init__(self) -> None:
        self.asked = 0

    def send_sample(self, i: int, sample: Sample) -> None:
        self._sample = sample
        self.asked += 1

    def await_input(self, i: int) -> Input:
        k, t = self._sample.k, self._sample.t
        return Input(VERSION, k, t, t, t + 0.01, (0.0, 0.0), Origin.QP, 0.0, 0.0, (None,))

    def publish_status(self, message: Status) -> None:
        pass


def test_the_input_before_a_breakdown_is_judged_and_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "runaway_user.py").write_text(RUNAWAY)
    (tmp_path / "runaway.toml").write_text(SCENARIO)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    scenario = load(str(tmp_path / "runaway.toml"))
    swarm, agents = build_swarm(scenario), Coasting()
    judge, file = Judge(swarm), tmp_path / "runaway.mcap"
    with RecordingWriter(file, scenario, "runaway") as recording:
        lockstep = Lockstep(swarm, agents, judge, recording)
        with pytest.raises(DivergedError) as found:
            lockstep.run()
        nothing = ("", 0.0, 0.0, "", 0, {}, [], [], {}, 0.0)
        recording.finish(Summary(Outcome.BROKEN, str(found.value), lockstep.world.t, 0, *nothing))
    assert agents.asked > 1
    assert judge.steps == agents.asked
    assert len(read(file).steps) == agents.asked


def test_an_agent_thawed_while_its_input_is_on_its_way_samples_after_that_took_effect(
    tmp_path: Path,
) -> None:
    scenario = load("one-on-one", ["duration=0.2", "time.latency=0.004"])
    swarm = build_swarm(scenario)
    name, agents, judge = swarm.names[0], Remembering(0.004), Judge(swarm)
    schedule = (Command(0.101, CommandKind.FREEZE, name), Command(0.102, CommandKind.THAW, name))
    with RecordingWriter(tmp_path / "thaw.mcap", scenario, "thaw") as recording:
        commands = CommandQueue(CommandPolicy(schedule=schedule), swarm.names)
        Lockstep(swarm, agents, judge, recording, commands).run()
    assert judge.steps == agents.asked


class Remembering(Coasting):
    """The same for several, with a latency."""

    def __init__(self, latency: float) -> None:
        super().__init__()
        self._latency, self._open = latency, {}

    def send_sample(self, i: int, sample: Sample) -> None:
        self._open[i] = sample
        self.asked += 1

    def await_input(self, i: int) -> Input:
        sample = self._open.pop(i)
        due = sample.t + self._latency
        nobody = (None,) * len(sample.latest)
        return Input(VERSION, sample.k, sample.t, due, 0.0, (0.0, 0.0), Origin.QP, 0.0, 0.0, nobody)
