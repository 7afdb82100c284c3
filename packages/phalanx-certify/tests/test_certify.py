"""phalanx certify: what it certifies is safe, and what is not safe it does not certify."""

import subprocess
import sys
from itertools import combinations, pairwise
from typing import Any

import casadi as ca
import msgspec
import numpy as np
import pytest
from phalanx_certify.checker.certify import Certification, certify
from phalanx_certify.checker.coverage import Coverage, HeldInputs, Inputs, _first_shared
from phalanx_certify.checker.intervals import Interval, UncertifiableError, UndecidedError, point
from phalanx_certify.checker.motions import GroupMotion, MotionCheck, require_digits

from phalanx.cli.app import status
from phalanx.faults.commands import Command, CommandKind, CommandPolicy
from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.run import Run, run
from phalanx.recording.read import Recording
from phalanx.recording.records import State, Step
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.rows.origin import Origin
from tests.unit.tables import group, swarm_table

OWN = '''
from dataclasses import dataclass

import casadi as ca

from phalanx.extend import SingleIntegrator


@dataclass(frozen=True)
class Zone:
    """Safe on one side of x = 0, and far beyond it: a jump, with no gradient anywhere."""

    kind: str

    def between(self, a, b):
        x = a.p[0]
        return {
            "if-else": ca.if_else(x < 0, -1.0, ca.if_else(x > 1e-3, -1.0, 1.0)),
            "sign": -ca.sign(x + 1e-4) * ca.sign(x - 1e-4),
            "floor": ca.fabs(ca.floor(1e3 * x) - 0.5) - 1.0,
            "bearing": ca.fabs(ca.atan2(x, a.p[1])) - 3.1,
            "kink": ca.fabs(x) - 1.0,
            "erf": ca.erf(x - b.p[0]) - 1.0,
            "smooth": -1.0 - x * x,
            "and": ca.if_else(ca.logic_and(x > 0, ca.SX(1)), ca.if_else(x < 1e-3, 1.0, -1.0), -1.0),
            "or": ca.if_else(ca.logic_or(x < 0, x > 1e-3), -1.0, 1.0),
            "not": ca.if_else(ca.logic_not(ca.logic_or(x < 0, x > 1e-3)), 1.0, -1.0),
            "all": 2 * ca.logic_all(ca.vertcat(x > 0, x < 1e-3)) - 1.0,
            "least": ca.fmin(x, ca.fmax(-x, -3.0)) - 1.0,
        }[self.kind]

    def to_obstacle(self, a, obstacle):
        return obstacle.intrusion(a.p)


@dataclass(frozen=True)
class Tiring(SingleIntegrator):
    """The farther out the slower."""

    def input_polytope(self, x):
        A, b = super().input_polytope(x)
        return A, b / (1.0 + ca.sumsqr(x))


@dataclass(frozen=True)
class Runaway(SingleIntegrator):
    """From 0 it is driven away, the farther out the faster."""

    gain: float = 1.0

    def drift(self, x):
        return self.gain * x


@dataclass(frozen=True)
class Sticking(SingleIntegrator):
    """Dry friction, which jumps where the motion turns."""

    def drift(self, x):
        return -0.1 * ca.sign(x)


@dataclass(frozen=True)
class Exploding(SingleIntegrator):
    """From 1 it is at infinity after a second."""

    def drift(self, x):
        return x * x


@dataclass(frozen=True)
class Kinked(SingleIntegrator):
    """Slower the farther out, with a kink at 0."""

    kind: str = "fabs"

    def drift(self, x):
        return -0.5 * {"fabs": ca.fabs(x), "fmax": ca.fmax(x, 0.0)}[self.kind]
'''


@pytest.fixture(scope="module", autouse=True)
def user_code(tmp_path_factory):
    folder = tmp_path_factory.mktemp("code")
    (folder / "certify_own.py").write_text(OWN)
    sys.path.insert(0, str(folder))
    yield
    sys.path.remove(str(folder))


@pytest.fixture(scope="module")
def unicycles(tmp_path_factory) -> Run:
    scenario = load("unicycles", overrides={"duration": 2.0})
    return run(scenario, engine="in-process", out=tmp_path_factory.mktemp("runs"))


def judged(recording: Recording) -> Certification:
    return certify(recording.scenario, recording.states, recording.steps)


def small_scenario(
    dynamics: dict[str, object],
    x: list[list[float]],
    function: dict[str, object] | None = None,
    bound: float = 0.0,
    period: float = 0.01,
    obstacles: tuple[dict[str, object], ...] = (),
    duration: float | None = None,
) -> Scenario:
    """A normal agent and, if x has a second state, an adversary."""
    roles = zip("12", ("normal", "adversary"), x, strict=False)
    fields: Any = {"dynamics": dynamics, "disturbance": {"bound": bound}, "period": period}
    agents = [group(name, role, [start], "worst", **fields) for name, role, start in roles]
    safety = {"rho": 1.0, "eta": 0.0} | ({"function": function} if function else {})
    lasts = duration or period
    return load(swarm_table(*agents, safety=safety, obstacles=list(obstacles), duration=lasts))


