"""Agents left out of an agent's certificates: none that it could meet."""

import casadi as ca
import numpy as np
import pytest
from phalanx_plant.judge.coverage import Coverage
from phalanx_plant.world.motion import Motion

from phalanx.guarantee.certificate import MULTIPLES
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.guarantee.reachable import ReachableBoxes
from phalanx.recording.columns import inputs_of
from phalanx.scenario.load import load
from phalanx.swarm.swarm import DEFECT, Swarm, build_swarm
from phalanx.theory.models.integrators import SingleIntegrator
from tests.unit.plant.runs import STEP
from tests.unit.swarms import swarm_of_scenario
from tests.unit.tables import group, swarm_table

LARGE = ("agents.0.count=42", "agents.1.count=6")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["swarm", "swarm2d", "unicycles", "pinned"])
def test_pairs_left_out_are_certified_for_as_long_as_any_certificate_lasts(name, rng):
    swarm = swarm_of_scenario(name, *(LARGE if name.startswith("swarm") else ()))
    certificates = SwarmCertificates(swarm)
    around = ReachableBoxes(swarm, swarm.safety.safe_set_function)
    i = swarm.normal[-1]
    agent = certificates.of(i)
    ends = certificates.ends[list(agent.pairs)]
    others = np.where(ends[:, 0] == i, ends[:, 1], ends[:, 0])
    motion, x, left_out = Motion(swarm.members, 1), swarm.start(), 0
    inputs = [swarm.members[l].dynamics for l in range(len(swarm.members))]
    still = np.zeros(len(x))
    for step in range(60):
        near = met(around, i, others, step * 0.01, x)
        # Whatever it does now: its input has no part in it.
        u = rng.uniform(-0.5, 0.5, len(inputs[i].inputs))
        times, near_times = agent(x, u), agent(x, u, near)
        assert (times == near_times).all()
        assert (times[~near] == MULTIPLES[0] * agent.tau).all()
        left_out += int((~near).sum())
        pushed = rng.uniform(-0.5, 0.5, sum(len(d.inputs) for d in inputs))
        x = motion.steps(1, x, pushed, still, still, 0.01)[0][0]
    assert left_out > 30 * len(others) if name.startswith("swarm") else left_out >= 0


@pytest.mark.slow
@pytest.mark.parametrize("function", ["ShortSighted", "Reaches"])
def test_the_reach_of_a_users_function_leaves_no_agent_out(function):
    radius = ", radius = 1.0" if function == "ShortSighted" else ""
    override = f'safety.function={{ type = "tests.unit.theory.users_own:{function}"{radius} }}'
    swarm = swarm_of_scenario("swarm2d", override)
    coverage, x = Coverage(swarm), swarm.start()
    i, j = swarm.normal[:2]
    x[swarm.safe_set.parts[j]] = x[swarm.safe_set.parts[i]] + [1.5, 0.0, 0.0]
    widths = np.array([len(m.dynamics.inputs) for m in swarm.members])
    inputs = inputs_of([(0, i, 0, 0.0, 0.0, False)], [np.zeros(2)], [STEP], widths)
    times = coverage.proven(inputs, x[None]).seconds
    assert (times == SwarmCertificates(swarm).of(i)(x, np.zeros(2))).all()
    assert times.min() == 0.0 or function == "Reaches"


def met(boxes: ReachableBoxes, i: int, others: np.ndarray, t: float, x: np.ndarray) -> np.ndarray:
    """Return which others agent i may meet."""
    first = np.zeros(len(others), dtype=np.intp)
    return boxes.near(np.full(len(others), i), others, first, np.array([t]), x[None])


def three_on_a_line_and_a_sphere(dynamics: str = "single-integrator") -> Swarm:
    """a and b are not pushed, c is; a samples five times as often as the others.

    All go 1 m/s and keep 1 m apart, and 3 m away from (0, 50).
    """

    of_all = {"type": dynamics, "speed": 1.0}
    pushed = {"disturbance": {"bound": PUSHED, "every": 0.2}}
    agents = [
        group(name, "normal", [[x, 0.0]], period=period, **more, dynamics=of_all)
        for name, x, period, more in (
            ("a", 0.0, 0.01, {}), ("b", 100.0, 0.05, {}), ("c", 200.0, 0.05, pushed),
        )
    ]  # fmt: skip
    sphere = {"center": [0.0, 50.0], "clearance": 3.0}
    return build_swarm(load(swarm_table(*agents, safety={"eta": 0.0}, obstacles=[sphere])))


