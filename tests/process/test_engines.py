"""Two engines, one trajectory: what the fast one says holds for the real one, to the last bit."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import phalanx
from phalanx.theory.expressions.native import COMPILER, FOLDER
from tests.layers import layered
from tests.process.runs import on_both_engines

pytestmark = pytest.mark.swarm

DURATION = 1.5
"""Of each run [s]: past the first backups, losses and late broadcasts of the shipped scenarios."""
VARIANTS = {
    "losses and delays": {"network.loss": 0.3, "network.delay": {"low": 0.0, "high": 0.05}},
    "everything that netem does": {
        "network.delay": {
            "time": 0.02,
            "jitter": 0.02,
            "correlation": 0.3,
            "distribution": "paretonormal",
        },
        "network.delay_floor": {"time": 0.002, "per_metre": 0.001},
        "network.loss": {"mean": 0.2, "burst": 3.0},
        "network.loss_by_distance": {"none_within": 5.0, "all_beyond": 20.0},
        "network.duplicate": 0.1,
        "network.corrupt": 0.1,
        "network.reorder": {"probability": 0.2, "gap": 2},
        "network.rate": {"bits_per_second": 2e5, "limit": 10},
        "network.slot": 0.005,
    },
    "faults of a time": {
        "faults": [
            {"kind": "partition", "at": 0.2, "for": 0.4, "groups": [["1", "4"]]},
            {"kind": "partition", "at": 0.9, "for": 0.2, "shape": "ring"},
            {"kind": "hold", "at": 0.6, "for": 0.3, "from": "2"},
            {"kind": "link", "at": 1.1, "for": 0.3, "loss": 0.5, "delay": 0.01},
        ],
    },
    "sensors and actuators": {
        "safety.neighbourhood": 4.7,
        "network.sample.loss": {"mean": 0.1, "burst": 2.0},
        "network.actuation": {"loss": 0.1, "delay": {"low": 0.0, "high": 0.015}},
        "faults": [{"kind": "hold", "of": "actuation", "from": "2", "at": 0.5, "for": 0.2}],
    },
    "lies": {
        "faults": [
            {"kind": "lie", "agent": "2", "at": 0.2, "for": 0.4, "says": "opposite"},
            {"kind": "lie", "agent": "3", "at": 0.1, "for": 0.4, "equivocate": True},
            {"kind": "lie", "agent": "1", "at": 0.1, "for": 0.4, "replay": 5, "to": ["2"]},
            {"kind": "lie", "agent": "1", "at": 0.3, "for": 0.4, "apply_time": 0.01},
            {"kind": "lie", "agent": "2", "at": 0.5, "for": 0.2, "silent": True, "to": ["1"]},
        ],
    },
    "latency": {"time.latency": 0.004, "safety.information": "in-flight"},
    "one controller": {"safety.control": "centralised"},
    "one row for each pair": {"safety.composition": "pairs", "safety.information": "split"},
    "undeclared adversaries": {"safety.information": "unknown"},
    "proven inputs": {"safety.prove": True, "safety.information": "in-flight"},
    "agents that come and go": {"safety.neighbourhood": 4.7, "agents.1.sensing": 7.6},
    "another seed on the way": {
        "network.loss": {"mean": 0.3, "burst": 3.0},
        "network.sample.loss": 0.2,
        "faults": [{"kind": "lie", "agent": "2", "at": 0.4, "for": 0.9, "equivocate": True}],
        "reseed": [{"at": 0.7, "seed": 17}, {"at": 1.1, "seed": 3}],
    },
    "attacks by a script": {
        "agents.1.law": {"type": "script", "at": [0.0, 0.4], "inputs": [[2.0, -1.0], [2.0, 1.0]]}
    },
    "adverse disturbances": {"agents.0.disturbance.kind": "adverse"},
}


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
@pytest.mark.nightly
def test_processes_that_load_machine_code_have_the_same_trajectory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = phalanx.load("formation3d", {"duration": 0.5})
    interpreted = phalanx.run(scenario)
    environment = {COMPILER: "cc", FOLDER: str(tmp_path)}
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    # A process of its own: this one has looked for its compiler already.
    command = [sys.executable, "-m", "phalanx", "compile", "formation3d", "--set", "duration=0.5"]
    subprocess.run(command, check=True)
    compiled = phalanx.run(scenario)
    assert interpreted.summary is not None
    assert compiled.summary is not None
    assert compiled.summary.trajectory == interpreted.summary.trajectory
    # Damaged libraries show that these are the ones that the programs load.
    for library in tmp_path.glob("*/*.so"):
        library.write_bytes(b"")
    damaged = phalanx.run(scenario)
    assert "the interpreter runs" in (damaged.folder / "logs" / "plant.log").read_text()


def test_agents_that_share_a_process_have_the_same_trajectory() -> None:
    scenario = phalanx.load("unicycles", {"duration": 0.5, "network.loss": 0.2})
    alone, together = phalanx.run(scenario), phalanx.run(scenario, agents_per_process=2)
    assert alone.summary is not None
    assert together.summary is not None
    assert together.summary.trajectory == alone.summary.trajectory
    logs = {path.stem for path in (together.folder / "logs").iterdir()}
    assert logs == {"plant", "programs", "1", "3", "5"}
    assert (together.folder / "logs" / "1.log").read_text().count("joined run") == 2


def test_an_agent_that_fails_is_named_also_if_others_share_its_process(
    tmp_path, monkeypatch
) -> None:
    (tmp_path / "failing_law.py").write_text(FAILING)
    monkeypatch.syspath_prepend(tmp_path)
    law = {"agents.0.law": {"type": "failing_law:Failing"}, "duration": 1.0}
    run = phalanx.run(phalanx.load("unicycles", law), agents_per_process=5)
    assert run.summary is not None
    assert run.summary.outcome == "broken"
    assert "agent 2" in run.summary.reason


@pytest.mark.parametrize("kind", ["kill", "restart", "pause"])
def test_a_process_of_several_agents_is_never_killed_for_one(kind: str) -> None:
    fault = {"kind": kind, "agents": ["2"], "at": 0.2}
    if kind != "kill":
        fault["for"] = 0.1
    scenario = phalanx.load("unicycles", {"faults": [fault]})
    with pytest.raises(phalanx.EngineError, match=f"faults.0: expected one agent .* to {kind} one"):
        phalanx.run(scenario, agents_per_process=2)


FAILING = """
from dataclasses import dataclass

