"""The disturbance that explains a motion: against motions of which the disturbance is known."""

from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from phalanx_plant.world.disturbance import RandomDisturbance

import phalanx
from phalanx.guarantee.disturbance_ledger import DisturbanceLedger
from phalanx.network.draws import Draws
from phalanx.recording.disturbances import disturbances_of
from phalanx.recording.read import read, swarm_of
from phalanx.schema.built_in import BUILT_IN
from phalanx.schema.registry import lookup
from phalanx.theory.models.aerial import IdentifiedQuadrotor, Quadrotor
from phalanx.theory.models.dynamics import Dynamics, weighted_rates
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.models.wheeled import DifferentialDrive, DynamicUnicycle, Unicycle
from tests.layers import layered

MODELS: list[Dynamics] = [
    SingleIntegrator(speed=2.0),
    DoubleIntegrator(acceleration=2.0),
    TripleIntegrator(jerk=2.0),
    Unicycle(speed=4.0, turn_rate=2.0),
    DynamicUnicycle(acceleration=4.0, turn_acceleration=8.0, drag=1.0, turn_drag=4.0),
    DifferentialDrive(wheel_rate=20.0, wheel_radius=0.05, track=0.3),
    Quadrotor(thrust=4.0, tilt=0.4),
    IdentifiedQuadrotor(3.0, 0.3, 0.11554, 0.05, stiffness=319.14, damping=20.85, drag=0.425),
]
WINDOWS, STEPS = 100, 200


class Windows(NamedTuple):
    """Motions of drawn length from drawn states, and the disturbance at both ends of each."""

    before: np.ndarray
    after: np.ndarray
    u: np.ndarray
    seconds: np.ndarray
    begin: np.ndarray
    end: np.ndarray

    @property
    def largest(self) -> np.ndarray:
        """The largest norm of a disturbance that is linear in between."""
        return np.maximum(*(np.linalg.norm(phi, axis=1) for phi in (self.begin, self.end)))


def windows(dynamics: Dynamics, size: float, change: float, longest: float = 0.1) -> Windows:
    """Draw windows of 1 % to all of `longest`; the disturbance has this norm and this change."""
    n, m = len(dynamics.states), len(dynamics.inputs)
    table = Draws(0, "ledger", type(dynamics).__name__, width=3 * n + m + 1)
    numbers = np.array([table[k] for k in range(WINDOWS)])
    x, one, two, inputs, when = np.split(numbers, np.cumsum([n, n, n, m]), axis=1)
    corners = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", n))).corners
    low, high = corners.min(axis=0), corners.max(axis=0)
    before, u = 2.0 * x - 1.0, low + (high - low) * inputs
    seconds = longest * 100.0 ** (when[:, 0] - 1)
    begin = size * direction(one)
    end = begin + change * direction(two)
    after = truly(dynamics)(*(each.T for each in (before, u, begin, end, seconds[:, None])))
    return Windows(before, np.array(after).T, u, seconds, begin, end)


def direction(numbers: np.ndarray) -> np.ndarray:
    centred = numbers - 0.5
    return centred / np.linalg.norm(centred, axis=1, keepdims=True)


def truly(dynamics: Dynamics) -> ca.Function:
    """The motion in many small steps."""
    x, u = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("u", len(dynamics.inputs))
    begin, end, T, s = ca.SX.sym("a", x.numel()), ca.SX.sym("b", x.numel()), ca.SX.sym("T"), 0
    field = ca.Function("f", [x, u], [dynamics.drift(x) + dynamics.actuation(x) @ u])
    s, dt = ca.SX.sym("s"), T / STEPS
    pushes = tuple(begin + (s + part) / STEPS * (end - begin) for part in (0.0, 0.5, 1.0))
    after = x + dt / 6 * weighted_rates(field, x, u, pushes, dt)
    step = ca.Function("step", [ca.vertcat(x, s), u, begin, end, T], [ca.vertcat(after, s + 1)])
    z, v, a, b, h = (ca.MX.sym(name, step.size1_in(k)) for k, name in enumerate("zvabh"))
    whole = step.fold(STEPS)(ca.vertcat(z[:-1], 0), *(ca.repmat(p, 1, STEPS) for p in (v, a, b, h)))
    start = ca.MX.sym("start", x.numel())
    end_of = ca.Function("end", [z, v, a, b, h], [whole[:-1]])
    motion = ca.Function("truly", [start, v, a, b, h], [end_of(ca.vertcat(start, 0), v, a, b, h)])
    return motion.map(WINDOWS)


