"""Agents that keep the rule of commitments stay apart, whatever their filters wish."""

from dataclasses import replace

import numpy as np
import pytest

from phalanx.knowledge.motion import PointMotion
from phalanx.promise.capsules import Capsules, balls
from phalanx.promise.hold import STILL, hold
from phalanx.promise.reach import Reach
from phalanx.promise.rule import Commitment
from phalanx.theory.models.integrators import DoubleIntegrator
from phalanx.theory.safety.obstacles import Box, Sphere
from tests.unit.knowledge.adverse import box_motion
from tests.unit.promise.members import RADIUS, STEP, disc, keep, member, none, run, towards
from tests.unit.promise.test_hold import UNICYCLE

VELOCITIES = box_motion(2, 1.5, 0.2, 0.0, 0.1, 0.02)
BRAKE = PointMotion(2, 4.0, 0.0, 0.2, 0.05, 0.02)
UNPUSHED = PointMotion(2, 4.0, 0.0, 0.0, 0.05, 0.02)
DRAG = PointMotion(2, 4.0, 0.6, 0.2, 0.05, 0.02)
SPACE = PointMotion(3, 4.0, 0.6, 0.1, 0.05, 0.02)


def nearest(m, members):
    return min((o for o in members if o is not m), key=lambda o: np.linalg.norm(o.p - m.p))


def rush(m, members):
    """A filter that wishes to hit the nearest, at all of its speeds."""
    return 0.5 ** (m.samples % 5) * towards(nearest(m, members).p, m)


def inwards(m, members, t):
    """φ towards the nearest, and turns towards it."""
    axes, phi = m.motion.axes, np.zeros(2 * m.motion.axes)
    way = nearest(m, members).p - m.p
    phi[(0 if m.motion.jumps else axes) :][:axes] = way / max(np.linalg.norm(way), 1e-9)
    cross = m.u[0] * way[1] - m.u[1] * way[0]
    return phi, float(np.sign(cross))


def circle(motion, count: int, radius: float):
    angles = 2.0 * np.pi * np.arange(count) / count
    points = radius * np.column_stack([np.cos(angles), np.sin(angles), np.sin(3.0 * angles)])
    return [member(motion, p[: motion.axes]) for p in points]


@pytest.mark.slow
@pytest.mark.parametrize(
    "motion",
    [
        pytest.param(VELOCITIES, id="velocities"),
        pytest.param(UNICYCLE, id="unicycles"),
        pytest.param(BRAKE, id="double integrators"),
        pytest.param(DRAG, id="drag", marks=pytest.mark.nightly),
        pytest.param(SPACE, id="space", marks=pytest.mark.nightly),
    ],
)
def test_filters_that_wish_to_hit_cannot(motion):
    members = circle(motion, 4, 1.3 if motion is UNICYCLE else 2.5)
    least = run(members, 3.0, np.random.default_rng(1), rush, inwards)
    assert 0.0 <= least < 1.1
    assert 0 < sum(m.wishes for m in members) < sum(m.samples for m in members)


@pytest.mark.slow
@pytest.mark.parametrize("motion", [VELOCITIES, BRAKE])
def test_no_obstacle_is_hit(motion):
    obstacles = [Sphere((2.5, 0.3), 1.0), Box((0.0, 3.0), (2.0, 0.5), 0.5)]
    agent, far = member(motion, [0.0, 0.0], obstacles), member(motion, [50.0, 0.0])
    nearer = []

    def look(t):
        nearer.append(min(o.distances(agent.p[None])[0] - o.clearance for o in obstacles))

    target = np.array([2.5, 0.3])
    for goal in (target, np.array([0.0, 3.0])):
        wish = lambda m, _, goal=goal: towards(goal, m)  # noqa: E731
        rng = np.random.default_rng(2)
        run([agent, far], 1.6, rng, wish, lambda m, *_: (np.zeros(4), 0.0), look=look)
    assert 0.0 <= min(nearer) < 0.3