def step(agent: str, t: float, u: list[float]) -> Step:
    return Step(
        agent=agent, k=0, t=t, t_apply=t, u=tuple(u), origin=Origin.QP, residual=0.0,
        solve_time=0.0, ages=[], fates=[],
    )  # fmt: skip


def resting(scenario: Scenario, x: list[list[float]], inputs: int = 2) -> Certification:
    """The certification of agents that stay where they are until the end."""
    stacked = [component for state in x for component in state]
    steps = [step(name, 0.0, [0.0] * inputs) for name in ("1", "2")[: len(x)]]
    ends = [State(t, stacked, 0.0) for t in (0.0, scenario.duration)]
    return certify(scenario, ends, steps)


def test_the_papers_own_simulation_is_certified(unicycles):
    result = judged(unicycles.recording)
    assert result
    assert result.certified == result.samples > 500
    assert result.horizon >= 0.012


@pytest.mark.nightly
def test_no_margin_is_not_certified_and_the_gap_comes_before_the_violation(tmp_path):
    scenario = load("unicycles", overrides={"safety.eta": 0.0, "duration": 10.5}, seed=2)
    done = run(scenario, engine="in-process", out=tmp_path)
    assert done.verdict is Outcome.VIOLATED
    result, first = judged(done.recording), done.summary.violations[0]
    assert not result
    assert result.gap.pair == first.pair
    assert 0.0 < first.first - result.gap.t < 1.0


def tampered(recording: Recording, at: int, factor: float) -> list[Step]:
    steps = list(recording.steps)
    changed = tuple(factor * component for component in steps[at].u)
    steps[at] = msgspec.structs.replace(steps[at], u=changed)
    return steps


def test_without_disturbance_one_input_changed_by_a_percent_is_refused(tmp_path):
    overrides = {f"agents.{g}.disturbance.bound": 0.0 for g in (0, 1)} | {"duration": 0.5}
    recording = run(
        load("unicycles", overrides=overrides), engine="in-process", out=tmp_path
    ).recording
    assert judged(recording)
    moving = [k for k, s in enumerate(recording.steps) if s.t < 0.4 and np.abs(s.u).max() > 0.1]
    for at in np.random.default_rng(0).choice(moving, 20, replace=False):
        with pytest.raises(UncertifiableError, match="moves otherwise"):
            certify(recording.scenario, recording.states, tampered(recording, at, 0.99))


def test_with_disturbances_it_may_be_one_of_theirs_and_the_certificate_is_for_it(unicycles):
    recording = unicycles.recording
    at = next(k for k, s in enumerate(recording.steps) if s.t > 1.0 and s.agent == "1")
    result = certify(recording.scenario, recording.states, tampered(recording, at, 0.99))
    assert result.certified == result.samples
    with pytest.raises(UncertifiableError, match=r"agent 1 moves otherwise .* t = 1\.0"):
        certify(recording.scenario, recording.states, tampered(recording, at, -1.0))


def test_an_input_that_the_agent_does_not_have_is_refused(unicycles):
    recording = unicycles.recording
    with pytest.raises(UncertifiableError, match="an input that it does not have"):
        certify(recording.scenario, recording.states, tampered(recording, 40, 100.0))