import numpy as np

@dataclass
class Failing:
    def prepare(self, dynamics):
        self.steps = 0

    def input(self, view):
        self.steps += 1
        if view.i == 1 and self.steps > 20:
            raise RuntimeError("out of order")
        return np.zeros(2)
"""

CONTROLLER = """
from dataclasses import dataclass

@dataclass
class Filtering:
    def prepare(self, agent):
        self.ages = 0.0

    def input(self, view):
        self.ages += sum(each.age for each in view.received.values())
        view.note(ages=self.ages, heard=len(view.received))
        return view.u_nom / (1.0 + self.ages) if view.certified(view.u_nom) else 0.0 * view.u_nom
"""


HERE_ALONE = [name for name in phalanx.shipped() if name != "worlds/ros2-robots"]
"""Scenarios without robots of others, which no run repeats."""


@pytest.mark.timeout(600)  # the certificates of some dynamics compile for 20 s, twice
@pytest.mark.parametrize("name", layered(HERE_ALONE, ("faults/robot",)))
def test_every_shipped_scenario_has_one_trajectory(name: str) -> None:
    # A second of Crazyflies takes twenty: their integration steps are of 0.3 ms.
    lasts = 0.1 if name == "worlds/crazyflies" else DURATION
    shipped = phalanx.load(name, seed=1)
    on_both_engines(phalanx.load(name, {"duration": min(lasts, shipped.duration)}, seed=1))


@pytest.mark.parametrize("name", layered(VARIANTS, ("losses and delays", "one controller")))
def test_whatever_network_clock_and_controller_the_trajectory_is_one(name: str) -> None:
    scenario = phalanx.load("unicycles", {"duration": DURATION, **VARIANTS[name]})
    assert on_both_engines(scenario)[0].summary.notes == []


def test_a_controller_with_a_state_has_one_trajectory(tmp_path, monkeypatch) -> None:
    (tmp_path / "filtering.py").write_text(CONTROLLER, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    table = {"type": "filtering:Filtering"}
    overrides = {"duration": 0.3, "network.loss": 0.3, "agents.0.controller": table}
    runs = on_both_engines(phalanx.load("unicycles", overrides))
    noted = [run.inputs.select("agent", "k", "note.ages", "note.heard") for run in runs]
    assert noted[0].equals(noted[1])
    assert noted[0]["note.heard"].max() == 2.0
    verification = phalanx.verify(runs[1], engine="in-process")
    assert verification, verification.difference


def test_commands_have_the_same_effect_on_both_engines() -> None:
    scenario = phalanx.load("unicycles", {"duration": 1.0})
    kinds = phalanx.CommandKind
    schedule = (
        phalanx.Command(0.2, kinds.LOSS, value=0.5),
        phalanx.Command(0.4, kinds.FREEZE, "1"),
        phalanx.Command(0.5, kinds.TURN, "2"),
        phalanx.Command(0.7, kinds.THAW, "1"),
        phalanx.Command(0.9, kinds.KILL, "3"),
    )
    policy = phalanx.CommandPolicy(schedule=schedule)
    disturbed, _ = on_both_engines(scenario, commands=policy)
    undisturbed = phalanx.run(scenario, engine="in-process")
    assert undisturbed.summary.trajectory != disturbed.summary.trajectory


def test_a_run_of_one_engine_is_verified_on_the_other() -> None:
    run = phalanx.run(phalanx.load("stale-inputs", {"duration": 1.0}), engine="in-process")
    verification = phalanx.verify(run, engine="processes")
    assert verification, verification.difference
    assert verification.steps == run.summary.steps