def test_an_agent_between_others_that_keeps_no_input_keeps_its_fallback():
    agent = member(VELOCITIES, [0.0, 0.0])
    walls = [member(VELOCITIES, [1.1, 0.0]), member(VELOCITIES, [-1.1, 0.0])]
    keep(agent, [agent, *walls], 0.0, np.array([0.5, 0.0]))
    assert agent.wishes == 0
    assert agent.u.tolist() == [0.0, 0.0]
    assert agent.commitment.reference.z.tolist() == [0.0, 0.0, 0.0, 0.0]
    agent.x[0] = 0.01
    keep(agent, [agent, *walls], 0.05, np.array([0.5, 0.0]))
    assert agent.u[0] == pytest.approx(-0.01 / VELOCITIES.longest)


@pytest.mark.parametrize("axis", ["peers", "members", "obstacles"])
def test_an_input_is_refused_for_each_of_peers_members_and_obstacles_alone(axis):
    fallback, x = hold(VELOCITIES), np.zeros(4)
    u, ahead = np.array([1.0, 0.0]), np.array([1.5, 0.0])
    near = disc(ahead, 0.5)
    commitment = Commitment(
        fallback, RADIUS, [Sphere((1.5, 0.0), 1.5)] if axis == "obstacles" else []
    )
    sides = {"peers": none(2), "members": none(2)}
    room = commitment.room(x, u, **(sides | ({axis: near} if axis in sides else {})))
    assert room.least < 0.0
    assert getattr(room, axis).min() == room.least
    assert (
        room.least == commitment.room(x, u, **sides)._replace(**{axis: getattr(room, axis)}).least
    )


# Each part of an inequality decides alone: without it an agent leaves what was counted.

THOUGHT = {
    "φ": {"disturbance": 0.0},
    "turns": {"turning": 0.0},
    "τ": {"longest": 0.02, "shortest": 0.01},
}


def way_of(motion, u, phi) -> Capsules:
    """Points on the way of an agent that holds u for as long as it may, then its fallback."""
    agent, way, time = member(motion, np.zeros(4)), [], 0.0
    agent.u = u
    while time < 2.0:
        for _ in range(10):
            agent.move(0.1 * motion.longest, motion.disturbance * phi, 1.0)
            way.append(agent.p)
        time += motion.longest
        agent.u, agent.turned = agent.commitment.fallback_input(time, agent.x), 0.0
        agent.commitment.follow(False)
    return balls(np.array(way), np.zeros(len(way)))


@pytest.mark.parametrize(
    ("motion", "part"),
    [
        (VELOCITIES, "φ"),
        (VELOCITIES, "τ"),
        (UNICYCLE, "φ"),
        (UNICYCLE, "turns"),
        (UNICYCLE, "τ"),
        (BRAKE, "φ"),
        (UNPUSHED, "τ"),
    ],
)
def test_without_one_part_an_agent_leaves_its_tube_or_what_others_expect(motion, part):
    u = np.full(2, 1.5 if motion.jumps else 4.0)
    ahead = np.array([1.0, 1.0]) / np.sqrt(2.0)
    if motion is UNICYCLE:
        u = np.array([2.0, 0.5])
    if part == "turns":
        ahead = np.array([-u[1], u[0]]) / np.linalg.norm(u)
    phi = np.concatenate([ahead, 0.0 * ahead] if motion.jumps else [0.0 * ahead, ahead])
    way, fallback = way_of(motion, u, phi), hold(motion)
    mistaken = hold(replace(motion, **THOUGHT[part]))
    for tube in ("tube", "expected"):
        counted = (np.zeros(4), u) if tube == "tube" else (np.zeros((1, 4)),)
        assert getattr(fallback, tube)(*counted).gaps(way).max() <= 0.0
        # W counts a speed in every direction, so that turns change its tubes alone.
        if (tube, part) != ("expected", "turns"):
            assert getattr(mistaken, tube)(*counted).gaps(way).max() > 0.0


