"""Attempts to be guaranteed wrongly: by h, by α, by scale, by lies, by speed, by sharp corners.

In most of them an agent passes through an obstacle or another agent between two integration steps,
so no step has h > 0: a judge that relied on the steps, or on reports, would call them proven.
"""

import sys
from collections.abc import Callable, Sequence

import casadi as ca
import msgspec
import numpy as np
import pytest
from phalanx_certify.checker.certify import certify
from phalanx_certify.checker.intervals import UndecidedError
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.run import PlantRun
from phalanx_plant.world.world import Actuators

from phalanx.faults.commands import NO_COMMANDS
from phalanx.guarantee.certificate import pair_certificate
from phalanx.guarantee.check import check
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.simulation import DirectAgents
from phalanx.messages.kinds import Sample, Telemetry
from phalanx.recording.read import read
from phalanx.recording.records import RECORDING
from phalanx.recording.write import RecordingWriter
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.integrators import DoubleIntegrator
from phalanx.theory.rows.origin import Origin
from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Wall
from tests.unit.tables import group, swarm_table

OWN = '''
from dataclasses import dataclass

import casadi as ca

from phalanx.extend import SingleIntegrator

AT, THIN = 0.1037, 1e-4  # no step of 1 mm from 0 ends in between

@dataclass(frozen=True)
class Thin:
    """Unsafe only between AT and AT + THIN, and near nothing else."""
    kind: str
    def between(self, a, b):
        x, y = a.p[0], a.p[1]
        r = ca.norm_2(a.p - ca.DM([-1.0, 0.0])) - 1.0
        return 1e-6 * (x + y - b.p[0] - b.p[1]) + {
            "zone": ca.if_else(x < AT, -1.0, ca.if_else(x > AT + THIN, -1.0, 1.0)),
            "ring": -ca.sign(r - AT) * ca.sign(r - AT - THIN),
            "grid": ca.floor(x - AT) - ca.floor(x - AT - THIN) - 0.5,
            "bearing": ca.fabs(ca.atan2(y - 1.0, x - AT)) - 3.1415,
            "wall": 1.0 - ((x - AT) / (0.5 * THIN) - 1.0) ** 2,
            "smooth": -1.0 - x * x,
            "unbounded": ca.erf(x) - 2.0,
        }[self.kind]
    def to_obstacle(self, a, obstacle):
        return obstacle.intrusion(a.p)

@dataclass(frozen=True)
class ByName:
    """Separation of 1 m, but of 2 m from agent 3."""
    def between(self, a, b):
        radius = 2.0 if "3" in str(b.x) else 1.0
        return radius * radius - ca.sumsqr(a.p - b.p)
    def to_obstacle(self, a, obstacle):
        return obstacle.intrusion(a.p)

@dataclass(frozen=True)
class Below:
    """α(0) = -1."""
    def value(self, s):
        return s - 1.0

@dataclass(frozen=True)
class Stepping:
    """α that jumps up at -0.5."""
    def value(self, s):
        return 50.0 * ca.sign(s + 0.5)

@dataclass(frozen=True)
class Needle(SingleIntegrator):
    """Its U is a needle: 0.1 long towards -x, and 2e-6 thick where it is thickest."""
    def input_polytope(self, x):
        A = ca.DM([[1.0, 0.0], [-1e-5, 1.0], [-1e-5, -1.0]])
        return ca.SX(A), ca.SX(ca.DM([0.0, 1e-6, 1e-6]))

@dataclass(frozen=True)
class Flying(SingleIntegrator):
    """It cannot stand still: it flies towards +x."""
    def input_polytope(self, x):
        A = ca.DM([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        return ca.SX(A), ca.SX(ca.DM([2.0, -1.0, 0.1, 0.1]))
'''

Inputs = Callable[[str, Sample, np.ndarray], Sequence[float]]


