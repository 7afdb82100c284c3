"""Mistakes in scenario files: each is refused with file, field, expected and got."""

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest

from phalanx.scenario.load import load, read_table, scenario_text, shipped, validate
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from tests.unit.scenario.refusals import cases, refusal

# By the run itself, safety, what surrounds agents, agents, and the network.
MISTAKES = """
name="uni/cycles" | name: expected 1 to 32 of a-z 0-9
duration=-1.0 | duration: expected greater than 0, got -1.0
duration="long" | duration: expected a valid number, got 'long'
duration=inf | duration: expected a finite number, got inf
duration=true | duration: expected a valid number, got True
agents.1.law.gain=inf | agents.1.law: expected finite numbers, got {'type': 'pursue', 'gain': inf}
seed=-3 | seed: expected greater than or equal to 0, got -3
reseed=[{at=24.0, seed=1}] | reseed.0.at: expected more than 0 s, and less than the run's duration
reseed=[{at=2.0, seed=1}, {at=2.0, seed=2}] | reseed.1.at: expected more than 2 s, and less than
formatoin={} | formatoin: unknown field (misspelt, or retired?), got {}
time.latency=0.008 | time.latency: expected less than 0.008 s, the shortest time between two
time.integration_step=0.01 | time.integration_step: expected less than or equal to 0.001, got 0.01
safety.roh=5.0 | safety.roh: unknown field (misspelt, or retired?), got 5.0
safety.rho=0 | safety.rho: expected greater than 0, got 0
safety.alpha=[] | safety.alpha: expected at least 1 item, got []
safety.alpha=[-2.0] | safety.alpha.0: expected greater than 0, got -2.0
safety.eta=nan | safety.eta: expected a finite number, got nan
safety.eta={c_f=1.0} | safety.eta.c_g: expected a value, got nothing
safety.eta={c_f=1.0} | safety.eta.mu: expected a value, got nothing
safety.information=papper | safety.information: expected 'paper', 'in-flight', 'split', 'worst-case'
safety.function.type=seperation | safety.function: expected one of separation, distance, heading-
safety.function.type=seperation | or package.module:Name, got 'seperation'
obstacles.0.clearance=0.0 | obstacles.0.clearance: expected greater than 0, got 0.0
obstacles=[3.0] | obstacles.0: expected a dictionary or an instance of Sphere, got 3.0
obstacles=[{center=[50.0], clearance=1}] | obstacles.0.center: expected 2 coordinates, as the
obstacles=[{center=[50.0, 0, 0], size=[1.0, 1, 1]}] | obstacles.0.center: expected 2 coordinates
obstacles=[{normal=[1.0], offset=50}] | obstacles.0.normal: expected 2 coordinates
obstacles=[{corners=[[3, -2], [6.5, -3]]}] | obstacles.0.corners: expected at least 3 items
obstacles=[{corners=[[0,0],[1,1],[2,4],[3,9],[4,16],[5,25],[6,36],[7,49],[8,64]]}] | at most 8 items
obstacles=[{corners=[[3, -2], [6.5, -3], [3, -4], [3.1, -3]]}] | corners: expected those of a convex
obstacles=[{corners=[[3, -2, 0], [6, -3], [3, -4]]}] | obstacles.0.corners.0: expected at most 2
formation.path=[[0.0, 0.0]] | formation.path: expected at least 2 items, got [[0.0, 0.0]]
formation.path=[[0.0, 0.0], [1.0, 2.0, 3.0]] | formation: path: expected control points that are all
workspace.z=[0.0, 1.0] | workspace: expected bounds of states, x, y, theta, got 'z'
workspace.x=[50.0, -50.0] | workspace.x: expected the least value first, then the largest, got
agents.0.dynamics.type=tricycle | agents.0.dynamics: expected one of unicycle, dynamic-unicycle
agents.0.dynamics={speed=4.0} | agents.0.dynamics: expected a field type, one of unicycle, dynamic-
agents.0.dynamics.speed=-4.0 | agents.0.dynamics.speed: expected greater than 0, got -4.0
agents.0.dynamics.mass=2.0 | agents.0.dynamics.mass: unknown field (misspelt, or retired?), got 2.0
agents.0.dynamics={type="single-integrator", speed=1.0, dimension=5} | dimension: expected 2 or 3
agents.1.law.type=persue | expected one of track-velocity, track, give-way, unstick, pursue, chase
agents.1.law={type="script", at=[0, 2, 1], inputs=[[2, 0], [2, 1], [2, 0]]} | ascend, got 1 after 2
agents.1.law={type="script", at=[0], inputs=[[3, 0]]} | inputs.0: expected (nu, omega) within U
agents.1.role=evil | agents.1.role: expected 'normal' or 'adversary', got 'evil'
agents.1.names=["4", "1"] | agents: expected every name once, got '1' twice
agents.1.names=["4", "plant"] | agents.1.names.1: expected another name: plant is the name of a
agents.1.names=["4", "controller"] | agents.1.names.1: expected another name: controller is the name
agents.0.role=adversary | agents: expected at least one normal agent, got 'adversaries only'
agents.0.clock.jitter=0.02 | agents.0.clock: expected jitter < period = 0.01, got 0.02
agents.0.slots=[0, 1] | agents.0.slots: expected one for each of the 3 agents, got (0, 1)
agents.1.slots=[2, 5] | agents.1.slots: expected slots 0 to 4, got (2, 5)
agents.1.slots=[] | agents.1: expected slots or start, or [flows] in which it starts, got 'none of
agents.0.spread=[0.2, 0.2] | agents.0.spread: expected 3 components ('x', 'y', 'theta'), got (0.2,
agents.1.start=[[0.0, 1.0, 0.0], [1.0]] | agents.1.start: expected 3 components ('x', 'y', 'theta')
agents.0.disturbance.bound=-1.73 | agents.0.disturbance.bound: expected greater than or equal to 0
network.loss=30 | network.loss: expected less than or equal to 1, got 30
network.links=[{from="9"}] | network.links.0.from: expected an agent's name or '*', one of ['1',
network.delay={low=0.2, high=0.1} | network.delay: expected low <= high, got 0.2 > 0.1
network.delay={jitter=0.1} | network.delay.time: expected a value, got nothing
network.delay={time=0.1, jitter=0.1, distribution="cauchy"} | expected 'uniform', 'normal', 'pareto'
network.delay={time=0.1, jitter=0.1, correlation=1.0} | correlation: expected less than 1, got 1.0
network.loss={mean=0.9, burst=2.0} | network.loss: expected burst >= 9 for a mean loss of 0.9
network.loss={mean=0.1, burst=4.0, 1-k=0.1} | network.loss.1-k: unknown field
network.loss_by_distance={none_within=9.0, all_beyond=3.0} | expected none_within <= all_beyond,
network.reorder={gap=0} | network.reorder.gap: expected greater than or equal to 1, got 0
network.preset=carrier-pigeon | network.preset: expected 'lan', 'wifi', 'lossy-wifi', 'lte'
network.rules=[{type="dataclasses:Field"}] | network.rules.0: expected a dataclass that is a Rule:
network.rules=[{type="dataclasses:Field"}] | lacks treat(self, message), got 'dataclasses:Field'
"""
# By the kind of fault and its fields.
FAULTS = """
gremlin, for=1 | : expected one of 'partition', 'hold', 'link', 'lie', 'kill', 'restart', 'pause'
hold, at=1.0 | .for: expected a value, got nothing
hold, for=1, of="sample" | .of: expected broadcast or actuation: samples cannot be delayed
partition, for=1, groups=[["9"]] | .groups: expected an agent's name, one of ['1', '2', '3', '4',
partition, for=1, groups=[["1"], ["2", "1"]] | .groups: expected '1' in one group, got ['1', '2',
partition, for=1, groups=[["1", "2", "3", "4", "5"]] | .groups: expected two groups, or an agent in
partition, for=1, groups=[["1"]], shape="ring" | : expected groups, or a shape
lie, for=1, agent="9", says="zero" | .agent: expected an agent's name, one of ['1', '2', '3', '4',
lie, for=1, agent="2", to=["2"], says="zero" | .to: expected an agent's name, one of ['1', '3', '4'
lie, for=1, agent="2" | : expected one of says, equivocate, replay, apply_time, shift, drift,
lie, for=1, agent="2", says="zero", replay=3 | drift, silent, got ['says', 'replay']
lie, for=1, agent="2", says="please" | .says: expected 'opposite' or 'zero', got 'please'
lie, for=1, agent="2", says=[1.0] | .says: expected 2 components, got (1.0,)
lie, for=1, agent="2", says=[0.0, -1e301] | .says.1: expected at most 1e+300 in size: agents refuse
lie, for=1, agent="2", apply_time=1e301 | .apply_time: expected at most 1e+300 in size: agents
lie, for=1, agent="2", replay=0 | .replay: expected greater than or equal to 1, got 0
kill, at=1.0, agents=["9"] | .agents: expected an agent's name, one of ['1', '2', '3', '4', '5'],
kill, at=1.0, rate=1.0 | : expected at, or a rate
pause, at=1.0 | .for: expected a value, got nothing
turn, at=1.0, agents=["4"] | .agents: expected normal agents, got '4'
clock, at=1.0, step=0.1, drift=0.1 | : expected one of step, skew and drift
clock, at=1.0, step=0.1, for=0.1 | .for: expected with skew and drift alone, got 0.1
sensor, at=1.0, for=1, silent=true, bias={x=1.0} | : expected silent = true, or bias and noise
sensor, at=1.0, for=1, bias={z=1.0} | .bias: expected states of agent 1, of ['x', 'y', 'theta'], got
link, for=1, from="9", loss=1.0 | .from: expected an agent's name or '*', one of ['1', '2', '3', '4'
"""


