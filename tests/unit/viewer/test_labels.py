"""No text covers another, and the more important one stays."""

import numpy as np
import pytest
from phalanx_viewer.scene.cameras import View
from phalanx_viewer.scene.nodes import linear
from phalanx_viewer.scene.texts import LETTER, place_texts, text_places


def labels_shown(at: list[list[float]], letters: list[int]) -> list[int]:
    """Texts that are shown, each with a single place."""
    return [text for text, _ in place_texts([np.array([place]) for place in at], letters)]


def test_a_text_with_several_places_takes_the_first_that_is_free() -> None:
    around = np.array([[0.0, 0.1], [0.0, -0.1], [0.1, 0.0]])
    assert place_texts([around] * 4, [1] * 4) == [(0, 0), (1, 1), (2, 2)]


def test_a_text_covers_a_body_only_if_it_has_no_position_without() -> None:
    near, far = [0.0, 0.0], [0.3, 0.0]
    body = (0.01, 0.0, 0.02)
    assert place_texts([np.array([near, far])], [1], [body]) == [(0, 1)]
    assert place_texts([np.array([near])], [1], [body]) == [(0, 0)]


def test_a_long_text_needs_more_room_to_its_sides_but_not_above() -> None:
    right, above = [[0.0, 0.0], [0.1, 0.0]], [[0.0, 0.0], [0.0, 0.1]]
    assert labels_shown(right, [1, 1]) == [0, 1]
    assert labels_shown(right, [20, 1]) == [0]
    assert labels_shown(above, [20, 20]) == [0, 1]


def test_of_two_texts_in_one_place_the_first_stays_and_the_other_takes_no_room() -> None:
    assert labels_shown([[0.0, 0.0], [0.02, 0.0], [0.04, 0.0]], [1, 1, 1]) == [0, 2]


@pytest.mark.parametrize(("high", "below"), [(3.0, True), (0.0, True), (-3.5, False)])
@pytest.mark.parametrize("slant", [0.5, -0.5])
def test_the_text_of_a_pair_is_below_it_but_not_where_the_legend_is(
    high: float, below: bool, slant: float
) -> None:
    view = View(np.array([0.0, 0.0, 10.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.8, 1.0)
    a, b = np.array([-1.0, high - slant, 0.0]), np.array([1.0, high + slant, 0.0])
    first, other = text_places(a, b, letters=5, clear=0.1, view=view)[:, 1] - high
    assert (first < -0.1, other > 0.1) == (below, below)
    assert (first > 0.1, other < -0.1) == (not below, not below)


def test_the_text_of_a_limit_is_below_its_agent() -> None:
    view = View(np.array([0.0, 0.0, 10.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.8, 1.0)
    agent = np.zeros(3)
    assert text_places(agent, agent, letters=5, clear=0.1, view=view)[0, 1] < -0.1


def test_lines_ends_have_the_colours_of_the_legend() -> None:
    colours = np.arange(256)
    light = linear(colours) / 255.0
    encoded = np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    assert np.abs(255.0 * encoded - colours).max() < 7.0


def test_the_text_next_to_a_pair_at_the_pictures_edge_stays_inside() -> None:
    view = View(np.array([0.0, 0.0, 10.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.5, 1.5)
    a, b = (np.array([0.74 * view.spans(np.zeros((1, 3)))[0], y, 0.0]) for y in (0.0, 0.1))
    right = view.project(text_places(a, b, letters=20, clear=0.1, view=view))[:, 0]
    assert (right > 0.0).all()
    assert (right <= 0.75 - 20 * LETTER / 2.0 + 1e-9).all()
