"""The defect of integration steps: never above its bound, and the bound is close."""

from dataclasses import dataclass

import casadi as ca
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from phalanx_plant.world.evaluation import Evaluation
from phalanx_plant.world.resolution import Resolution, Roundings
from phalanx_plant.world.segments import segments_of
from phalanx_plant.world.world import Segment, World

from phalanx.swarm.swarm import DEFECT
from phalanx.theory.models.integrators import SingleIntegrator
from tests.unit.swarms import rows_of_scenario, swarm_of_scenario

pytestmark = pytest.mark.slow

mpmath.mp.prec = 160


def unicycle(x, u, push):
    """Rate of a unicycle of true sines and cosines."""
    moving = [u[0] * mpmath.cos(x[2]), u[0] * mpmath.sin(x[2]), mpmath.mpf(u[1])]
    return [a + b for a, b in zip(moving, push, strict=True)]


def stepped(x, u, phi, slope, s):
    """A step of the classical Runge-Kutta method, of length s."""

    def push(t):
        return [a + t * b for a, b in zip(phi, slope, strict=True)]

    def moved(t, k):
        return [a + t * b for a, b in zip(x, k, strict=True)]

    k1 = unicycle(x, u, push(0))
    k2 = unicycle(moved(s / 2, k1), u, push(s / 2))
    k3 = unicycle(moved(s / 2, k2), u, push(s / 2))
    k4 = unicycle(moved(s, k3), u, push(s))
    rates = zip(k1, k2, k3, k4, strict=True)
    return moved(s / 6, [a + 2 * b + 2 * c + d for a, b, c, d in rates])


def true_defect(x, u, phi, slope, s) -> float:
    """Difference of the step's own rate from that of the equation, at s."""
    d = mpmath.mpf(2) ** -50
    ends = [stepped(x, u, phi, slope, s + side * d) for side in (-1, 1)]
    motion = [(b - a) / (2 * d) for a, b in zip(*ends, strict=True)]
    push = [a + s * b for a, b in zip(phi, slope, strict=True)]
    rate = unicycle(stepped(x, u, phi, slope, s), u, push)
    return float(mpmath.norm([a - b for a, b in zip(motion, rate, strict=True)]))


def segment(swarm, seed: int, turning: float) -> Segment:
    """A millisecond of three steps of unicycles, from anywhere."""
    rng, world = np.random.default_rng(seed), World(rows_of_scenario("unicycles"))
    integration = world.integration
    integration.x = rng.uniform(-5, 5, len(integration.x))
    for i in range(len(swarm.members)):
        integration.hold(i, rng.uniform(-1, 1, 2) * [4.0, turning])
    return next(p for p in integration.integrate(0.003) if isinstance(p, Segment))


@given(seed=st.integers(0, 2**32 - 1), turning=st.sampled_from([2.0, 60.0, 900.0, 12566.0]))
@settings(max_examples=30, deadline=None)
def test_no_step_is_farther_off_than_its_bound(seed, turning):
    swarm = swarm_of_scenario("unicycles")
    resolution, way = Resolution(swarm), segment(swarm, seed, turning)
    bound, dt = resolution.defect(segments_of([[way]])), way.dt
    starts = [way.start, *way.x[:-1]]
    for k, x in enumerate(starts):
        phi = way.phi + k * dt * way.slope
        for share in (0.3, 1.0):
            for i in range(len(swarm.members)):
                part = slice(3 * i, 3 * i + 3)
                state, push, push_rate = (list(map(float, v[part])) for v in (x, phi, way.slope))
                u = way.u[2 * i : 2 * i + 2].tolist()
                off = true_defect(state, u, push, push_rate, mpmath.mpf(share * dt))
                assert off <= bound
    assert turning > 2.0 or bound < 1e-5
    assert turning < 12566.0 or bound > DEFECT


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_steps_are_judged_together_as_each_is_alone(seed):
    swarm = swarm_of_scenario("unicycles")
    resolution, segments = Resolution(swarm), [segment(swarm, seed + k, 2.0) for k in range(4)]
    columns = segments_of([segments])
    together = resolution.defect(columns)
    alone, counts = (
        [resolution.defect(segments_of([[way]])) for way in segments],
        [len(p.x) for p in segments],
    )
    assert max(alone) <= together <= DEFECT / 2
    assert resolution.resolved(columns, np.full(sum(counts), DEFECT / 2)).all()
    # Between its own bound and that of all a rate leaves each step resolved, in any company.
    room = np.repeat(DEFECT - np.array(alone), counts)
    assert resolution.resolved(columns, 0.999 * room).all()
    assert not resolution.resolved(columns, 1.001 * room).any()
    segments[2] = segment(swarm, seed, 12566.0)
    counts = [len(p.x) for p in segments]
    answers = resolution.resolved(segments_of([segments]), np.zeros(sum(counts)))
    assert answers.tolist() == np.repeat([True, True, False, True], counts).tolist()


