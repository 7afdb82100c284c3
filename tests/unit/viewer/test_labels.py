"""No text covers another, and the more important one stays."""

import numpy as np

from phalanx.viewer.scene.labels import apart


def test_of_two_texts_in_one_place_the_first_stays() -> None:
    assert apart(np.array([[0.0, 0.0], [0.01, 0.0], [0.4, 0.0]]), [2, 2, 2]) == [0, 2]


def test_a_long_text_needs_more_room_to_its_sides_but_not_above() -> None:
    beside, above = np.array([[0.0, 0.0], [0.1, 0.0]]), np.array([[0.0, 0.0], [0.0, 0.1]])
    assert apart(beside, [1, 1]) == [0, 1]
    assert apart(beside, [20, 1]) == [0]
    assert apart(above, [20, 20]) == [0, 1]


def test_what_gave_way_takes_no_room_itself() -> None:
    row = np.array([[0.0, 0.0], [0.02, 0.0], [0.04, 0.0]])
    assert apart(row, [1, 1, 1]) == [0, 2]