@pytest.mark.parametrize("component", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_each_component_of_an_input_is_to_be_in_u(component, sign):
    """A unicycle, 4 m/s and 2 rad/s at most; actuators accept 1e-5 more."""
    motion = GroupMotion(small_scenario(*MODELS["unicycle"][:1], [[0.0] * 3]).agents[0], 0.0)
    u = np.array([[4.0, 4.0], [2.0, 2.0]])
    u[component] += (1e-5, 1e-4)
    u[component] *= sign
    assert motion.admits(u).tolist() == [True, False]


def test_an_input_that_took_effect_between_two_recorded_states_is_not_decided(unicycles):
    recording = unicycles.recording
    missing = next(s.t_apply for s in recording.steps if s.t > 1.0 and s.agent == "2")
    states = [state for state in recording.states if state.t != missing]
    with pytest.raises(UndecidedError, match="an input in a state not recorded"):
        certify(recording.scenario, states, recording.steps)


def test_a_silent_agent_leaves_a_gap_where_its_last_certificate_ends(tmp_path):
    freeze = CommandPolicy(schedule=(Command(0.5, CommandKind.FREEZE, "1"),))
    scenario = load("unicycles", overrides={"duration": 1.5})
    done = run(scenario, engine="in-process", out=tmp_path, commands=freeze)
    result = judged(done.recording)
    last = max(s.t for s in done.recording.steps if s.agent == "1")
    assert not result
    assert "1" in result.gap.pair
    assert result.certified == result.samples - 1
    assert last < result.gap.t <= last + 8 * 0.012 + 1e-9


def test_a_recording_that_ends_early_is_certified_no_further(unicycles):
    recording = unicycles.recording
    states = [s for s in recording.states if s.t <= 1.0]
    steps = [s for s in recording.steps if s.t <= 1.0]
    result = certify(recording.scenario, states, steps)
    assert not result
    assert result.gap.t == states[-1].t


SINGLE = {"type": "single-integrator", "speed": 1.0}


JUMPING = ["if-else", "sign", "floor", "bearing", "kink", "and", "or", "not", "all", "least"]


@pytest.mark.parametrize("kind", JUMPING)
def test_nothing_is_certified_across_a_jump(kind):
    x = [[0.0, -1.0], [5.0, 0.0]]
    assert not resting(small_scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": kind}), x)


@pytest.mark.parametrize("kind", JUMPING)
def test_nothing_is_certified_that_gets_to_a_jump(kind):
    x = [[-5e-3, -1e-6], [5.0, 0.0]]
    scenario = small_scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": kind})
    begin = State(0.0, [*x[0], *x[1]], 0.0)
    assert certify(scenario, [begin], [step("1", 0.0, [1.0, 0.0])]).horizon == 0.0


@pytest.mark.parametrize("kind", ["if-else", "and", "or", "not", "least"])
def test_some_way_off_a_jump_does_no_harm(kind):
    x = [[-0.5, -1.0], [5.0, 0.0]]
    assert resting(small_scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": kind}), x)


def test_a_smooth_function_of_ones_own_is_certified():
    x = [[0.0, -1.0], [5.0, 0.0]]
    assert resting(small_scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": "smooth"}), x)


def test_what_has_no_rule_or_varies_is_not_decided_and_named():
    x = [[0.0, -1.0], [5.0, 0.0]]
    with pytest.raises(UndecidedError, match="'erf'"):
        resting(small_scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": "erf"}), x)
    with pytest.raises(UndecidedError, match="agent 1 may apply vary"):
        resting(small_scenario({"type": "certify_own:Tiring", "speed": 1.0}, x), x)


def test_an_agent_that_passes_through_an_obstacle_between_states_is_not_certified():
    obstacle = {"center": [0.0, 0.0], "clearance": 0.5}
    fast = small_scenario(
        {"type": "single-integrator", "speed": 3000.0},
        [[-1.5, 0.0]],
        period=1e-3,
        obstacles=(obstacle,),
    )
    ends = [State(0.0, [-1.5, 0.0], -2.0), State(1e-3, [1.5, 0.0], -2.0)]
    result = certify(fast, ends, [step("1", 0.0, [3000.0, 0.0])])
    assert 1e-4 < result.gap.t <= 1e-3 / 3  # where it enters
    assert result.gap.pair == "1-obstacle 0"


@pytest.mark.parametrize(("bound", "speed"), [(0.0, 1.0), (0.5, 1.0), (0.5, 0.2), (0.3, -0.1)])
def test_against_a_wall_the_horizon_is_exact(bound, speed):
    """h is linear, so that nothing is lost but a billionth."""
    wall = {"normal": [1.0, 0.0], "offset": 1.0, "clearance": 0.1}
    scenario = small_scenario(SINGLE, [[0.0, 0.0]], bound=bound, period=2.0, obstacles=(wall,))
    ends = [State(0.0, [0.0, 0.0], -0.9)]
    result = certify(scenario, ends, [step("1", 0.0, [speed, 0.0])])
    exact = 0.9 / (speed + bound + 2.0 * DEFECT)  # integration, and rounding
    assert exact * (1.0 - 1e-8) < result.horizon <= exact


def test_until_the_first_input_takes_effect_actuators_hold_zero(tmp_path):
    scenario = load("unicycles", overrides={"time.latency": 0.004, "duration": 0.3})
    recording = run(scenario, engine="in-process", out=tmp_path).recording
    assert judged(recording)
    late = [s for s in recording.steps if s.t_apply > 0.02]
    with pytest.raises(UncertifiableError, match="moves otherwise"):
        certify(scenario, recording.states, late)


MODELS = {
    "unicycle": ({"type": "unicycle", "speed": 4.0, "turn_rate": 2.0}, 1.73, 3),
    "double-integrator": (
        {"type": "double-integrator", "acceleration": 4.0, "dimension": 2},
        0.5,
        4,
    ),
    "triple-integrator": ({"type": "triple-integrator", "jerk": 20.0, "dimension": 2}, 0.2, 6),
    "differential-drive": (
        {"type": "differential-drive", "wheel_rate": 20.0, "wheel_radius": 0.1, "track": 0.4},
        0.5,
        3,
    ),
    "bicycle": (
        {"type": "examples.bicycles:Bicycle", "acceleration": 4.0, "steering": 0.5},
        0.3,
        4,
    ),
}


@pytest.mark.parametrize(
    ("model", "starts"),
    [
        *(("unicycle", 4), ("triple-integrator", 4)),
        *(pytest.param(model, 20, marks=pytest.mark.nightly) for model in MODELS),
    ],
)
def test_no_motion_leaves_the_safe_set_while_its_certificate_lasts(model, starts):
    """Against inputs and disturbances held at their extremes, and others that are redrawn."""
    table, bound, n = MODELS[model]
    rng, lasted = np.random.default_rng(len(model)), []
    for _ in range(starts):
        x = rng.uniform(-1.0, 1.0, (2, n))
        angle, distance = rng.uniform(-np.pi, np.pi), rng.uniform(1.05, 1.8)
        x[0, :2], x[1, :2] = 0.0, (distance * np.cos(angle), distance * np.sin(angle))
        scenario = small_scenario(table, x.tolist(), bound=bound, period=0.05)
        dynamics = scenario.agents[0].dynamics_object()
        most = np.array(ca.DM(dynamics.input_polytope(ca.SX.sym("x", x.shape[1]))[1])).ravel()
        u = rng.choice([-1.0, 1.0], len(dynamics.inputs)) * most[: len(dynamics.inputs)]
        steps = [step("1", 0.0, u.tolist())]
        result = certify(scenario, [State(0.0, x.ravel().tolist(), 0.0)], steps)
        assert result.horizon > 0.0
        unsafe = first_unsafe(dynamics, x, u, most, bound, 4.0 * result.horizon, rng)
        assert unsafe > result.horizon
        lasted.append(result.horizon / min(unsafe, 0.2))
    assert np.median(lasted) > 0.3  # a bound that certified nothing would be no use


def moved(
    dynamics: Dynamics, x: np.ndarray, u: np.ndarray, phi: np.ndarray, dt: float, pieces: int = 100
) -> np.ndarray:
    """Integrate a motion over dt, with u and φ held, to the last digits."""
    state, h = ca.SX.sym("x", len(x)), dt / pieces
    rate = dynamics.drift(state) + dynamics.actuation(state) @ ca.DM(u) + ca.DM(phi)
    rates = ca.Function("f", [state], [rate])
    k1 = rates(state)
    k2 = rates(state + h / 2 * k1)
    k3 = rates(state + h / 2 * k2)
    after = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(state + h * k3))
    return np.array(ca.Function("step", [state], [after]).fold(pieces)(x)).ravel()


DEFECT = 1e-4
"""What counts as disturbance besides: the plant's integration steps [1/s]."""
FAR = ({"center": [1e3, 1e3], "clearance": 0.5},)
NEAR = ({"center": [2.0, 0.0], "clearance": 0.5},)


def recorded(
    model: str,
    times: list[float],
    rng: np.random.Generator,
    declared: float = 1.0,
    strength: float = 1.0,
    lean: float = 0.0,
) -> tuple[Scenario, list[State], list[Step]]:
    """One agent under random inputs and a φ of this strength, leant sideways [m/s].

    declared and strength: over the model's bound of φ, and over what is declared of it.
    """
    table, bound, n = MODELS[model]
    x, bound = np.zeros(n), declared * bound
    scenario = small_scenario(
        table, [x.tolist()], bound=bound, period=0.5, obstacles=FAR, duration=times[-1]
    )
    dynamics = scenario.agents[0].dynamics_object()
    most = GroupMotion(scenario.agents[0], 0.0).anywhere(1).lo.ravel() + 2e-5
    states, steps = [State(0.0, x.tolist(), 0.0)], list[Step]()
    for begin, end in pairwise(times):
        u, phi = rng.uniform(-1.0, 1.0, len(most)) * most, rng.normal(size=n)
        phi *= strength * bound / np.linalg.norm(phi)
        steps.append(step("1", begin, u.tolist()))
        x = moved(dynamics, x, u, phi, end - begin)
        x[1] += lean * (end - begin)
        states.append(State(end, x.tolist(), 0.0))
    return scenario, states, steps


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("bounded", [False, True])
def test_no_motion_is_refused_however_long_it_lasts(model, bounded):
    rng = np.random.default_rng(len(model))
    for _ in range(3):
        times = np.cumsum([0.0, *np.exp(rng.uniform(np.log(1e-4), np.log(0.3), 5))])
        scenario, states, steps = recorded(model, times.tolist(), rng, declared=float(bounded))
        assert certify(scenario, states, steps).samples == len(steps)


@pytest.mark.parametrize("model", MODELS)
def test_a_leant_track_is_refused_unless_a_disturbance_may_have_done_it(model):
    times = np.linspace(0.0, 0.05, 6).tolist()
    for lean in (0.03, -2e-4):
        rng = np.random.default_rng(1)
        leant = recorded(model, times, rng, declared=0.0, lean=lean)
        with pytest.raises(UncertifiableError, match=r"agent 1 moves otherwise .* t = 0\.0"):
            certify(*leant)
        assert certify(*recorded(model, times, rng, strength=0.5, lean=lean)).samples == 5


@pytest.mark.parametrize("model", MODELS)
def test_a_disturbance_that_is_a_tenth_larger_than_declared_is_refused(model):
    times = np.linspace(0.0, 0.02, 6).tolist()
    records = recorded(model, times, np.random.default_rng(2), strength=1.1)
    with pytest.raises(UncertifiableError, match="moves otherwise"):
        certify(*records)


@pytest.mark.parametrize("model", MODELS)
def test_what_a_motion_may_reach_is_enclosed_and_closely(model):
    table, bound, n = MODELS[model]
    rng = np.random.default_rng(3)
    for pieces in (1, 1, 4, 4):
        x, dt = rng.uniform(-1.0, 1.0, n), float(np.exp(rng.uniform(np.log(1e-3), np.log(0.2))))
        group = small_scenario(table, [x.tolist()], bound=bound, obstacles=FAR).agents[0]
        motion, dynamics = GroupMotion(group, 0.0), group.dynamics_object()
        most = motion.anywhere(1).hi.ravel()
        u = rng.uniform(-1.0, 1.0, len(most)) * most
        span = Interval(*np.full((2, 1), dt))
        result = MotionCheck(motion).reached(point(x[:, None]), point(u[:, None]), span, pieces)
        assert result.proven.all()
        y = moved(dynamics, x, u, np.zeros(n), dt)
        assert (result.y.lo.ravel() - 1e-12 <= y).all()
        assert (y <= result.y.hi.ravel() + 1e-12).all()
        fastest = np.abs(motion.enclosed(point(x[:, None]), point(u[:, None]), span.hi).rates.hi)
        assert (result.y.hi - result.y.lo).max() <= 1e-12 + 100.0 * dt**3 * fastest.max()
        for _ in range(3):
            phi = rng.normal(size=n)
            phi *= bound / np.linalg.norm(phi)
            off = np.linalg.norm(moved(dynamics, x, u, phi, dt) - y)
            assert off <= result.distance[0] + 1e-12
        assert result.distance[0] <= (bound + DEFECT) * dt * np.exp(5.0 * dt)


def test_drag_does_not_make_what_a_disturbance_does_grow():
    table = {"type": "double-integrator", "acceleration": 2.0, "drag": 20.0, "dimension": 2}
    group = small_scenario(table, [[0.0] * 4], bound=0.1, obstacles=FAR).agents[0]
    rest, span = point(np.zeros((4, 1))), Interval(*np.full((2, 1), 0.01))
    end = MotionCheck(GroupMotion(group, 0.0)).reached(rest, point(np.zeros((2, 1))), span, 1)
    assert end.proven.all()
    assert 0.001 <= end.distance[0] <= 1.01 * (0.1 + DEFECT) * 0.01


@pytest.mark.parametrize("drag", [0.93, 1.5, 4.0])
def test_long_intervals_are_certified_also_where_drag_is_strong(drag):
    """One box of all states within an interval is not found, but that of its parts is."""
    table = {"type": "double-integrator", "acceleration": 2.0, "drag": drag, "dimension": 2}
    x, u = np.array([0.0, 0.0, 1.0, -1.0]), np.array([1.0, 0.5])
    scenario = small_scenario(table, [x.tolist()], period=1.0, duration=2.0, obstacles=FAR)
    states, steps = [State(0.0, x.tolist(), 0.0)], list[Step]()
    for t in (0.0, 1.0):
        steps.append(step("1", t, u.tolist()))
        x = moved(scenario.agents[0].dynamics_object(), x, u, np.zeros(4), 1.0)
        states.append(State(t + 1.0, x.tolist(), 0.0))
    result = certify(scenario, states, steps)
    assert result
    assert result.horizon >= 1.0


def test_a_box_in_parts_holds_all_of_a_motion_and_all_of_its_rates():
    table = {"type": "double-integrator", "acceleration": 2.0, "drag": 1.5, "dimension": 2}
    group = small_scenario(table, [[0.0] * 4], bound=0.1, obstacles=FAR).agents[0]
    motion, u, phi = GroupMotion(group, 0.0), np.array([2.0, -1.0]), np.array([0.0, 0.0, 0.1, 0.0])
    x = np.array([0.0, 0.0, 1.0, 1.0])
    span = point(u[:, None])
    assert not motion.moved(x[:, None], span, np.ones(1)).proven
    result = motion.moved(x[:, None], span, np.ones(1), (1, 4, 16))
    assert result.proven
    for t in np.linspace(0.0, 1.0, 41):
        at = moved(group.dynamics_object(), x, u, phi, t)
        rate = np.array([*at[2:], *(u - 1.5 * at[2:])])
        assert (result.box.lo.ravel() <= at).all()
        assert (at <= result.box.hi.ravel()).all()
        assert (result.rates.lo.ravel() <= rate).all()
        assert (rate <= result.rates.hi.ravel()).all()


def test_a_box_in_parts_holds_what_a_disturbance_moves_in_all_of_them():
    """An agent at rest, with φ at its bound all the time, is 1 m away at the end."""
    motion = GroupMotion(
        small_scenario(SINGLE, [[0.0, 0.0]], bound=1.0, obstacles=FAR).agents[0], 0.0
    )
    rest = np.zeros((2, 1))
    box = motion.moved(rest, point(rest), np.ones(1), (4,)).box
    assert (box.lo <= -1.0).all()
    assert (box.hi >= 1.0).all()


def own_dynamics(name: str, **fields: object) -> dict[str, object]:
    return {"type": f"certify_own:{name}", "speed": 1.0, "dimension": 2, **fields}


def test_a_motion_without_bounds_is_not_decided_and_certifies_nothing():
    scenario = small_scenario(
        own_dynamics("Runaway", gain=20.0), [[1e-8, 0.0]], period=1.0, obstacles=NEAR
    )
    rest = [State(0.0, [1e-8, 0.0], 0.0)]
    assert certify(scenario, rest, []).horizon == 0.0  # it passes through, e^20 as far
    scenario = small_scenario(
        own_dynamics("Runaway", gain=5e3), [[1e-8, 0.0]], period=1.0, obstacles=NEAR
    )
    with pytest.raises(UndecidedError, match=r"whether agent 1 .* t = 0\.0+ s to 1\.0+ s"):
        certify(scenario, [*rest, State(1.0, [1.0, 0.0], 0.0)], [])


def test_a_motion_that_is_bounded_at_first_alone_is_not_known():
    group = small_scenario(own_dynamics("Exploding"), [[1.0, 0.0]], obstacles=FAR).agents[0]
    motion, x, u = GroupMotion(group, 0.0), np.array([[1.0], [0.0]]), point(np.zeros((2, 1)))
    assert motion.moved(x, u, np.full(1, 0.8 / 16)).proven
    assert not motion.moved(x, u, np.full(1, 0.8), (16,)).proven


def test_a_field_that_jumps_is_not_decided():
    ends = [State(t, [-t, 0.0], 0.0) for t in (0.0, 0.01)]
    scenario = small_scenario(own_dynamics("Sticking"), [[0.0, 0.0]], obstacles=FAR)
    with pytest.raises(UndecidedError, match="whether agent 1"):
        certify(scenario, ends, [step("1", 0.0, [-1.0, 0.0])])


@pytest.mark.parametrize("kind", ["fabs", "fmax"])
@pytest.mark.parametrize("bound", [0.0, 0.2])
def test_one_with_a_kink_is_followed_across_it(bound, kind):
    table = own_dynamics("Kinked", kind=kind)
    scenario = small_scenario(table, [[0.0, 0.0]], bound=bound, obstacles=FAR)
    x, u, steps = np.array([-4e-3, 1.0]), np.array([1.0, 0.0]), [step("1", 0.0, [1.0, 0.0])]
    phi = np.array([0.6, 0.8]) * 0.9 * bound
    x = moved(scenario.agents[0].dynamics_object(), begin := x, u, phi, 0.01, 10_000)
    ends = [State(0.0, begin.tolist(), 0.0), State(0.01, x.tolist(), 0.0)]
    assert certify(scenario, ends, steps).samples == 1
    ends[1].x[1] += 1e-5 + 2e-3 * bound
    with pytest.raises(UncertifiableError, match="moves otherwise"):
        certify(scenario, ends, steps)


@pytest.mark.parametrize("bound", [0.1, 1.0])
def test_a_disturbance_counts_in_how_fast_the_rate_of_h_grows(bound):
    """Against a wall at 10 m from rest: h + t φ + ½ t² φ, which is exact but for the ball."""
    table = {"type": "double-integrator", "acceleration": 1.0, "dimension": 2}
    wall = {"normal": [1.0, 0.0], "offset": 10.1, "clearance": 0.1}
    scenario = small_scenario(table, [[0.0] * 4], bound=bound, period=5.0, obstacles=(wall,))
    result = certify(scenario, [State(0.0, [0.0] * 4, -10.0)], [step("1", 0.0, [0.0, 0.0])])
    exact = np.sqrt(1.0 + 20.0 / (bound + 2.0 * DEFECT)) - 1.0
    assert exact * (1.0 - 1e-8) < result.horizon <= exact


@pytest.mark.parametrize("at", [1, 2047, 2048, 2049, 4096])
def test_every_state_of_a_long_recording_is_held_against_the_one_before(at):
    scenario = small_scenario(SINGLE, [[0.0, 0.0]], period=10.0, duration=5.0, obstacles=FAR)
    states = [State(1e-3 * k, [1e-6 * (k >= at), 0.0], 0.0) for k in range(5000)]
    with pytest.raises(UncertifiableError, match=f"t = {1e-3 * (at - 1):.6f} s"):
        certify(scenario, states, [])


def test_states_far_from_the_origin_may_follow_too_close_for_their_digits():
    """Each may be off by 10^7 · 2^-48 m: 0.36e-7 m, of 10^-7 m in any millisecond."""
    x, dense = np.full((2, 7), 1e7), np.array([0.0, 0.5, 1.0, 1.0001, 1.0002, 1.0003, 2.0])
    require_digits(np.arange(7.0), x)
    with pytest.raises(UndecidedError, match=r"4 states within 0\.001 s"):
        require_digits(dense, x)


def test_what_rounding_does_to_a_state_far_away_is_no_other_motion():
    scenario = small_scenario(SINGLE, [[1e6, 0.0]], obstacles=FAR, duration=1e-7)
    ends = [State(t, [1e6 + t, 0.0], 0.0) for t in (0.0, 1e-7)]
    assert certify(scenario, ends, [step("1", 0.0, [1.0, 0.0])]).samples == 1


@pytest.mark.parametrize("talking", ["1", "2", "nobody"])
@pytest.mark.parametrize("role", ["normal", "adversary"])
def test_a_pair_is_covered_by_either_normal_member_and_by_no_adversary(talking, role):
    """A silent agent holds its first input, far longer than a certificate lasts."""
    scenario = small_scenario(SINGLE, [[0.0, 0.0], [4.0, 0.0]], period=0.05, duration=2.0)
    second = scenario.agents[1].model_copy(update={"role": role})
    scenario = scenario.model_copy(update={"agents": (scenario.agents[0], second)})
    times = np.linspace(0.0, 2.0, 41).tolist()
    states = [State(t, [0.0, 0.0, 4.0, 0.0], 0.0) for t in times]
    steps = [step(name, 0.0, [0.0, 0.0]) for name in "12"]
    steps += [step(talking, t, [0.0, 0.0]) for t in times[1:] if talking in "12"]
    result = certify(scenario, states, steps)
    assert bool(result) == (talking == "1" or (talking == "2" and role == "normal"))


def test_a_gap_that_ends_where_another_begins_has_no_instant_in_common_with_it():
    ends_at_1_then_again = np.array([[0.0, 1.5], [1.0, 3.0]])
    assert _first_shared(np.array([[1.0], [2.0]]), ends_at_1_then_again) == [1.5]


def test_the_shortest_horizon_is_that_of_inputs_while_their_agent_was_normal():
    held = HeldInputs(np.array([0.0, 1.0]), np.array([1.0, 2.0]), np.zeros((1, 2)))
    inputs, pair = Inputs(np.array([0.0, 1.0, 2.0]), [held]), np.zeros(2, dtype=np.intp)
    coverage = Coverage(inputs, np.array([True, False]))
    coverage.add(0, pair, np.arange(2), np.array([0.75, 0.25]))
    assert coverage.horizon == 0.75


def mixed(rng: np.random.Generator) -> tuple[Scenario, list[State], list[Step]]:
    """Three groups and two obstacles; who moves is held where it is by a disturbance."""
    positions = rng.uniform(-4.0, 4.0, (8, 2))
    groups = [
        group(
            names,
            role,
            [positions[int(name) - 1].tolist() + [0.0] * len(turning) for name in names.split()],
            "worst",
            period=period,
            dynamics={"type": kind, "speed": speed} | turning,
            disturbance={"bound": speed + 0.1},
        )
        for names, role, kind, speed, turning, period in (
            ("1 2", "normal", "single-integrator", 0.5, {}, 0.03),
            ("3 4", "normal", "unicycle", 0.4, {"turn_rate": 0.4}, 0.05),
            ("5 6", "adversary", "single-integrator", 0.3, {}, 0.04),
        )
    ]
    spheres = [{"center": c, "clearance": 1.0} for c in positions[6:].tolist()]
    safety = {"rho": 1.0, "eta": 0.0}
    scenario = load(swarm_table(*groups, safety=safety, duration=0.2, obstacles=spheres))
    x = [number for part in scenario.agents for start in part.start for number in start]
    times = np.sort(rng.uniform(0.0, 0.2, 30))
    states = [State(float(t), x, 0.0) for t in (0.0, *times, 0.2)]
    steps = [
        step(str(rng.integers(1, 7)), float(t), rng.uniform(-0.2, 0.2, 2).tolist()) for t in times
    ]
    return scenario, states, steps


def only(
    whole: Scenario, states: list[State], steps: list[Step], names: tuple[str, ...], obstacle: int
) -> Certification:
    """The certification of these agents alone, and of one obstacle if it is one agent."""
    table, x = whole.model_dump(), np.array([s.x for s in states])
    table["obstacles"] = [table["obstacles"][obstacle]] if len(names) == 1 else []
    table["agents"] = [
        group | {"names": [name], "start": [group["start"][group["names"].index(name)]]}
        for group in table["agents"]
        for name in group["names"]
        if name in names
    ]
    sizes = {n: len(g.dynamics_object().states) for n, g, _ in whole.roster()}
    columns = np.repeat([name in names for name in sizes], list(sizes.values()))
    return certify(
        Scenario.model_validate(table),
        [State(s.t, row[columns].tolist(), 0.0) for s, row in zip(states, x, strict=True)],
        [s for s in steps if s.agent in names],
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_swarm_is_certified_as_each_of_its_pairs_would_be_alone(seed):
    scenario, states, steps = mixed(np.random.default_rng(seed))
    whole = certify(scenario, states, steps)
    pairs = [(a, b) for a, b in combinations("123456", 2) if a not in "56"]
    alone = [only(scenario, states, steps, pair, 0) for pair in pairs]
    alone += [only(scenario, states, steps, (name,), k) for name in "1234" for k in (0, 1)]
    assert whole.horizon == min(result.horizon for result in alone)
    gaps = [result.gap.t for result in alone if result.gap]
    assert (whole.gap.t if whole.gap else None) == min(gaps, default=None)


def first_unsafe(
    dynamics: Dynamics,
    x: np.ndarray,
    u: np.ndarray,
    most: np.ndarray,
    bound: float,
    until: float,
    rng: np.random.Generator,
    motions: int = 400,
    pieces: int = 80,
) -> float:
    """The first instant at which any of many motions has h > 0 [s]; inf if none has."""
    n, m = x.shape[1], len(u)
    state, u_pair = ca.SX.sym("x", 2 * n), ca.SX.sym("u", 2 * m)
    rates = [
        dynamics.drift(state[k * n : (k + 1) * n])
        + dynamics.actuation(state[k * n : (k + 1) * n]) @ u_pair[k * m : (k + 1) * m]
        for k in (0, 1)
    ]
    offset = dynamics.position(state[:n]) - dynamics.position(state[n:])
    h = 1.0 - ca.sumsqr(offset)
    field = ca.Function("f", [state, u_pair], [ca.vertcat(*rates)]).map(motions)
    rise = ca.Function("h", [state], [h, ca.jacobian(h, state).T]).map(motions)
    at = np.repeat(x.reshape(-1, 1), motions, axis=1)
    held = rng.choice([-1.0, 1.0], (m, motions)) * most[:m, None]
    aimless = rng.normal(size=(2 * n, motions))
    dt = until / pieces
    for piece in range(pieces):
        _, gradient = (np.array(value) for value in rise(at))
        phi = np.where(np.arange(motions) % 4 > 0, gradient, aimless).reshape(2, n, motions)
        phi = (bound * phi / np.maximum(np.linalg.norm(phi, axis=1, keepdims=True), 1e-9)).reshape(
            2 * n, motions
        )
        redrawn = rng.uniform(-1.0, 1.0, (m, motions)) * most[:m, None]
        other = np.where(np.arange(motions) % 2 > 0, held, redrawn)
        inputs = np.vstack([np.repeat(u[:, None], motions, axis=1), other])
        k1 = np.array(field(at, inputs)) + phi
        k2 = np.array(field(at + dt / 2 * k1, inputs)) + phi
        k3 = np.array(field(at + dt / 2 * k2, inputs)) + phi
        k4 = np.array(field(at + dt * k3, inputs)) + phi
        at = at + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if (np.array(rise(at)[0]) > 0.0).any():
            return (piece + 1) * dt
    return np.inf


def test_the_command_says_what_is_certified(unicycles, tmp_path, capsys):
    assert status(["certify", str(unicycles.folder)]) == 0
    assert "100.00%" in capsys.readouterr().out
    assert status(["certify", str(tmp_path)]) == 3
    assert "no such recording" in capsys.readouterr().err


@pytest.mark.parametrize(("rest", "shown"), [(0.5, "first not covered"), (1.0, "alone")])
def test_what_is_cut_short_is_not_certified_even_where_one_byte_is_missing(
    unicycles, tmp_path, capsys, rest, shown
):
    damaged = tmp_path / "damaged.mcap"
    whole = (unicycles.folder / "recording.mcap").read_bytes()
    damaged.write_bytes(whole[: int(rest * (len(whole) - 1))])
    assert status(["certify", str(damaged)]) == 1
    printed = capsys.readouterr()
    assert "cut short" in printed.err
    assert shown in printed.out


def test_what_is_not_decided_is_said_to_be_so_with_a_status_of_its_own(tmp_path, capsys):
    x = [[0.0, -1.0], [5.0, 0.0]]
    scenario = small_scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": "erf"})
    done = run(scenario, engine="in-process", out=tmp_path)
    assert status(["certify", str(done.folder), "--trust"]) == 4
    assert "not decided: no interval rule for the operation 'erf'" in capsys.readouterr().out


def test_a_turned_agents_pairs_are_not_counted_and_the_command_says_so(tmp_path, capsys):
    turn = CommandPolicy(schedule=(Command(0.1, CommandKind.TURN, "1"),))
    scenario = small_scenario(SINGLE, [[0.0, 0.0]], obstacles=NEAR, duration=2.0)
    done = run(scenario, engine="in-process", out=tmp_path, commands=turn)
    assert [violation.pair for violation in done.summary.excluded] == ["1-obstacle 0"]
    assert status(["certify", str(done.folder)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "pairs of agent 1 with no normal agent, from t = 0.1" in printed


def test_progress_goes_from_nothing_to_all(unicycles):
    recording, shares = unicycles.recording, list[float]()
    certify(recording.scenario, recording.states, recording.steps, shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(shares) > 5


@pytest.mark.nightly
def test_memory_does_not_grow_with_the_number_of_pairs(tmp_path):
    """The 6216 pairs of normal agents among 128 agents are compiled once for each kind."""
    overrides = {"duration": 0.003, "time.recording_step": 0.0}
    overrides |= {"agents.0.count": 112, "agents.1.count": 16}
    done = run(load("swarm2d", overrides=overrides), engine="in-process", out=tmp_path)
    command = [sys.executable, "-c", CERTIFIED, str(done.folder)]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert int(output.split()[-1]) < 250_000  # kB


# Its own memory: what wait4 says of a child is never less than what its parent had at the fork.
CERTIFIED = """
import re, sys
from phalanx.cli.app import status
assert status(["certify", sys.argv[1]]) == 0
print(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1])
"""
