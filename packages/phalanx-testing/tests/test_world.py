"""check_world: the rule that a world breaks is named, and worlds that keep all pass."""

import pytest
from phalanx_testing import WorldMistakeError, check_world

from phalanx.extend import WorldAgent
from phalanx.theory.expressions.user_methods import MistakenMethodError
from tests.layers import layered
from tests.unit.plant import worlds
from tests.unit.swarms import rows_of_scenario

from . import mistaken_worlds


def robots(name="unicycles"):
    swarm = rows_of_scenario(name).swarm
    starts = (swarm.start()[part] for part in swarm.safe_set.parts)
    return [WorldAgent(m.name, m.dynamics, x) for m, x in zip(swarm.members, starts, strict=True)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", layered(("unicycles", "formation3d", "quadrotors"), ("unicycles",))
)
def test_the_plants_own_integration_is_a_world(name):
    check_world(lambda: mistaken_worlds.Declared(rows_of_scenario(name)), robots(name))


@pytest.mark.parametrize(
    "world", [worlds.Unicycles, worlds.Slippery, lambda: worlds.Fickle(determinism="none")]
)
def test_a_world_of_ones_own_passes(world):
    """One without determinism need not repeat itself."""
    check_world(world, robots())


@pytest.mark.parametrize(
    ("world", "rule"),
    [
        (mistaken_worlds.Forgetful, "two advances are one"),
        (lambda: mistaken_worlds.Forgetful(determinism="none"), "two advances are one"),
        (mistaken_worlds.Deaf, "its input does not move it"),
        (mistaken_worlds.Trusting, "an input that is not finite"),
        (worlds.Fickle, "same seed, same states"),
        (mistaken_worlds.Misplaced, "agent 1: it starts elsewhere"),
        (mistaken_worlds.Restless, "an input is zero until the first one"),
        (mistaken_worlds.Borrowing, "does hold copy its input"),
        (mistaken_worlds.Overwriting, "a later advance changed its states"),
        (mistaken_worlds.Jumping, "same new seed, same states"),
        (mistaken_worlds.Patient, "an advance to now"),
        (lambda: worlds.Unicycles(determinism="some"), "expected bits, build or none, got some"),
    ],
)
def test_a_world_that_breaks_a_rule_is_named_with_it(world, rule):
    with pytest.raises(WorldMistakeError, match=rule):
        check_world(world, robots())


@pytest.mark.parametrize("world", [worlds.Overshooting, mistaken_worlds.Coarse])
def test_a_world_that_returns_other_times_is_refused(world):
    with pytest.raises(MistakenMethodError, match=r"advance: expected states up to t = 0\.05 s"):
        check_world(world, robots())
