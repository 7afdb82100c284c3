"""Agents by radio: the points that they are to peers, and what broadcasts repeat of others."""

import numpy as np
import pytest

from phalanx.knowledge.held import moved
from phalanx.network.inbox import AnnouncedInput, DeliveryReport
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.points import agent_point
from phalanx.swarm.statements import OwnStatement, StatementLedger
from phalanx.theory.rows.row import Rows
from tests.unit.swarms import swarm_of_scenario

OFFSET, FINE = 0.25, 32
WHEELS = "wheel_rate=12.0, wheel_radius=0.1, track=0.4"
POINTS = {
    "single-integrator": 'type="single-integrator", speed=1.5, dimension=2',
    "unicycle": 'type="unicycle", speed=2.0, turn_rate=2.0, offset=0.25',
    "differential-drive": f'type="differential-drive", {WHEELS}, offset=0.25',
}


def point(kind, *changes):
    dynamics = f"agents.0.dynamics={{{POINTS[kind]}}}"
    states = 2 if kind == "single-integrator" else 3
    start = f"agents.0.start={[[float(k)] * states for k in range(4)]}"
    return agent_point(swarm_of_scenario("crossing-radio", dynamics, start, *changes), 0)


def draw_state(kind, rng):
    return rng.normal(size=2 if kind == "single-integrator" else 3)


@pytest.mark.parametrize("kind", POINTS)
def test_a_point_moves_by_its_input_as_the_output_point_of_the_state(kind):
    rng, of = np.random.default_rng(1), point(kind)
    for _ in range(20):
        x, u = draw_state(kind, rng), rng.uniform(-1.0, 1.0, 2)
        w = of.input(x, u)
        np.testing.assert_allclose(of.applied(x, w), u, atol=1e-12)
        rows = Rows(rng.normal(size=(3, 2)), np.zeros(3))
        np.testing.assert_allclose(of.rows(x, rows).a @ w, rows.a @ u, atol=1e-12)
        there = moved(of.of(x), w, of.motion.held(np.array([0.1])))
        np.testing.assert_allclose(of.of(of.at(x, there)), there, atol=1e-12)
        assert np.array_equal(of.at(x, there)[2:], x[2:])


@pytest.mark.parametrize("kind", POINTS)
def test_the_set_of_inputs_turns_with_the_heading(kind):
    rng, of = np.random.default_rng(2), point(kind)
    x = draw_state(kind, rng)
    corners = of.motion.velocities.corners
    turn = of.turn(x)
    if turn is not None:
        corners = corners @ turn.T
    for corner in corners:
        u = of.applied(x, 0.999 * corner)
        np.testing.assert_allclose(of.input(x, u), 0.999 * corner, atol=1e-9)
        np.testing.assert_allclose(of.input(x, of.applied(x, 9.0 * corner)), corner, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("kind", POINTS)
def test_no_disturbance_leads_an_output_point_out_of_its_tube_or_takes_more_than_the_reserve(kind):
    rng, of = np.random.default_rng(3), point(kind)
    motion, farthest = of.motion, 0.0
    x = draw_state(kind, rng)
    z = of.of(x)
    for step in range(300):
        pull = motion.tracking.pull(of.of(x) - z)
        assert np.linalg.norm(pull) <= motion.reserve * (1.0 + 1e-9)
        turn = of.turn(x)
        # A long time at each corner: the heading turns one way.
        w = motion.inputs.corners[step // 40 % len(motion.inputs.corners)]
        w = w if turn is None else turn @ w
        u = of.applied(x, w + pull)
        np.testing.assert_allclose(of.input(x, u), w + pull, atol=1e-9)
        gap = motion.longest if step % 3 else float(rng.uniform(motion.shortest, motion.longest))
        for _ in range(FINE):
            outwards = (of.of(x) - z)[:2] + 1e-6
            x = x + gap / FINE * (rate(kind, x, u) + 0.1 * pushing(x, outwards))
            z = moved(z, w, motion.held(np.array([gap / FINE])))
            farthest = max(farthest, np.linalg.norm((of.of(x) - z)[:2]))
    assert 0.5 * motion.tube < farthest <= 1.01 * motion.tube, "but for Euler's error"


def rate(kind, x, u):
    """x' without φ."""
    if kind == "single-integrator":
        return u
    ahead, turn = u
    if kind == "differential-drive":
        ahead, turn = 0.1 * (u[0] + u[1]) / 2.0, 0.1 * (u[1] - u[0]) / 0.4
    return np.array([ahead * np.cos(x[2]), ahead * np.sin(x[2]), turn])


def pushing(x, outwards):
    """The φ of size 1 that moves the output point farthest."""
    if len(x) == 3:
        sideways = outwards[1] * np.cos(x[2]) - outwards[0] * np.sin(x[2])
        outwards = np.array([*outwards, OFFSET * sideways])
    return outwards / np.linalg.norm(outwards)


def test_a_disturbance_that_no_input_can_hold_a_place_against_is_refused_with_both_numbers():
    of = point("unicycle", "agents.0.disturbance.bound=0.4")
    with pytest.raises(ValueError, match=r"takes 0\.5\d+ m/s in each direction.* has 0\.5"):
        _ = of.motion.tube


def test_dynamics_that_are_no_points_are_refused():
    changes = {
        "dynamics": '{type="dynamic-unicycle", acceleration=2.0, turn_acceleration=4.0}',
        "start": [[float(k)] * 5 for k in range(8)],
        "spread": [],
    }
    swarm = swarm_of_scenario("radio", *(f"agents.0.{k}={v}" for k, v in changes.items()))
    with pytest.raises(ScenarioError, match=r"single- or .* got dynamic-unicycle"):
        agent_point(swarm, 0)


ZERO, REST = (0.0, 0.0), (0.0, 0.0, 0.0, 0.0)


def test_of_what_an_agent_has_heard_it_repeats_the_newest_and_no_more_than_it_may():
    """Agent 1 had older news of agent 2 than of agent 3, and repeats one of them to agent 4."""
    ledger = StatementLedger(swarm_of_scenario("radio", "agents.0.radio.relays=1"))
    for l, k in ((1, 5), (2, 7)):
        ledger.known[0][l] = OwnStatement(k, 0.1 * k, REST, 0.1 * k, ZERO)
    ledger.sampled(0, 1.0, 0, REST, [], [])
    fate = DeliveryReport(0, 0, 0.0, (), AnnouncedInput(1.0, ZERO, REST))
    ledger.sampled(3, 1.1, 1, REST, [fate], [])
    assert {l: ledger.known[3][l].k for l in (0, 1, 2)} == {0: 0, 1: -1, 2: 7}
    ledger.known[0][3] = OwnStatement(9, 0.9, REST, 0.9, ZERO)
    ledger.sampled(0, 1.0, 0, REST, [], [])
    ledger.sampled(3, 1.1, 1, REST, [fate], [])
    assert 3 not in ledger.known[3], "which is no peer of its own"
    slow = DeliveryReport(0, 0, 0.5, (), fate.claim)
    ledger.sampled(3, 1.2, 2, REST, [slow], [])
    ledger.restarted(3)
    ledger.sampled(3, 2.0, 3, REST, [], [])
    assert not ledger.known[3], "what is on its way reaches no later process"
