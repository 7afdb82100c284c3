"""The effect of a network on the inputs: none where states are seen, more the older they are."""

import numpy as np
import pytest

import phalanx
from phalanx.launcher.network_effect import network_effect
from phalanx.theory.arrays import Array

pytestmark = pytest.mark.slow

PERFECT = {"network.loss": 0, "network.delay": 0, "faults": [], "agents.0.radio.every": 1}


def effects(name: str, **fields: object) -> Array:
    changes = {path.replace("__", "."): value for path, value in fields.items()}
    scenario = phalanx.load(name, {"duration": 1.0, **changes})
    return np.array([step.effect for step in network_effect(scenario)])


@pytest.mark.parametrize("loss", [0.0, 0.9])
def test_where_states_are_seen_and_no_input_is_believed_the_network_has_no_effect(loss: float):
    effect = effects("guaranteed", network__loss=loss)
    assert len(effect) > 100
    assert effect.max() == 0.0


def test_where_received_inputs_are_believed_their_loss_has_one():
    assert effects("unicycles", network__loss=0.9).mean() > 0.0


def test_of_an_agent_that_turned_twins_get_what_it_applies():
    steps = network_effect(phalanx.load("faults/turn"))
    late = [step.effect for step in steps if step.t > 0.5]  # it turned at 0.4 s
    assert len(late) > 40
    assert sum(effect > 0.0 for effect in late) < 0.1 * len(late)


def test_by_radio_it_grows_with_the_time_between_broadcasts_and_with_their_loss():
    def mean(**fields: object) -> float:
        scenario = phalanx.load("radio", {**PERFECT, "duration": 1.1, **fields})
        return float(np.mean([step.effect for step in network_effect(scenario)]))

    rare = {"agents.0.radio.every": 10}
    means = mean(), mean(**rare), mean(**rare, **{"network.loss": 0.9})
    assert 0.0 < means[0] < means[1] < means[2]


def test_what_one_controller_knows_comes_by_no_network():
    with pytest.raises(ValueError, match="one controller knows all"):
        network_effect(phalanx.load("centralised"))


def test_a_run_has_it_for_each_control_step():
    run = phalanx.run(phalanx.load("unicycles", {"duration": 0.1}), engine="in-process")
    assert run.network_effect.columns == ["agent", "t", "effect"]
    assert len(run.network_effect) == len(
        run.inputs.filter(run.inputs["agent"].is_in(["1", "2", "3"]))
    )