def test_a_bound_of_several_steps_holds_for_the_last_one_whose_push_has_grown():
    swarm = swarm_of_scenario("unicycles")
    way, resolution = segment(swarm, 0, 2.0), Resolution(swarm)
    slope = np.tile([0.0, 0.0, 1e6], len(swarm.members))  # up to 3000 rad/s after 3 ms
    grown = replace(way, phi=0.0 * slope, slope=slope)
    before = (len(way.x) - 1) * way.dt
    last = replace(grown, start=way.x[-2], x=way.x[-1:], phi=before * slope)
    assert (
        0.0 < resolution.defect(segments_of([[last]])) <= resolution.defect(segments_of([[grown]]))
    )


@pytest.mark.parametrize(("far", "resolved"), [(0.0, True), (1e10, False)])
def test_states_of_too_few_digits_are_not_resolved(far, resolved):
    rows = rows_of_scenario("one-on-one")
    integration = World(rows).integration
    integration.x = integration.x + far
    way = next(p for p in integration.integrate(0.003) if isinstance(p, Segment))
    (steps,) = Evaluation(rows).of([[way]])
    assert steps.resolved.tolist() == [resolved] * len(way.x)


@pytest.mark.parametrize(("dt", "steps"), [(1e-3, 1), (7e-4, 2), (1e-6, 1000)])
def test_every_step_rounds_a_state_however_short_it_is(dt, steps):
    """A million steps a second do so a thousand times as often as a thousand."""
    roundings, rates, x = Roundings(1e-3), list[float](), 1e4
    for batch in np.split(np.arange(1, 3001) * dt, 100):
        rates += roundings.rates(batch, np.full((len(batch), 1), x)).tolist()
    once = 2.0**-50 * x / 1e-3
    settled = np.array(rates[1500:])
    assert (once * (steps - 1e-9) <= settled).all()
    assert (settled <= once * (steps + 1 + 1e-9)).all()


def test_steps_of_one_float64_are_counted_and_not_divided_by():
    times = np.array([0.5, np.nextafter(0.5, 1.0), 0.501, 0.503])
    rates = Roundings(1e-3).rates(times, np.ones((4, 2)))
    assert (rates * 2.0**50 * 1e-3).tolist() == pytest.approx([1.0, 2.0, 2.0, 1.0])


@dataclass(frozen=True)
class Bumpy(SingleIntegrator):
    """A ripple in its way, too fine for a step, or a kink."""

    kink: bool = False

    def drift(self, x):
        ripple = ca.fabs(x[1]) if self.kink else ca.sin(1e6 * x[0])
        return ca.vertcat(0.05 * ripple, 0.0)


@pytest.mark.parametrize(
    ("kink", "y", "resolved"),
    [(False, 1.0, False), (True, 0.0, False), (True, -1e-4, False), (True, 1.0, True)],
)
def test_what_a_step_cannot_see_is_not_resolved(kink, y, resolved):
    dynamics = f"{{ type = '{__name__}:Bumpy', speed = 1.0, kink = {str(kink).lower()} }}"
    rows = rows_of_scenario("one-on-one", f"agents.0.dynamics={dynamics}")
    integration = World(rows).integration
    integration.x[:2] = 3e-7, y
    integration.hold(0, np.array([0.0, 1.0]))  # from -1e-4 across the kink in the first step
    way = next(p for p in integration.integrate(0.003) if isinstance(p, Segment))
    answers = Resolution(rows.swarm).resolved(segments_of([[way]]), np.zeros(len(way.x)))
    assert set(answers.tolist()) == {resolved}
