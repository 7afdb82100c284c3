"""The picture of one time, as a PNG file."""

import warnings
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from phalanx_viewer.export.still import draw
from phalanx_viewer.feeds.replay import Replay

import phalanx


def picture(scenario: phalanx.Scenario, t: float, path: Path) -> np.ndarray:
    draw(Replay(phalanx.run(scenario, engine="in-process").recording), t, path)
    return matplotlib.image.imread(path)


@pytest.mark.slow
def test_walls_are_drawn_in_space(tmp_path: Path) -> None:
    floor = {"normal": [0.0, 0.0, -1.0], "offset": 30.0, "clearance": 0.5}
    walled = phalanx.load("formation3d", {"duration": 0.05, "obstacles": [floor]})
    red, _, blue, _ = np.moveaxis(picture(walled, 0.0, tmp_path / "walled.png"), 2, 0)
    assert ((blue - red > 0.02) & (blue - red < 0.06)).mean() > 0.05, "a large pale face"


@pytest.mark.slow
def test_a_picture_before_the_first_input_brings_no_warnings(tmp_path: Path) -> None:
    late = phalanx.load("unicycles", {"duration": 0.05, "time.latency": 0.004})
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        first_picture = picture(late, 0.0, tmp_path / "first.png")
    assert np.ptp(first_picture) == 1.0