def explained(dynamics: Dynamics, motions: Windows) -> np.ndarray:
    return DisturbanceLedger(dynamics).explain(*motions[:4]).size


def test_all_shipped_dynamics_are_tried():
    assert {type(m) for m in MODELS} == {lookup(Dynamics, name) for name in BUILT_IN[Dynamics]}


@pytest.mark.parametrize("dynamics", MODELS, ids=lambda model: type(model).__name__)
@pytest.mark.parametrize("size", [0.0, 1e-3, 0.3])
def test_a_constant_disturbance_is_found_and_never_understated(dynamics, size):
    explanation = DisturbanceLedger(dynamics).explain(*windows(dynamics, size, 0.0)[:4])
    sizes, norms = explanation.size, np.linalg.norm(explanation.phi, axis=1)
    assert (sizes >= size).all()
    np.testing.assert_allclose(norms, sizes, rtol=1e-15, err_msg="the judge sees the disturbance")
    assert (sizes <= 1.05 * size + 1e-4 * (size == 0.0)).all()


@pytest.mark.parametrize("dynamics", MODELS, ids=lambda model: type(model).__name__)
def test_a_linear_disturbance_is_understated_by_half_its_change_at_most(dynamics):
    # To first order in the length: angles that swing at 18 rad/s turn through half a radian.
    longest = 0.03 if isinstance(dynamics, IdentifiedQuadrotor) else 0.1
    change, motions = 0.1, windows(dynamics, 0.3, 0.1, longest)
    sizes = explained(dynamics, motions)
    assert (sizes >= motions.largest - 0.55 * change).all()
    assert (sizes <= 1.05 * motions.largest).all()
    assert (sizes < motions.largest).any()


def test_a_model_that_is_wrong_needs_a_disturbance():
    drawn = windows(MODELS[3], 0.0, 0.0)
    faster = drawn._replace(u=1.5 * drawn.u)
    assert np.median(explained(MODELS[3], faster)) > 0.3


def test_a_motion_to_nowhere_is_not_explained():
    drawn = windows(MODELS[3], 0.0, 0.0)
    lost = drawn._replace(after=np.full_like(drawn.after, np.nan))
    assert np.isinf(explained(MODELS[3], lost)).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", layered(("unicycles", "formation3d"), ("unicycles",)))
def test_a_recorded_run_gives_its_drawn_disturbances_back(name, tmp_path):
    scenario = phalanx.load(name, ["duration=0.5"])
    run = phalanx.run(scenario, engine="in-process", out=tmp_path)
    recording = read(run.folder)
    swarm = swarm_of(recording)
    for i, explanation in enumerate(disturbances_of(recording, swarm)):
        model, n = swarm.groups[i].disturbance, len(swarm.members[i].dynamics.states)
        source = RandomDisturbance(swarm.seeds, swarm.names[i], model, n)
        middle = np.array([source.line(t).at(t) for t in explanation.t + explanation.seconds / 2])
        allowed = 2.0 * model.bound * explanation.seconds / model.every  # half of a knot's jump
        assert (np.linalg.norm(explanation.phi - middle, axis=1) <= allowed + 1e-6).all()
        assert (explanation.size <= 1.001 * model.bound).all()
        assert len(explanation.t) > 4


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    scenario = phalanx.load("unicycles", ["duration=0.3"])
    folder = tmp_path_factory.mktemp("recorded")
    return read(phalanx.run(scenario, engine="in-process", out=folder).folder)


def intervals(recording, **changed):
    other = replace(recording, **changed)
    return [len(found.t) for found in disturbances_of(other, swarm_of(recording))]


@pytest.mark.slow
def test_an_agent_without_inputs_held_zero_all_along(recording):
    assert intervals(recording, steps=[]) == [1] * 5


@pytest.mark.slow
def test_intervals_whose_ends_are_not_recorded_are_left_out(recording):
    middle = [step.t_apply for step in recording.steps if step.agent == "1"][5]
    others = [state for state in recording.states if state.t != middle]
    assert intervals(recording, states=others)[0] == intervals(recording)[0] - 2


@pytest.mark.parametrize("states", [0, 1])
def test_a_recording_without_motion_has_no_interval(recording, states):
    assert intervals(recording, states=recording.states[:states]) == [0] * 5
