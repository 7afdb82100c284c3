"""The disturbance: in its ball, continuous, a pure function of seed, agent and time."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phalanx_plant.world.disturbance import AdverseDisturbance, RandomDisturbance, SwarmDisturbance

from phalanx.scenario.agents import Disturbance
from tests.unit.swarms import rows_of_scenario

MODEL = Disturbance(bound=1.73, every=0.2)
times = st.floats(0.0, 20.0)


def phi(t: float, model: Disturbance = MODEL, n: int = 3) -> np.ndarray:
    return RandomDisturbance(0, "1", model, n).line(t).at(t)


@given(times, st.integers(1, 6))
def test_the_disturbance_stays_in_its_ball(t, n):
    assert np.linalg.norm(phi(t, n=n)) <= 1.73 * (1 + 1e-12)


def test_the_disturbance_uses_its_ball():
    sizes = [np.abs(phi(t)).max() for t in np.arange(0, 200, 0.2)]
    assert max(sizes) > 0.97 * 1.73 / np.sqrt(3)


@given(times, st.floats(1e-9, 1e-3))
def test_the_disturbance_is_continuous(t, dt):
    steepest = 2 * 1.73 / 0.2
    assert np.linalg.norm(phi(t + dt) - phi(t)) <= steepest * dt * 1.001 + 1e-12


@pytest.mark.parametrize("every", [0.2, 0.1, 0.07, 1 / 3])
def test_at_a_knot_the_next_line_begins_where_the_last_one_ended(every):
    source = RandomDisturbance(0, "1", Disturbance(bound=1.0, every=every), 3)
    t = 0.0
    for _ in range(500):
        line = source.line(t)
        assert line.begin <= t < line.end
        after = source.line(line.end)
        assert line.at(line.end) == pytest.approx(after.at(line.end), abs=1e-9)
        t = line.end


@given(st.lists(times, min_size=1, max_size=20))
def test_the_disturbance_does_not_depend_on_the_order_of_asking(order):
    source = RandomDisturbance(0, "1", MODEL, 3)
    for t in order:
        assert (source.line(t).at(t) == phi(t)).all()


def test_agents_are_disturbed_differently_and_no_bound_means_none():
    one, other = (RandomDisturbance(0, name, MODEL, 3).line(0.1).value for name in "12")
    assert (one != other).all()
    assert not phi(0.3, Disturbance(bound=0.0)).any()


def test_an_adverse_disturbance_pushes_along_the_gradient_of_the_last_psi_before_inputs():
    """The last is ψ_1 if q = 2, and its gradient contains that of h."""
    rows = rows_of_scenario("formation3d", "agents.1.disturbance.kind=adverse")
    swarm, chain = rows.swarm, rows.chain
    composed, x = swarm.safe_set, swarm.start()
    gradient = composed.substitute(ca.jacobian(chain.psi[-1], composed.x))
    expected = np.array(ca.Function("g", [composed.x], [gradient])(x))[0]
    pushed = SwarmDisturbance(rows).line(0.0, x).value
    for i, part in enumerate(composed.parts):
        if i not in swarm.normal:
            push = 0.4899 * expected[part] / np.linalg.norm(expected[part])
            assert pushed[part] == pytest.approx(push, rel=1e-10, abs=1e-14)


@pytest.mark.parametrize("size", [1.0, 1e-162, 1e-320])
def test_an_adverse_disturbance_has_its_bound_however_small_the_gradient_is(size):
    adverse = Disturbance(bound=0.2, kind="adverse")
    push = AdverseDisturbance(lambda x: size * x, slice(0, 3), adverse)
    assert np.linalg.norm(push.line(0.0, np.array([1.0, -2.0, 0.5])).value) == pytest.approx(0.2)


def test_an_adverse_disturbance_goes_on_from_where_it_was_though_the_gradient_has_changed():
    rows = rows_of_scenario("formation3d", "agents.1.disturbance.kind=adverse")
    disturbance, x = SwarmDisturbance(rows), rows.swarm.start()
    line = disturbance.line(0.0, x)
    after = disturbance.line(line.end, x + np.linspace(0.0, 1.0, len(x)))
    assert after.value == pytest.approx(line.at(line.end), abs=1e-12)
    assert after.at(after.end) != pytest.approx(after.value, abs=1e-3)


def test_the_swarms_disturbance_stacks_its_agents():
    rows = rows_of_scenario("unicycles", "agents.1.disturbance.every=0.13")
    swarm = rows.swarm
    stacked = SwarmDisturbance(rows)
    for t in (0.0, 0.05, 0.13, 0.2, 0.31):
        line = stacked.line(t, swarm.start())
        lines = [
            RandomDisturbance(0, name, swarm.groups[i].disturbance, 3).line(t)
            for i, name in enumerate(swarm.names)
        ]
        assert line.end == min(l.end for l in lines)
        middle = (t + line.end) / 2
        assert line.at(middle) == pytest.approx(np.concatenate([l.at(middle) for l in lines]))