@pytest.mark.parametrize(("override", "message"), cases(MISTAKES))
def test_a_mistake_is_refused_with_field_expected_and_got(override, message):
    assert message in refusal([override])


@pytest.mark.parametrize(("fault", "message"), cases(FAULTS))
def test_a_mistake_in_a_fault_is_refused_with_its_field(fault, message):
    kind, *fields = fault.split(", ", 1)
    lines = refusal([f'faults=[{{kind="{kind}", {"".join(fields)}}}]'])
    assert (f"unicycles: faults.0{message}" if message[0] in ".:" else message) in lines


def test_each_of_several_mistakes_has_a_line():
    mistakes = ["safety.rho=-5.0", "duration=x", "agents.0.clock.period=fast"]
    assert refusal([*mistakes, "agents.1.clock.period=fast"]).splitlines() == [
        "unicycles: duration: expected a valid number, got 'x'",
        "unicycles: safety.rho: expected greater than 0, got -5.0",
        "unicycles: agents.0.clock.period: expected a valid number, got 'fast'",
        "unicycles: agents.1.clock.period: expected a valid number, got 'fast'",
    ]


def test_two_pairs_of_one_name_are_refused():
    named = ['agents.0.names=["a-b", "c", "a"]', 'agents.1.names=["b-c", "5"]']
    assert "agents: expected names without two pairs that are both called a-b-c" in refusal(named)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        *((name, f"{name}: expected a value, got nothing") for name in ("name", "duration")),
        *((name, f"{name}: expected a value, got nothing") for name in ("safety", "agents")),
        ("safety.rho", "safety.rho: expected a value, got nothing"),
        ("safety.function.radius", "safety.function.radius: expected a value, got nothing"),
        ("formation", "agents.0.slots: expected a [formation] that has slots, got (0, 1, 4)"),
    ],
)
def test_what_is_lacking_in_a_file_is_named_with_the_file(path: str, message: str, tmp_path: Path):
    table: Any = read_table("unicycles")
    *above, last = path.split(".")
    inner = table
    for key in above:
        inner = inner[key]
    del inner[last]
    (file := tmp_path / "broken.toml").write_text(scenario_text(table), "utf-8")
    with pytest.raises(ScenarioError) as error:
        load(file)
    assert str(error.value) == f"{file}: {message}"


def test_parts_that_do_not_fit_together_are_refused_when_the_swarm_is_built():
    with pytest.raises(ScenarioError, match="expected 1 gains"):
        build_rows(build_swarm(load("unicycles", ["safety.alpha=[2.0, 1.0]"])))
    alone = read_table("unicycles", {"agents.0.names": ["1"], "agents.0.slots": [0]})
    del alone["agents"][1], alone["obstacles"]
    with pytest.raises(ScenarioError, match="one agent alone"):
        build_rows(build_swarm(load(alone)))


def test_every_field_of_a_shipped_file_is_checked():
    table: dict[str, Any] = tomllib.loads(shipped()["unicycles"].read_text("utf-8"))
    for key in table:
        wrong = copy.deepcopy(table) | {key: 5.5j}
        with pytest.raises(ScenarioError, match=f"file: {key}"):
            validate(wrong, "file")
