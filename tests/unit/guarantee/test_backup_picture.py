"""phalanx check, and its picture of where the backup control still suffices."""

import numpy as np
import pytest

from phalanx.cli.app import status
from phalanx.report.backup import backup_slice
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm


@pytest.fixture(scope="module")
def found():
    return backup_slice(build_swarm(load("one-on-one")), reach=4.0)


def test_the_slice_is_unsafe_within_the_required_distance_and_nowhere_else(found):
    dx, dy = np.meshgrid(*found.axes)
    np.testing.assert_array_equal(found.answers == 0, np.hypot(dx, dy) < 1.0)


def test_against_an_equal_the_backup_suffices_exactly_where_alpha_outweighs_the_margin(found):
    """The best flight cancels the best chase, so that α(h) + η <= 0 is all that is left."""
    dx, dy = np.meshgrid(*found.axes)
    swarm = build_swarm(load("one-on-one"))
    h = 1.0 - dx**2 - dy**2
    (gain,) = swarm.scenario.safety.alpha
    np.testing.assert_array_equal(found.answers == 2, gain * h + swarm.eta(0) <= 0)


def test_check_names_what_keeps_simulation_1_from_a_guarantee(capsys):
    assert status(["check", "unicycles", "--strict"]) == 1
    printed = capsys.readouterr().out
    assert "η is given or from given constants, not a bound" in printed
    assert "Theorem 4" in printed


def test_check_finds_nothing_against_the_guaranteed_scenario(capsys, tmp_path):
    picture = tmp_path / "backup.png"
    assert status(["check", "guaranteed", "--strict", "--plot", str(picture)]) == 0
    assert "can end guaranteed" in capsys.readouterr().out
    assert picture.stat().st_size > 10_000
