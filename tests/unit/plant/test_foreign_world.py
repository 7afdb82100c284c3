"""Worlds of other laws than the declared ones: their protocol, and what the judge makes of them."""

from types import SimpleNamespace

import pytest
from phalanx_plant.clock.lookahead import look_ahead
from phalanx_plant.world.foreign import ForeignIntegration
from phalanx_plant.world.world import World

import phalanx
from phalanx.schema import registry
from phalanx.theory.models.world import advanced
from tests.unit.plant import worlds
from tests.unit.swarms import rows_of_scenario

HERE = "tests.unit.plant.worlds"


def test_a_world_without_notes_says_that_nothing_else_happened():
    terse = SimpleNamespace(advance=lambda until: SimpleNamespace(t=[until], x={}))
    assert advanced(terse, [], 0.0, 0.001, step=0.001).notes == ()


@pytest.fixture
def ran(tmp_path):
    def run(world, *overrides, duration=0.5):
        fields = ", ".join(f"{k} = {v}" for k, v in world.items() if k != "type")
        table = f'world={{ type = "{HERE}:{world["type"]}"{fields and ", " + fields} }}'
        scenario = phalanx.load("unicycles", [f"duration={duration}", table, *overrides])
        return phalanx.run(scenario, engine="in-process", out=tmp_path)

    return run


def test_nothing_runs_ahead_of_a_world():
    rows = rows_of_scenario("swarm2d")
    foreign = ForeignIntegration(rows.swarm, Still())
    chosen = look_ahead(World(rows)), look_ahead(World(rows, foreign))
    assert [each.sequential for each in chosen] == [False, True]


class Still(worlds.Unicycles):
    """Robots of any dynamics that never move."""

    def hold(self, name, u):
        pass


def failed(run):
    found = {each.name: each for each in run.summary.assumptions}
    return found["disturbance bound"]


@pytest.mark.slow
def test_a_world_as_declared_ends_guaranteed(ran):
    run = ran({"type": "Unicycles"})
    assert run.verdict == "guaranteed"
    assert failed(run).checked > 400
    assert failed(run).failed == 0


@pytest.mark.slow
def test_a_world_that_goes_wrong_on_the_way_is_never_guaranteed(ran):
    run = ran({"type": "Unicycles", "gain": 3.0, "since": 0.2})
    assert run.verdict != "guaranteed"
    assert failed(run).first == pytest.approx(0.2, abs=2e-3)
    assert "the most above was" in failed(run).note
    assert "of agent" in failed(run).note


@pytest.mark.slow
def test_a_small_slip_is_a_disturbance_within_its_bound(ran):
    run = ran({"type": "Unicycles", "gain": 1.1})
    assert failed(run).failed == 0
    assert run.verdict == "guaranteed"


@pytest.mark.slow
def test_a_run_in_a_world_can_be_repeated_if_it_says_so(ran):
    assert phalanx.verify(ran({"type": "Unicycles"}, duration=0.1)).difference is None
    honest = ran({"type": "Fickle", "determinism": '"none"'}, duration=0.1)
    with pytest.raises(phalanx.EngineError, match="declares no determinism"):
        phalanx.verify(honest)


@pytest.mark.nightly
@pytest.mark.slow
def test_a_world_draws_from_another_seed_from_a_reseed_on(ran):
    nothing = [*(f"agents.{k}.clock.jitter=0" for k in (0, 1)), "network.loss=0", "network.delay=0"]

    def halves(*seeds):
        reseed = ", ".join(f"{{ at = 0.1, seed = {seed} }}" for seed in seeds)
        states = ran(
            {"type": "Slippery"}, *nothing, f"reseed=[{reseed}]", duration=0.3
        ).states.drop("run")
        return [states.filter(part) for part in (states["t"] <= 0.1, states["t"] > 0.1)]

    (before, _), (again, one), (_, other) = halves(), halves(8), halves(9)
    assert before.equals(again)
    assert len(before) > 10
    assert not one.equals(other)


@pytest.mark.slow
def test_a_difference_in_a_world_of_one_build_says_that_another_build_may_differ(ran):
    run = ran({"type": "Fickle", "determinism": '"build"'}, duration=0.1)
    assert "on one build and CPU alone" in phalanx.verify(run, engine="in-process").difference


@pytest.mark.nightly
@pytest.mark.slow
def test_a_check_says_that_the_robots_move_by_another_law():
    scenario = phalanx.load("unicycles", [f'world={{ type = "{HERE}:Unicycles" }}'])
    assert any(f"move by {HERE}:Unicycles" in line for line in phalanx.check(scenario).words)


def test_a_world_that_breaks_a_rule_ends_the_run_with_its_name(ran):
    run = ran({"type": "Overshooting"}, duration=0.1)
    assert run.verdict == "broken"
    assert "Overshooting.advance" in run.summary.reason


@pytest.mark.parametrize(
    ("name", "world", "message"),
    [
        ("unicycles", {"type": f"{HERE}:Draws"}, "expected a dataclass that is a World"),
        (
            "worlds/rovers",
            {"type": "mujoco", "failures": [{"at": 1.0, "agent": "9"}]},
            "failures: expected names of agents",
        ),
    ],
)
def test_a_world_that_is_none_or_cannot_start_is_refused_before_a_run(name, world, message):
    with pytest.raises(phalanx.ScenarioError, match=f"world: {message}"):
        phalanx.load(name, {"world": world})


def test_a_world_of_a_package_that_is_not_installed_says_what_to_install(monkeypatch):
    monkeypatch.setattr(registry, "entry_points", lambda group: ())
    registry._installed.cache_clear()
    with pytest.raises(phalanx.ScenarioError, match=r"pip install \./packages/phalanx-worlds"):
        phalanx.load("worlds/rovers")
    registry._installed.cache_clear()