PUSHED = 0.5


@pytest.mark.parametrize(("within", "expected"), [(0.42, True), (0.43, False)])
def test_boxes_reach_as_far_as_the_longest_certificate_asked_while_they_are_kept(within, expected):
    """It lasts 8 periods of 0.05 s, and boxes are kept for half of one."""
    swarm = three_on_a_line_and_a_sphere()
    function = swarm.safety.safe_set_function
    distance, to_obstacle = 1.0 + (2.0 + PUSHED) * within, 3.0 + (1.0 + PUSHED) * within
    for where, other in (([distance, 0.0], 0), ([0.0, 50.0 - to_obstacle], 3)):
        x = np.array([0.0, 0.0, -500.0, 0.0, *where])
        near = met(ReachableBoxes(swarm, function), 2, np.array([other]), 0.0, x)
        assert near.tolist() == [expected]


def test_boxes_that_are_too_old_are_made_again():
    swarm, others = three_on_a_line_and_a_sphere(), np.array([0])
    boxes = ReachableBoxes(swarm, swarm.safety.safe_set_function)
    assert not met(boxes, 2, others, 0.0, swarm.start())
    assert met(boxes, 2, others, 0.026, np.zeros(6))
    # Of two inputs at once each has those of its own time.
    boxes = ReachableBoxes(swarm, swarm.safety.safe_set_function)
    pairs, times = (np.full(2, 2), np.zeros(2, dtype=int), np.arange(2)), np.array([0.0, 0.026])
    assert boxes.near(*pairs, times, np.array([swarm.start(), np.zeros(6)])).tolist() == [0, 1]


class Escaping(SingleIntegrator):
    """x' = x |x| / 10 + u_1: from x = ±100 on there is no state after 0.1 s."""

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(0.1 * x[0] * ca.fabs(x[0]), 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("begin", "expected"), [(0.0, False), (100.0, True), (-100.0, True)])
def test_who_is_in_no_certain_box_may_be_met_anywhere(begin, expected):
    swarm = three_on_a_line_and_a_sphere("tests.unit.guarantee.test_reachable:Escaping")
    boxes = ReachableBoxes(swarm, swarm.safety.safe_set_function)
    x = np.array([0.0, 0.0, 0.0, -500.0, begin, 500.0])
    assert met(boxes, 2, np.array([0]), 0.0, x).tolist() == [expected]


class Turned(SingleIntegrator):
    """Its output point is turned by an angle of which there is no interval rule."""

    def position(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[0] + 1e-9 * ca.fabs(x[0]) ** x[1], x[1])


def test_who_has_no_box_at_all_may_be_met_anywhere_in_a_swarm_of_one_group_too():
    dynamics = {"type": f"{__name__}:Turned", "speed": 1.0}
    pair = group("a b", "normal", [[0.0, 0.0], [500.0, 0.0]], dynamics=dynamics)
    swarm = build_swarm(load(swarm_table(pair, safety={"eta": 0.0})))
    boxes = ReachableBoxes(swarm, swarm.safety.safe_set_function)
    assert met(boxes, 0, np.array([1]), 0.0, swarm.start()).tolist() == [True]


def test_a_certificate_counts_on_what_integration_may_be_off_too():
    certificates = SwarmCertificates(three_on_a_line_and_a_sphere())
    pair = certificates.pairs.alone(0, 2)
    assert certificates.bounds(pair) == [DEFECT, PUSHED + DEFECT]


@pytest.mark.slow
@pytest.mark.parametrize("meeting", [0.06, 0.2])
def test_each_pair_is_certified_by_its_own_groups_periods_and_bounds(meeting):
    """a and c approach each other as fast as they can; b, in its place, would not be as fast."""
    certificates = SwarmCertificates(three_on_a_line_and_a_sphere())
    x = np.array([0.0, 0.0, -500.0, 0.0, 1.0 + (2.0 + PUSHED) * meeting, 0.0])
    for i, ahead in ((0, 1.0), (2, -1.0)):
        agent = certificates.of(i)
        (pair,) = (k for k, p in enumerate(agent.pairs) if set(certificates.ends[p]) == {0, 2})
        certified = agent(x, np.array([ahead, 0.0]))[pair]
        assert 0.7 * min(meeting, agent.longest) <= certified <= meeting