@pytest.fixture(scope="module", autouse=True)
def own_module(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    (folder / "attack_own.py").write_text(OWN)
    sys.path.insert(0, str(folder))
    yield
    sys.path.remove(str(folder))


class Hijacked(DirectAgents):
    """Agents whose actuators get other inputs than the controllers' answers."""

    inputs: Inputs
    attacked = 0
    """How many inputs were replaced."""

    def send_sample(self, i: int, sample: Sample) -> None:
        super().send_sample(i, sample)
        u = type(self).inputs(self._names[i], sample, self._inputs[i])
        self._inputs[i] = np.array(u)
        self.attacked += 1


class Liars(Hijacked):
    """The same, and they say that all is well."""

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        said = super().await_telemetry(i, k)
        made = msgspec.structs.replace(said.report, origin=Origin.QP, residual=-9.0)
        return msgspec.structs.replace(said, report=made, ages=(), rejected=0)


def as_answered(name: str, sample: Sample, answer: np.ndarray) -> Sequence[float]:
    return answer


def ahead(**speeds: float) -> Inputs:
    """Let agents of these names drive along x, whatever their answers; the others stand."""
    return lambda name, sample, answer: (speeds.get(f"agent{name}", 0.0), 0.0)


def judged(table, tmp_path, inputs: Inputs = as_answered, kind=Hijacked):
    """Summary and recording of a run in process."""
    scenario = table if not isinstance(table, dict) else load(table)
    rows = build_rows(build_swarm(scenario))
    agents = type("Agents", (kind,), {"inputs": staticmethod(inputs)})(rows, lambda status: None)
    path = tmp_path / RECORDING
    path.unlink(missing_ok=True)
    with RecordingWriter(path, scenario, "attack") as recording:
        plant = PlantRun(
            rows, agents, recording, CommandQueue(NO_COMMANDS, rows.swarm.names), Lockstep
        )
        summary = plant.run()
        recording.finish(summary)
    assert summary.outcome in (Outcome.GUARANTEED, Outcome.SAFE, Outcome.VIOLATED), summary.reason
    recorded = read(path)
    assert agents.attacked >= len(recorded.steps) > 0, "every input went through the attack"
    return summary, recorded


def failed(summary: Summary) -> set[str]:
    return {a.name for a in summary.assumptions if a.failed}


def never_certified_when_unsafe(summary: Summary) -> bool:
    """Return whether certificates ended before the first violation, if there was one."""
    at = summary.certificates.uncovered_at
    return all(at is not None and at <= v.first for v in summary.violations)


def swarm(
    starts,
    function=None,
    dynamics=None,
    alpha=(1.0,),
    period=0.01,
    duration=0.2,
    scale=1.0,
    bound=0.0,
    obstacles=(),
    other=None,
):
    """A table: agent 1 is normal, the others adversaries, all in the plane."""
    of_all = {"law": "worst", "speed": scale, "period": period, "disturbance": {"bound": bound}}
    of_1, of_others = ({"dynamics": d} if d else {} for d in (dynamics, other or dynamics))
    agents = [group("1", "normal", starts[:1], **of_all, **of_1)]
    if others := " ".join(str(k) for k in range(2, len(starts) + 1)):
        agents.append(group(others, "adversary", starts[1:], **of_all, **of_others))
    safety = {"rho": 1.0, "alpha": list(alpha), "composition": "lse", "information": "paper"}
    safety |= {"eta": 0.0} | ({"function": function} if function else {})
    fields = {"duration": duration, "obstacles": list(obstacles)}
    return swarm_table(*agents, radius=scale, safety=safety, **fields)


@pytest.mark.parametrize("kind", ["zone", "ring", "grid", "bearing", "wall"])
def test_h_that_jumps_or_is_thin_is_not_guaranteed(kind, tmp_path):
    """Agent 1 drives through what is unsafe, between two steps."""
    table = swarm([[0.0, 0.0], [9.0, 9.0]], {"type": "attack_own:Thin", "kind": kind})
    if kind == "bearing":
        table["agents"][0]["start"] = [[-0.5, 0.9003]]
        summary, _ = judged(table, tmp_path, lambda n, s, a: (0.0, float(n == "1")))
    else:
        summary, _ = judged(table, tmp_path, ahead(agent1=1.0))
    assert summary.outcome is Outcome.SAFE  # no integration step showed it
    assert failed(summary) == {"certificates"}


def test_smooth_h_of_ones_own_is_guaranteed(tmp_path):
    table = swarm([[0.0, 0.0], [9.0, 9.0]], {"type": "attack_own:Thin", "kind": "smooth"})
    assert judged(table, tmp_path, ahead(agent1=1.0))[0].outcome is Outcome.GUARANTEED


@pytest.mark.parametrize(
    ("kind", "x", "may"),
    [
        ("zone", [0.1036, 0.0], False),
        ("ring", [0.1036, 0.0], False),
        ("grid", [0.1036, 0.0], False),
        ("bearing", [-0.5, 0.9999], False),
        ("smooth", [0.1036, 0.0], True),
    ],
)
def test_a_check_says_no_where_no_input_has_a_certificate_at_the_start(kind, x, may):
    """A gust may take agent 1 to where h jumps."""
    assert check(load(proven_rows(kind, x))).may_be_guaranteed is may


def test_a_check_refuses_by_name_what_cannot_be_bounded():
    with pytest.raises(ScenarioError, match="no interval rule for the operation erf"):
        check(load(proven_rows("unbounded", [0.0, 0.0])))


def proven_rows(kind, x):
    """A table whose rows are proven where h can be bounded, and gusts faster than agents."""
    table = swarm([x, [9.0, 9.0]], {"type": "attack_own:Thin", "kind": kind}, bound=2.0)
    del table["safety"]["eta"]
    table["safety"] |= {"margin": "local", "composition": "pairs", "information": "split"}
    table["safety"]["alpha"] = [50.0]
    return table


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1e-3, 1.0, 1e3])
def test_lengths_of_any_size_are_violated_uncertified(scale, tmp_path):
    starts = [[0.0, 0.0], [2.05 * scale, 0.0]]
    summary, _ = judged(swarm(starts, duration=1.5, scale=scale), tmp_path, ahead(agent2=-scale))
    assert summary.outcome is Outcome.VIOLATED
    assert never_certified_when_unsafe(summary)


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1e-3])
def test_what_is_small_is_not_passed_through(scale, tmp_path):
    obstacle = {"center": [0.1005, 0.0], "clearance": 0.1 * scale}
    summary, _ = judged(swarm([[0.0, 0.0]], obstacles=[obstacle]), tmp_path, ahead(agent1=1.0))
    assert summary.outcome is Outcome.SAFE
    assert failed(summary) == {"certificates"}
    assert summary.certificates.uncovered == "1-obstacle 0"


