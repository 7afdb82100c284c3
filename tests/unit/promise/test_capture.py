"""A pursuer that outruns an agent has come too near by the time that is said, whatever it does."""

import numpy as np
import pytest

from phalanx.guarantee.impossible import impossible
from phalanx.promise.capture import capture
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from tests.unit.swarms import swarm_of_scenario

RADIUS, STEP, PHI = 1.0, 0.01, 0.3
POINT = {"dynamics": SingleIntegrator, "bound": "speed"}
DRAG = {"dynamics": DoubleIntegrator, "bound": "acceleration", "drag": 0.5}


def model(of: dict, bound: float, dimension: int = 2):
    more = {name: value for name, value in of.items() if name == "drag"}
    return of["dynamics"](**{of["bound"]: bound}, dimension=dimension, **more)


def unsafe_at(of: dict, bounds: tuple[float, float], x: np.ndarray, flee) -> float:
    """The time at which a pursuer that aims along s, helped by both disturbances, is within R."""
    drag, (r, w), t = of.get("drag"), x.reshape(2, 2).copy(), 0.0
    while np.linalg.norm(r) > RADIUS:
        s = r + w / drag if drag else r
        n = s / max(np.linalg.norm(s), 1e-12)
        push = bounds[0] * np.clip(flee(r, t), -1.0, 1.0) - bounds[1] * np.sign(n) - PHI * n
        w = w + STEP * (push - drag * w) if drag else push
        r, t = r + STEP * w, t + STEP
    return t


@pytest.mark.parametrize("of", [POINT, DRAG], ids=["points", "drag"])
@pytest.mark.parametrize("bounds", [(1.0, 1.4), (1.1, 1.0)])
def test_no_way_of_fleeing_takes_longer(of, bounds):
    rng, able = np.random.default_rng(0), capture(model(of, bounds[0]), model(of, bounds[1]), PHI)
    assert able.closing > 0.0
    times, latest = [], []
    for turn, start in ((0.0, [3.0, 0.0]), (0.0, [2.2, 2.2]), (0.8, [2.0, 2.5])):
        x = np.concatenate([start, rng.uniform(-1.0, 1.0, 2) * ("drag" in of)])
        a = x if "drag" in of else x[:2]
        latest.append(able.time(a, 0.0 * a, RADIUS))

        def flee(r, t, turn=turn):
            c, s = np.cos(turn * t), np.sin(turn * t)
            return 9.0 * np.array([c * r[0] - s * r[1], s * r[0] + c * r[1]])

        times.append(unsafe_at(of, bounds, x, flee))
    assert (np.array(times) <= np.array(latest) + 0.05).all()
    assert times[0] > 0.5 * latest[0]


def test_nothing_is_captures_of_one_that_is_outrun_nor_of_other_drags():
    slow, fast = (model(POINT, bound) for bound in (1.0, 2.0))
    assert capture(fast, slow, 1.0).time(np.array([9.0, 0.0]), np.zeros(2), RADIUS) == np.inf
    assert capture(fast, slow, 1.0).outrun == pytest.approx(np.sqrt(2.0))
    assert capture(model(DRAG, 1.0), model(DRAG | {"drag": 0.6}, 1.0), 9.0) is None
    assert capture(slow, slow, 0.5).time(np.array([0.5, 0.0]), np.zeros(2), RADIUS) == 0.0


@pytest.mark.slow
def test_at_the_printed_disturbance_no_agent_of_simulation_2_gets_away():
    captures = impossible(swarm_of_scenario("formation3d"))
    assert len(captures.times) == 16
    assert min(captures.times.values()) == pytest.approx(106.744, abs=1e-3)
    exit_, for_ever = captures.sentences
    assert "4 makes 5.12 m/s with its disturbance, 0 2.85" in exit_
    assert "4 closes at 0.171 m/s or more, with the disturbances of both" in for_ever
    (faster,) = impossible(swarm_of_scenario("unicycles", "agents.1.dynamics.speed=9.0")).sentences
    assert "no bound would do" in faster
