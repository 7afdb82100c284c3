"""Units of h and ψ in a scenario."""

import pytest

from phalanx.scenario.load import load
from phalanx.swarm.swarm import unit_of_psi


@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("formation3d", ("m²", "m²/s", "m²/s²", "m²/s³")),
        ("formation3d-distance", ("m", "m/s", "m/s²", "m/s³")),
        ("fence", ("m", "m/s", "m/s²", "m/s³")),
    ],
)
def test_psi_is_h_for_each_second_as_often_as_it_was_differentiated(name, units):
    assert tuple(unit_of_psi(load(name), k) for k in range(4)) == units


def test_a_limit_in_another_unit_leaves_none_that_all_have():
    disc = "limits=[{ type = 'fence', center = [0.0, 0.0], radius = 90.0 }]"
    assert unit_of_psi(load("unicycles"), 1) == "m²/s"
    assert unit_of_psi(load("unicycles", [disc]), 1) == ""