def test_periods_of_a_nanosecond_are_no_rounding_errors(tmp_path):
    obstacle = {"center": [10.5, 0.0], "clearance": 0.4}
    fast = {"type": "single-integrator", "speed": 1e9}
    table = swarm([[0.0, 0.0]], None, fast, period=1e-9, duration=2e-8, obstacles=[obstacle])
    summary, _ = judged(table, tmp_path, ahead(agent1=1e9))
    assert summary.outcome is Outcome.SAFE
    assert failed(summary) == {"certificates"}


def test_an_agent_at_3000_metres_a_second_passes_through_nothing(tmp_path):
    obstacle = {"center": [0.0, 0.0], "clearance": 0.5}
    fast = {"type": "single-integrator", "speed": 3000.0}
    table = swarm([[-4.5, 0.0]], None, fast, period=1e-3, duration=3e-3, obstacles=[obstacle])
    summary, recording = judged(table, tmp_path, ahead(agent1=3000.0))
    assert max(state.h_tot for state in recording.states) < 0.0
    assert summary.outcome is Outcome.SAFE
    assert failed(summary) == {"certificates"}
    slow = judged(table, tmp_path, ahead(agent1=-3000.0))[0]
    assert slow.outcome is Outcome.GUARANTEED


TOWARDS_A_WALL = [
    ("Below", [0.45, 0.0, 0.9, 0.0]),  # ψ_1 = 0.9 - 0.05 - 1
    ("Stepping", [-0.2, 0.0, 20.0, 0.0]),  # ψ_1 = 20 - 50, until h = -0.5
]


