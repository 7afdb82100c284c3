"""phalanx certify: what it certifies is safe, and what is not safe it does not certify."""

import sys

import casadi as ca
import numpy as np
import pytest

from phalanx.cli.app import status
from phalanx.faults.commands import Command, CommandKind, CommandPolicy
from phalanx.guarantee.checker.certify import Certification, certify
from phalanx.guarantee.checker.intervals import UncertifiableError
from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.run import Run
from phalanx.launcher.start import run
from phalanx.recording.read import Recording
from phalanx.recording.records import State, Step
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario
from phalanx.theory.models.dynamics import Dynamics

OWN = '''
from dataclasses import dataclass

import casadi as ca

from phalanx.theory.models.integrators import SingleIntegrator


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
            "erf": ca.erf(x) - 1.0,
            "smooth": -1.0 - x * x,
        }[self.kind]

    def to_obstacle(self, a, obstacle):
        return obstacle.intrusion(a.p)


@dataclass(frozen=True)
class Tiring(SingleIntegrator):
    """The farther out the slower."""

    def input_polytope(self, x):
        A, b = super().input_polytope(x)
        return A, b / (1.0 + ca.sumsqr(x))
'''


@pytest.fixture(scope="module", autouse=True)
def own(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
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


def scenario(
    dynamics: dict[str, object],
    x: list[list[float]],
    function: dict[str, object] | None = None,
    bound: float = 0.0,
    period: float = 0.01,
    obstacles: tuple[dict[str, object], ...] = (),
    duration: float | None = None,
) -> Scenario:
    """A normal agent and, if x has a second state, an adversary."""
    group = {
        "dynamics": dynamics,
        "law": {"type": "worst"},
        "clock": {"period": period},
        "disturbance": {"bound": bound},
    }
    roles = list(zip(("normal", "adversary"), ("1", "2"), x, strict=False))
    return Scenario.model_validate(
        {
            "name": "two",
            "duration": duration or period,
            "safety": {
                "function": function or {"type": "separation", "radius": 1.0},
                "rho": 1.0,
                "alpha": [1.0],
                "eta": 0.0,
            },
            "obstacles": obstacles,
            "agents": [group | {"names": [n], "role": r, "start": [s]} for r, n, s in roles],
        }
    )


def step(agent: str, t: float, u: list[float]) -> Step:
    return Step(agent, 0, t, t, u, "qp", 0.0, 0.0, [], [])


def resting(given: Scenario, x: list[list[float]], inputs: int = 2) -> Certification:
    """The certification of agents that stay where they are until the end."""
    stacked = [component for state in x for component in state]
    steps = [step(name, 0.0, [0.0] * inputs) for name in ("1", "2")[: len(x)]]
    ends = [State(t, stacked, 0.0) for t in (0.0, given.duration)]
    return certify(given, ends, steps)


def test_the_papers_own_simulation_is_certified(unicycles):
    found = judged(unicycles.recording)
    assert found
    assert found.certified == found.samples > 500
    assert found.horizon >= 0.012


def test_no_margin_is_not_certified_and_the_gap_comes_before_the_violation(tmp_path):
    given = load("unicycles", overrides={"safety.eta": 0.0, "duration": 10.5}, seed=2)
    done = run(given, engine="in-process", out=tmp_path)
    assert done.verdict is Outcome.VIOLATED
    found, first = judged(done.recording), done.summary.violations[0]
    assert not found
    assert found.gap.pair == first.pair
    assert 0.0 < first.first - found.gap.t < 1.0


def tampered(recording: Recording, at: int, factor: float) -> list[Step]:
    steps = list(recording.steps)
    old = steps[at]
    steps[at] = Step(**{f: getattr(old, f) for f in old.__struct_fields__})
    steps[at].u = [factor * component for component in old.u]
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
    found = certify(recording.scenario, recording.states, tampered(recording, at, 0.99))
    assert found.certified == found.samples
    with pytest.raises(UncertifiableError, match=r"agent 1 moves otherwise .* t = 1\.0"):
        certify(recording.scenario, recording.states, tampered(recording, at, -1.0))


def test_an_input_that_the_agent_does_not_have_is_refused(unicycles):
    recording = unicycles.recording
    with pytest.raises(UncertifiableError, match="an input that it does not have"):
        certify(recording.scenario, recording.states, tampered(recording, 40, 100.0))


def test_a_smaller_disturbance_bound_than_there_was_is_refused(unicycles):
    recording = unicycles.recording
    groups = [
        g.model_copy(update={"disturbance": g.disturbance.model_copy(update={"bound": 0.2})})
        for g in recording.scenario.agents
    ]
    claimed = recording.scenario.model_copy(update={"agents": tuple(groups)})
    with pytest.raises(UncertifiableError, match="moves otherwise"):
        certify(claimed, recording.states, recording.steps)


def test_a_silent_agent_leaves_a_gap_where_its_last_certificate_ends(tmp_path):
    freeze = CommandPolicy(schedule=(Command(0.5, CommandKind.FREEZE, "1"),))
    given = load("unicycles", overrides={"duration": 1.5})
    done = run(given, engine="in-process", out=tmp_path, commands=freeze)
    found = judged(done.recording)
    last = max(s.t for s in done.recording.steps if s.agent == "1")
    assert not found
    assert "1" in found.gap.pair
    assert found.certified == found.samples - 1
    assert last < found.gap.t <= last + 8 * 0.012 + 1e-9


def test_a_recording_that_ends_early_is_certified_no_further(unicycles):
    recording = unicycles.recording
    states = [s for s in recording.states if s.t <= 1.0]
    steps = [s for s in recording.steps if s.t <= 1.0]
    found = certify(recording.scenario, states, steps)
    assert not found
    assert found.gap.t == states[-1].t


SINGLE = {"type": "single-integrator", "speed": 1.0}


@pytest.mark.parametrize("kind", ["if-else", "sign", "floor", "bearing", "kink"])
def test_nothing_is_certified_across_a_jump(kind):
    x = [[0.0, -1.0], [5.0, 0.0]]
    assert not resting(scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": kind}), x)


def test_some_way_off_a_jump_does_no_harm():
    x = [[-0.5, -1.0], [5.0, 0.0]]
    assert resting(scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": "if-else"}), x)


def test_a_smooth_function_of_ones_own_is_certified():
    x = [[0.0, -1.0], [5.0, 0.0]]
    assert resting(scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": "smooth"}), x)


def test_what_has_no_rule_or_varies_is_refused_by_name():
    x = [[0.0, -1.0], [5.0, 0.0]]
    with pytest.raises(UncertifiableError, match="'erf'"):
        resting(scenario(SINGLE, x, {"type": "certify_own:Zone", "kind": "erf"}), x)
    with pytest.raises(UncertifiableError, match="agent 1 may apply vary"):
        resting(scenario({"type": "certify_own:Tiring", "speed": 1.0}, x), x)


def test_an_agent_that_passes_through_an_obstacle_between_states_is_not_certified():
    obstacle = {"center": [0.0, 0.0], "clearance": 0.5}
    fast = scenario(
        {"type": "single-integrator", "speed": 3000.0},
        [[-1.5, 0.0]],
        period=1e-3,
        obstacles=(obstacle,),
    )
    ends = [State(0.0, [-1.5, 0.0], -2.0), State(1e-3, [1.5, 0.0], -2.0)]
    found = certify(fast, ends, [step("1", 0.0, [3000.0, 0.0])])
    assert 1e-4 < found.gap.t <= 1e-3 / 3  # where it enters
    assert found.gap.pair == "1-obstacle 0"


@pytest.mark.parametrize(("bound", "speed"), [(0.0, 1.0), (0.5, 1.0), (0.5, 0.2), (0.3, -0.1)])
def test_against_a_wall_the_horizon_is_exact(bound, speed):
    """h is linear, so that nothing is lost but a billionth."""
    wall = {"normal": [1.0, 0.0], "offset": 1.0, "clearance": 0.1}
    given = scenario(SINGLE, [[0.0, 0.0]], bound=bound, period=2.0, obstacles=(wall,))
    ends = [State(0.0, [0.0, 0.0], -0.9)]
    found = certify(given, ends, [step("1", 0.0, [speed, 0.0])])
    exact = 0.9 / (speed + bound)
    assert exact * (1.0 - 1e-8) < found.horizon <= exact


def test_until_the_first_input_takes_effect_actuators_hold_zero(tmp_path):
    given = load("unicycles", overrides={"time.latency": 0.004, "duration": 0.3})
    recording = run(given, engine="in-process", out=tmp_path).recording
    assert judged(recording)
    late = [s for s in recording.steps if s.t_apply > 0.02]
    with pytest.raises(UncertifiableError, match="moves otherwise"):
        certify(given, recording.states, late)


MODELS = {
    "unicycle": ({"type": "unicycle", "speed": 4.0, "turn_rate": 2.0}, 1.73, 3),
    "double-integrator": (
        {"type": "double-integrator", "acceleration": 4.0, "dimension": 2},
        0.5,
        4,
    ),
    "triple-integrator": ({"type": "triple-integrator", "jerk": 20.0, "dimension": 2}, 0.2, 6),
    "bicycle": ({"type": "bicycle", "acceleration": 4.0, "steering": 0.5}, 0.3, 4),
}


@pytest.mark.parametrize("model", MODELS)
def test_no_motion_leaves_the_safe_set_while_its_certificate_lasts(model):
    """Against inputs and disturbances held at their extremes, and others that are redrawn."""
    table, bound, n = MODELS[model]
    rng, lasted = np.random.default_rng(len(model)), []
    for _ in range(10):
        x = rng.uniform(-1.0, 1.0, (2, n))
        angle, distance = rng.uniform(-np.pi, np.pi), rng.uniform(1.05, 1.8)
        x[0, :2], x[1, :2] = 0.0, (distance * np.cos(angle), distance * np.sin(angle))
        given = scenario(table, x.tolist(), bound=bound, period=0.05)
        dynamics = given.agents[0].dynamics_object()
        most = np.array(ca.DM(dynamics.input_polytope(ca.SX.sym("x", x.shape[1]))[1])).ravel()
        u = rng.choice([-1.0, 1.0], len(dynamics.inputs)) * most[: len(dynamics.inputs)]
        steps = [step("1", 0.0, u.tolist())]
        found = certify(given, [State(0.0, x.ravel().tolist(), 0.0)], steps)
        assert found.horizon > 0.0
        unsafe = first_unsafe(dynamics, x, u, most, bound, 4.0 * found.horizon, rng)
        assert unsafe > found.horizon
        lasted.append(found.horizon / min(unsafe, 0.2))
    assert np.median(lasted) > 0.3  # a bound that certified nothing would be no use


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
    state, given = ca.SX.sym("x", 2 * n), ca.SX.sym("u", 2 * m)
    rates = [
        dynamics.drift(state[k * n : (k + 1) * n])
        + dynamics.actuation(state[k * n : (k + 1) * n]) @ given[k * m : (k + 1) * m]
        for k in (0, 1)
    ]
    apart = dynamics.position(state[:n]) - dynamics.position(state[n:])
    h = 1.0 - ca.sumsqr(apart)
    field = ca.Function("f", [state, given], [ca.vertcat(*rates)])
    rise = ca.Function("h", [state], [h, ca.jacobian(h, state).T])
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
    damaged = tmp_path / "damaged.mcap"
    whole = (unicycles.folder / "recording.mcap").read_bytes()
    damaged.write_bytes(whole[: len(whole) // 2])
    assert status(["certify", str(damaged)]) == 1
    printed = capsys.readouterr()
    assert "cut short" in printed.err
    assert "first not covered" in printed.out