def test_a_tube_has_the_way_of_a_reference_that_a_disturbance_made_faster():
    fallback, agent = hold(BRAKE), member(BRAKE, [0.0, 0.0, 4.0, 0.0])
    tube, u = fallback.tube(agent.x, np.zeros(2)), np.array([0.0, 0.0, 1.0, 0.0])
    agent.move(BRAKE.longest, BRAKE.disturbance * u, 0.0)
    end = agent.p + agent.x[2:] * (agent.x[2] / (2.0 * BRAKE.authority) + BRAKE.longest)
    without_tracking = tube._replace(radius=tube.radius - BRAKE.tube)
    assert -0.02 < without_tracking.gaps(disc(end, 0.0))[0] <= 0.0


@pytest.mark.parametrize("motion", [VELOCITIES, BRAKE])
def test_w_counts_the_reference_that_others_do_not_see(motion):
    # It holds a place, and is at one end of its tube: it may come to be at the other.
    fallback, tube = hold(motion), motion.tube
    other_end = disc([-2.0 * tube, 0.0], 0.0)
    expected = fallback.expected(np.zeros((1, 4)))
    assert expected.gaps(other_end)[0] <= 0.0
    of_the_ball_around_it = expected._replace(radius=np.array([tube]))
    assert of_the_ball_around_it.gaps(other_end)[0] > 0.0


def test_the_distance_is_r_on_the_bound_and_a_step_to_each_side():
    commitment = Commitment(hold(VELOCITIES), RADIUS, [])
    tube = commitment.fallback.tube(np.zeros(4), np.zeros(2))
    bound = RADIUS + tube.radius[0] + 0.5 + 1e-6
    for off, holds in ((-1e-9, False), (1e-9, True)):
        near = disc([bound + off, 0.0], 0.5)
        for side in ((near, none(2)), (none(2), near)):
            assert (commitment.room(np.zeros(4), np.zeros(2), *side).least >= 0.0) is holds


@pytest.mark.parametrize("motion", [VELOCITIES, BRAKE])
def test_an_agent_that_moves_hits_no_attacker_and_one_that_stands_may_be_hit(motion):
    agent, attacker = member(motion, [0.0, 0.0]), np.array([3.0, 0.0])
    speed, contacts = 4.0, []

    def reach(m, time):
        return disc(attacker, speed * time)

    def wish(m, _):
        return 0.5 ** (m.samples % 6) * towards(np.array([4.0, 0.0]), m)

    def look(t):
        attacker[:] += STEP * speed * (agent.p - attacker) / np.linalg.norm(agent.p - attacker)
        reference = agent.commitment.reference
        moving = reference is None or np.linalg.norm(reference.z[2:]) > STILL
        contacts.append((np.linalg.norm(agent.p - attacker) < RADIUS, moving))

    rng = np.random.default_rng(5)
    run([agent, member(motion, [0.0, 80.0])], 2.0, rng, wish, inwards, reach, look)
    assert agent.wishes > 0
    assert any(hit for hit, _ in contacts)
    assert not any(hit and moving for hit, moving in contacts)


def test_a_member_reaches_no_farther_than_its_capsule():
    rng = np.random.default_rng(0)
    for drag in (0.0, 0.8):
        robot = Reach(DoubleIntegrator(acceleration=2.0, drag=drag, dimension=2), 0.1)
        motion = PointMotion(2, 2.0, drag, 0.1, 0.05, 0.02)
        x = np.array([1.0, 2.0, 1.5, -0.5])
        capsule, way = robot.within(x[None], x[None, :2], 0.6), []
        for run_number in range(20):
            agent = member(motion, x)
            for _ in range(12):
                agent.u, phi = 2.0 * rng.choice([-1.0, 1.0], 2), rng.normal(size=4)
                if run_number == 0:  # as far as it gets in one direction
                    agent.u, phi = np.array([2.0, 2.0]), np.array([1.0, 1.0, 0.0, 0.0])
                agent.move(0.05, 0.1 * phi / np.linalg.norm(phi), 0.0)
                way.append(agent.p)
        assert capsule.gaps(balls(np.array(way), np.zeros(len(way)))).max() <= 0.0
        assert capsule.radius[0] < 1.0