@pytest.mark.parametrize(("alpha", "x"), TOWARDS_A_WALL)
def test_an_alpha_that_is_none_is_refused_and_proves_nothing(alpha, x):
    """ψ_1 = h' + α(h) <= 0 keeps h <= 0 only if α is one: here at 0.5 m from a wall."""
    wall = {"normal": [1.0, 0.0], "offset": 0.5}
    double = {"type": "double-integrator", "acceleration": 1.0, "dimension": 2}
    steps = [{"type": f"attack_own:{alpha}"}, 1.0]
    with pytest.raises(ScenarioError, match=r"safety\.alpha\.0"):
        load(swarm([x], dynamics=double, alpha=steps, obstacles=[wall]))
    # Nor is it used where it was not asked for.
    import attack_own

    members = [Member("1", DoubleIntegrator(1.0, 0.0, 2), False)]
    pair = compose(members, [Wall((1.0, 0.0), 0.5)], Separation(1.0), 1.0).alone(0)
    alphas = [getattr(attack_own, alpha)(), Linear(1.0)]
    certificate = pair_certificate(pair, 0, alphas, [0.0], 0.1)
    assert certificate.times(np.array([x]), np.zeros(2))[0] <= (0.5 - x[0]) / x[2]


def nominal(name: str, sample: Sample, answer: np.ndarray) -> Sequence[float]:
    """Full speed, straight ahead, and agent 1 round to agent 2."""
    return (4.0, -2.0 * (name == "1")) if name in "123" else (2.0, 0.0)


def test_lies_about_how_inputs_were_made_change_nothing(tmp_path):
    scenario = load("unicycles", overrides={"duration": 1.5})
    honest, recorded = judged(scenario, tmp_path, nominal)
    lying, claimed = judged(scenario, tmp_path, nominal, Liars)
    assert {s.origin for s in claimed.steps} == {"qp"} != {s.origin for s in recorded.steps}
    assert lying.trajectory == honest.trajectory
    assert lying.certificates == honest.certificates
    assert lying.assumptions == honest.assumptions
    assert lying.theorem != honest.theorem  # where they are believed
    assert lying.outcome is honest.outcome is not Outcome.GUARANTEED


def test_sharp_corners_of_u_are_no_longer_than_they_are(tmp_path):
    """The needle, if every face moves out by 1e-5, is 1 m/s longer; its owner tries to use that."""
    needle = {"type": "attack_own:Needle", "speed": 1.0}
    single = {"type": "single-integrator", "speed": 1.0}
    table = swarm([[0.0, 0.0], [1.4, 0.0]], None, single, period=0.5, duration=1.0, other=needle)
    assert judged(table, tmp_path, ahead(agent2=-0.1))[0].outcome is Outcome.GUARANTEED
    actuators, x = Actuators(build_swarm(load(table))), np.zeros(4)
    for beyond, accepted in ((0.9e-5, True), (1.1e-5, False), (0.9, False)):
        assert actuators.takes(1, x, np.array([-0.1 - beyond, 0.0])) is accepted
    summary, _ = judged(table, tmp_path, ahead(agent2=-0.3))
    assert summary.outcome is Outcome.SAFE
    assert failed(summary) == {"admissible inputs"}


