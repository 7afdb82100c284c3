"""A run as a moving picture: what a frame shows, its file's formats, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgb
from PIL import Image

import phalanx
from phalanx.cli.app import USAGE_ERROR, status
from phalanx.faults.commands import Command
from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.records import Log
from phalanx.report.animate import Film, Stage
from tests.layers import layered
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space, unicycles


@pytest.fixture
def run(tmp_path: Path) -> phalanx.Run:
    scenario = unicycles("network.loss=0.5")
    records = [*drift(scenario), Log(0.2, r"cost $\frac{1$ each"), Command(0.3, "kill", "2")]
    return phalanx.open(record(tmp_path, scenario, records, summary_of(scenario)))


def staged(run: phalanx.Run, times: list[float]) -> Stage:
    return Stage(ReportHistory(run.recording), Film(np.array(times), 10, 1.0))


def moving(stage: Stage, kind: type) -> list:
    return [each for each in stage.figure.axes[0].collections if isinstance(each, kind)]


@pytest.mark.slow
def test_a_frame_shows_where_agents_are_and_which_are_dead(run: phalanx.Run):
    stage = staged(run, [0.0, 0.25, 0.45])
    (discs,) = moving(stage, EllipseCollection)
    frames, history = stage.frames(), ReportHistory(run.recording)
    grey = to_rgb("#9aa0a8")
    for t, dead in ((0.0, False), (0.25, False), (0.45, True)):
        next(frames)
        at = np.abs(history.times - t).argmin()
        assert discs.get_offsets() == pytest.approx(history.positions[at], abs=0.02)
        assert (tuple(discs.get_facecolor()[1][:3]) == grey) == dead
        assert tuple(discs.get_facecolor()[0][:3]) != grey
        assert stage.figure.axes[0].get_title(loc="left") == f"unicycles, t = {t:.1f} s"


@pytest.mark.slow
def test_a_link_is_the_redder_the_more_broadcasts_it_lost(run: phalanx.Run):
    stage, history = staged(run, [0.0, 0.2]), ReportHistory(run.recording)
    *_, last = (frame for frame, _ in zip(stage.frames(), range(2), strict=False))
    lines = moving(stage, LineCollection)[0]
    broadcasts_sent = history.broadcasts[
        (history.broadcasts.sent > 0.0) & (history.broadcasts.sent <= 0.2)
    ]
    shares = {}
    for link in {
        tuple(sorted(pair))
        for pair in zip(broadcasts_sent.sender, broadcasts_sent.receiver, strict=True)
    }:
        broadcasts = [b for b in broadcasts_sent if tuple(sorted((b.sender, b.receiver))) == link]
        shares[link] = np.mean([b.arrival == b.sent and b.fate == 2 for b in broadcasts])
    assert last == 1
    assert len(set(shares.values())) > 1
    reds = [colour[0] for colour in lines.get_color()]
    lost = [shares[link] for link in sorted(shares)]
    assert np.argsort(reds).tolist() == np.argsort(lost).tolist()


@pytest.mark.slow
def test_a_line_of_the_log_is_shown_as_it_is_and_the_verdict_comes_last(run: phalanx.Run):
    stage = staged(run, [0.0, 0.3, 0.6])
    texts = []
    for _ in stage.frames():
        stage.figure.draw_without_rendering()
        texts.append([t.get_text() for t in stage.figure.axes[0].texts])
    assert r"0.2 s: cost $\frac{1$ each" in texts[1]
    assert ["violated" in frame for frame in texts] == [False, False, True]


@pytest.mark.slow
@pytest.mark.parametrize("name", layered(("run.gif", "run.webp"), ("run.gif",)))
def test_it_takes_as_long_as_the_run_though_formats_round_each_frame(
    name: str, run: phalanx.Run, tmp_path: Path
):
    picture, durations = Image.open(run.animate(tmp_path / name, per_second=15)), []
    for number in range(picture.n_frames):
        picture.seek(number)
        picture.load()
        durations.append(picture.info["duration"])
    assert (len(durations), sum(durations[:-1]), durations[-1]) == (0.6 * 15 + 1, 600, 2500)
    assert picture.convert("RGB").getpixel((2, 2)) == (255, 255, 255)
    assert not any(pixels % 2 for pixels in picture.size)


@pytest.mark.slow
def test_a_frame_looks_the_same_after_a_later_one(run: phalanx.Run):
    stage = staged(run, [0.0, 0.3, 0.6])
    canvas = FigureCanvasAgg(stage.figure)
    looks = []
    for number in (0, 1, 2, 1, 0):
        stage.show(number)
        canvas.draw()
        looks.append(bytes(canvas.buffer_rgba()))
    assert looks == looks[::-1]
    assert len(set(looks)) == 3


@pytest.mark.slow
def test_a_swarm_in_space_is_seen_from_above(tmp_path: Path):
    scenario = swarm_in_space(13, 1, {})
    made = record(tmp_path, scenario, drift(scenario, steps=3), summary_of(scenario))
    run = phalanx.open(made)
    assert run.animate(tmp_path / "run.gif", speed=10.0, per_second=2).exists()


@pytest.mark.slow
def test_what_cannot_be_drawn_is_refused_in_a_line(run: phalanx.Run, tmp_path: Path):
    for arguments, message in (
        ({"path": "run.avi"}, "path: expected a name that ends in .gif, .webp, got run.avi"),
        ({"path": "run.gif", "speed": 0.0}, "speed and per_second: expected above 0, and 1 to 60"),
        ({"path": "run.gif", "per_second": 0}, "got 1.0 and 0"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            run.animate(**arguments)
    (tmp_path / "empty").mkdir()
    empty = phalanx.open(record(tmp_path / "empty", unicycles(), [], None))
    with pytest.raises(ValueError, match="the recording holds no state: nothing to draw"):
        empty.animate("run.gif")


@pytest.mark.slow
def test_the_command_writes_it_too_and_refuses_other_formats(run: phalanx.Run, tmp_path, capsys):
    path = tmp_path / "swarm.webp"
    assert status(["animate", str(run.folder), str(path), "--speed", "2"]) == 0
    assert Image.open(path).n_frames > 1
    assert capsys.readouterr().out.strip() == str(path)
    assert status(["animate", str(run.folder), str(tmp_path / "swarm.avi")]) == USAGE_ERROR
    assert "expected a name that ends in .gif, .webp" in capsys.readouterr().err
