"""The picture of the region where the backup suffices, against a calculation by hand."""

import io

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from phalanx.report.backup import Slice, backup_figure, backup_slice
from tests.unit.swarms import rows_of_scenario

UNSAFE, TOO_LATE, SUFFICES = range(3)
COLOURS = {UNSAFE: "#5b6068", TOO_LATE: "#f4b6b0", SUFFICES: "#bfe3c6"}
ETA = 0.3  # of one-on-one, where α(h) = h


@pytest.fixture(scope="module")
def equal() -> Slice:
    """Around an agent, the places of an adversary as fast as itself."""
    return backup_slice(rows_of_scenario("one-on-one"), reach=4.0)


def distances(found: Slice) -> np.ndarray:
    return np.hypot(*np.meshgrid(*found.axes))


def test_the_slice_is_unsafe_within_the_required_distance_and_nowhere_else(equal):
    assert {*np.unique(equal.results)} == {UNSAFE, TOO_LATE, SUFFICES}
    np.testing.assert_array_equal(equal.results == UNSAFE, distances(equal) < 1.0)


def test_against_an_equal_the_backup_suffices_exactly_where_alpha_outweighs_the_margin(equal):
    """The best flight cancels the best chase, so that α(h) + η <= 0 is all that is left."""
    h = 1.0 - distances(equal) ** 2
    np.testing.assert_array_equal(equal.results == SUFFICES, h + ETA <= 0)


def test_against_a_faster_one_the_backup_suffices_only_farther_away():
    """Flight and chase add 2 (|D_1| + |D_2|) (1.5 - 1) to α(h) + η."""
    faster = backup_slice(rows_of_scenario("one-on-one", "agents.1.dynamics.speed=1.5"), 4.0)
    dx, dy = np.meshgrid(*faster.axes)
    left = np.abs(dx) + np.abs(dy) + 1.0 - dx**2 - dy**2 + ETA
    np.testing.assert_array_equal(faster.results == SUFFICES, left <= 1e-12)


def test_a_margin_scaled_down_lets_the_backup_suffice_nearer():
    halved = backup_slice(rows_of_scenario("one-on-one", "safety.margin_scale=0.5"), 4.0)
    h = 1.0 - distances(halved) ** 2
    np.testing.assert_array_equal(halved.results == SUFFICES, h + 0.5 * ETA <= 0)


@pytest.mark.slow
def test_the_picture_shows_each_answer_on_as_much_of_its_panel_as_the_slice_gives_it(equal):
    file = io.BytesIO()
    backup_figure(equal).savefig(file, format="png")
    pixels = matplotlib.image.imread(io.BytesIO(file.getvalue()))[:, :, :3]
    drawn = {
        k: np.isclose(pixels, to_rgb(c), atol=0.01).all(axis=2).sum() for k, c in COLOURS.items()
    }
    for answer in COLOURS:
        share = drawn[answer] / sum(drawn.values())
        assert share == pytest.approx(np.mean(equal.results == answer), abs=0.02)