def test_who_cannot_stand_still_does_so_until_its_first_input(tmp_path):
    """Agent 2 flies from agent 1 as fast as that comes; for the latency its actuator holds zero."""
    flying = {"type": "attack_own:Flying", "speed": 2.0}
    single = {"type": "single-integrator", "speed": 1.0}
    table = swarm([[0.0, 0.0], [1.5, 0.0]], None, single, other=flying, duration=0.05)

    def away(name: str, sample: Sample, answer: np.ndarray) -> Sequence[float]:
        return (1.0, 0.0)

    assert judged(table, tmp_path, away)[0].outcome is Outcome.GUARANTEED
    late = judged(table | {"time": {"latency": 0.005}}, tmp_path, away)[0]
    assert late.outcome is Outcome.SAFE
    assert failed(late) == {"admissible inputs"}


def test_h_is_of_states_and_cannot_tell_agents_of_one_group_apart_by_name(tmp_path):
    """It asks for 2 m from agent 3 by the name of its symbols, which are the same for all."""
    table = swarm([[0.0, 0.0], [0.0, 8.0], [2.05, 0.0]], {"type": "attack_own:ByName"})
    whole = build_swarm(load(table)).safe_set
    x = np.array([0.0, 0.0, 0.0, 8.0, 1.95, 0.0])
    h = ca.Function("h", [whole.x], [whole.h])(x).full().ravel()
    assert h[:2] == pytest.approx([1.0 - 8.0**2, 1.0 - 1.95**2])
    summary, recording = judged(table, tmp_path, ahead(agent3=-1.0))
    checked = certify(load(table), recording.states, recording.steps)
    assert (summary.outcome is Outcome.GUARANTEED) == bool(checked)


def test_a_turn_that_no_step_sees_is_not_guaranteed(tmp_path):
    """2.00 turns in a step of 1 ms look like none: it passes the sphere straight ahead."""
    turning = 4000.0 * np.pi
    unicycle = {"type": "unicycle", "speed": 1.0, "turn_rate": 1.01 * turning, "offset": 0.01}
    sphere = {"center": [0.1, 3.0], "clearance": 1.0}
    table = swarm([[0.0, 0.0, 0.0]], None, unicycle, obstacles=[sphere])
    straight, _ = judged(table, tmp_path, lambda n, s, a: (1.0, 0.0))
    assert straight.outcome is Outcome.GUARANTEED
    summary, _ = judged(table, tmp_path, lambda n, s, a: (1.0, turning))
    assert summary.outcome is Outcome.SAFE
    assert failed(summary) == {"resolved motion"}
    assert "at any integration step" in summary.reason


def test_what_is_beyond_the_digits_of_a_state_is_not_guaranteed(tmp_path):
    """1e16 m away no step moves an agent, whatever input it holds."""
    table = swarm([[1e16, 0.0], [1e16, 90.0]])
    summary, _ = judged(table, tmp_path, ahead(agent1=1.0))
    assert summary.outcome is Outcome.SAFE
    assert "resolved motion" in failed(summary)


def test_what_every_short_step_rounds_away_is_not_guaranteed(tmp_path):
    """1e8 m away agent 2 drives 5 nm in a step of 1 µs, which its position does not show.

    It stands 500 nm off, and would be too near after 100 steps.
    """
    single = {"type": "single-integrator", "speed": 5e-3}
    table = swarm([[1e8, 0.0], [1e8 + 1.0 + 5e-7, 0.0]], None, single, period=1e-6, duration=2e-4)
    table["safety"]["function"]["radius"] = 1.0
    summary, recording = judged(table, tmp_path, ahead(agent2=-5e-3))
    assert recording.states[-1].x == recording.states[0].x
    assert summary.outcome is Outcome.SAFE
    assert failed(summary) == {"resolved motion"}
    with pytest.raises(UndecidedError, match="digits"):
        certify(load(table), recording.states, recording.steps)
