"""Two engines, one trajectory: what the fast one says holds for the real one, to the last bit."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import phalanx
from phalanx.native.library import COMPILER, FOLDER
from phalanx.scenario.load import load
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
    "latency": {"time.latency": 0.004, "safety.information": "in-flight"},
    "one controller": {"safety.control": "centralised"},
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
}
"""What no shipped scenario has."""


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


def test_processes_keep_the_rule_to_the_same_bits_as_one_process():
    none = {"agents.0.controller": {"type": "none"}, "safety.keep": "hold"}
    starts = [[2.0, 0.0, 3.1], [-2.0, 0.5, 0.0], [0.5, 3.0, -1.6], [0.0, -3.0, 1.6]]
    meeting = load("crossing", none | {"agents.0.start": starts, "duration": 2.5})
    first, second = on_both_engines(meeting)
    assert first.summary.origins["fallback"] > 0
    assert first.summary.promise == second.summary.promise
    assert first.summary.promise.kept


FEWER = {"duration": 1.5, "agents.0.radio.every": 4}
NETWORKS = {
    "all that netem does": {
        "network.delay": {"time": 0.04, "jitter": 0.03, "distribution": "paretonormal"},
        "network.loss": {"mean": 0.4, "burst": 3.0},
        "network.loss_by_distance": {"none_within": 6.0, "all_beyond": 14.0},
        "network.duplicate": 0.2,
        "network.corrupt": 0.2,
        "network.reorder": {"probability": 0.9, "gap": 2},
        "network.trace": {"t": [0.0, 0.4, 0.7], "delay": [0.0, 0.03, -1.0]},
        "network.rate": {"bits_per_second": 2e5, "limit": 10},
        "network.slot": 0.02,
        "faults": [{"kind": "partition", "at": 0.5, "for": 0.5, "shape": "ring"}],
    },
    "disturbed, in drag": {
        "agents.0.disturbance": {"bound": 0.1, "kind": "adverse"},
        "agents.0.dynamics.drag": 0.5,
        "faults": [{"kind": "lie", "agent": "2", "drift": [0.3, 0.0, 0.0, 0.0], "for": 9.0}],
    },
    "restarted, paused": {
        "faults": [
            {"kind": "restart", "at": 0.3, "for": 0.3, "agents": ["1"]},
            {"kind": "pause", "at": 0.5, "for": 0.4, "agents": ["5"]},
        ]
    },
}


@pytest.mark.parametrize("name", layered(NETWORKS, ("all that netem does", "restarted, paused")))
def test_whatever_happens_to_states_on_their_way_the_trajectory_is_one(name: str) -> None:
    scenario = phalanx.load("radio", {**FEWER, **NETWORKS[name]})
    runs = on_both_engines(scenario)
    assert runs[0].summary.outcome is not phalanx.Outcome.VIOLATED
    assert runs[0].summary.notes == [], "every fault had an effect"


OTHERS = ("crossing-radio", "warehouse-radio", "guaranteed-radio", "formation3d-radio")


@pytest.mark.parametrize("name", layered(OTHERS, ("guaranteed-radio",)))
def test_other_agents_have_one_trajectory_too(name: str) -> None:
    fewer = {"duration": 1.5, "agents.0.disturbance.kind": "adverse"}
    faults = [{"kind": "partition", "at": 0.5, "for": 0.5, "shape": "ring"}]
    runs = on_both_engines(phalanx.load(name, {**fewer, "faults": faults}))
    assert runs[0].summary.outcome is phalanx.Outcome.GUARANTEED
