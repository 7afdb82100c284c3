"""Who is left out of an agent's certificates: nobody that it could meet."""

import numpy as np
import pytest

from phalanx.guarantee.certificate import MULTIPLES
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.guarantee.reachable import ReachableBoxes
from phalanx.plant.judge.coverage import Applied, Coverage
from phalanx.plant.world.motion import Motion
from tests.unit.swarms import swarm_of_scenario

LARGE = ("agents.0.count=42", "agents.1.count=6")


@pytest.mark.parametrize("name", ["swarm", "swarm2d", "unicycles", "pinned"])
def test_whoever_is_left_out_is_certified_for_as_long_as_any_certificate_lasts(name, rng):
    swarm = swarm_of_scenario(name, *(LARGE if name.startswith("swarm") else ()))
    certificates = SwarmCertificates(swarm)
    around = ReachableBoxes(swarm, swarm.scenario.safety.safe_set_function())
    i = swarm.normal[-1]
    agent = certificates.of(i)
    ends = certificates.ends[list(agent.pairs)]
    others = np.where(ends[:, 0] == i, ends[:, 1], ends[:, 0])
    motion, x, left_out = Motion(swarm.members, 1), swarm.start(), 0
    inputs = [swarm.members[l].dynamics for l in range(len(swarm.members))]
    still = np.zeros(len(x))
    for step in range(60):
        near = around.near(i, others, step * 0.01, x)
        # Whatever it does now: its input has no part in it.
        u = rng.uniform(-0.5, 0.5, len(inputs[i].inputs))
        asked, told = agent(x, u), agent(x, u, near)
        assert (asked == told).all()
        assert (asked[~near] == MULTIPLES[0] * agent.tau).all()
        left_out += int((~near).sum())
        pushed = rng.uniform(-0.5, 0.5, sum(len(d.inputs) for d in inputs))
        x = motion.steps(1, x, pushed, still, still, 0.01)[0][0]
    assert left_out > 30 * len(others) if name.startswith("swarm") else left_out >= 0


@pytest.mark.parametrize("function", ["ShortSighted", "Reaches"])
def test_what_a_users_function_says_of_its_reach_leaves_nobody_out(function):
    radius = ", radius = 1.0" if function == "ShortSighted" else ""
    own = f'safety.function={{ type = "tests.unit.theory.users_own:{function}"{radius} }}'
    swarm = swarm_of_scenario("swarm2d", own)
    coverage, x = Coverage(swarm), swarm.start()
    i, j = swarm.normal[:2]
    x[swarm.safe_set.parts[j]] = x[swarm.safe_set.parts[i]] + [1.5, 0.0, 0.0]
    (times,) = coverage.proven([Applied(i, 0.0, x, np.zeros(2))])
    assert (times == SwarmCertificates(swarm).of(i)(x, np.zeros(2))).all()
    assert times.min() == 0.0 or function == "Reaches"
